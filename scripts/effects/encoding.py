"""Between linear image values (0..1) and grey levels (0..255): IEC 61966-2-1 (sRGB) or a straight line, fast; clipping."""

import numpy as np
from numba import njit
from scipy.special import ndtr

CLIPPED_SD = 4.0  # standard deviations from black or white within which noise is clipped


def srgb_encode(linear):
    """Return IEC 61966-2-1 encoded values 0..1 of linear values 0..1."""
    return np.where(linear <= 0.0031308, 12.92 * linear, 1.055 * np.maximum(linear, 1e-12) ** (1 / 2.4) - 0.055)


def srgb_decode(encoded):
    """Return linear values 0..1 of IEC 61966-2-1 encoded ones."""
    return np.where(encoded <= 0.04045, encoded / 12.92, (np.maximum(encoded + 0.055, 0) / 1.055) ** 2.4)


# Knots at t^2: finer near black, where the curve bends
_KNOTS = np.linspace(0, 1, 4097)
_SRGB = srgb_encode(_KNOTS**2)


@njit(cache=True)
def _encode_srgb(values, table):
    out = np.empty_like(values)
    n = table.shape[0] - 1
    flat_in, flat_out = values.ravel(), out.ravel()
    for i in range(flat_in.size):
        t = np.sqrt(min(max(flat_in[i], np.float32(0.0)), np.float32(1.0))) * n
        k = min(int(t), n - 1)
        flat_out[i] = 255.0 * (table[k] + (t - k) * (table[k + 1] - table[k]))
    return out


def encode(linear, encoding):
    """Return grey levels 0..255 (float32, unrounded) of linear image values; clips to full scale."""
    if encoding == "srgb":
        return _encode_srgb(np.ascontiguousarray(linear, np.float32), _SRGB)
    return (255 * np.clip(linear, 0, 1)).astype(np.float32)


def decode(grey, encoding):
    """Return linear image values (float32) of grey levels; levels below 0 lie on the curve's straight foot."""
    value = np.asarray(grey, np.float64) / 255
    return (srgb_decode(value) if encoding == "srgb" else value).astype(np.float32)


def mean_of_clipped(levels, noise_dn):
    """Return the mean of grey levels with Gaussian noise (a number or as the levels) that are clipped to 0..255.

    E[max(X, 0)] = m Phi(m / s) + s phi(m / s) for X of mean m and standard deviation s; so for 255.
    """
    clipped = np.clip(levels, 0, 255)
    if np.ndim(noise_dn) == 0 and noise_dn <= 0:
        return clipped
    noise = np.broadcast_to(np.maximum(np.float32(noise_dn), np.float32(1e-6)), levels.shape)
    for sign, bound in ((1.0, 0.0), (-1.0, 255.0)):
        near = sign * (levels - bound) < CLIPPED_SD * noise
        d = sign * (levels[near] - bound) / noise[near]  # inwards, in standard deviations
        mean = d * ndtr(d) + np.exp(-d * d / 2) / np.sqrt(2 * np.pi)
        clipped[near] = bound + sign * noise[near] * mean
    return clipped
