"""Between linear image values (0..1) and grey levels (0..255): IEC 61966-2-1 (sRGB) or a straight line, fast; clipping."""

import math

import numpy as np

from kernels import njit

SQRT_2, SQRT_TAU = math.sqrt(2), math.sqrt(2 * math.pi)
CLIPPED_SD = 4.0  # standard deviations from black or white within which noise is clipped


def srgb_encode(linear):
    """Return IEC 61966-2-1 encoded values 0..1 of linear values 0..1."""
    return np.where(linear <= 0.0031308, 12.92 * linear, 1.055 * np.maximum(linear, 1e-12) ** (1 / 2.4) - 0.055)


def srgb_decode(encoded):
    """Return linear values 0..1 of IEC 61966-2-1 encoded ones."""
    return np.where(encoded <= 0.04045, encoded / 12.92, (np.maximum(encoded + 0.055, 0) / 1.055) ** 2.4)


# Knots at t^2: finer near black, where the curve bends
_KNOTS = np.linspace(0, 1, 4097)
_SRGB = 255 * srgb_encode(_KNOTS**2)
_LEVELS, _STEPS = _SRGB.astype(np.float32), np.diff(_SRGB, append=_SRGB[-1]).astype(np.float32)


@njit(inline="always")
def _level(value, levels, steps):
    """Return the grey level of a linear value (all float32)."""
    t = np.sqrt(min(max(value, np.float32(0.0)), np.float32(1.0))) * np.float32(len(levels) - 1)
    k = np.int32(t)
    return levels[k] + (t - np.float32(k)) * steps[k]


@njit(cache=True, nogil=True, fastmath=True)
def _encode_srgb(values, levels, steps):
    out = np.empty_like(values)
    flat_in, flat_out = values.ravel(), out.ravel()
    for i in range(flat_in.size):
        flat_out[i] = _level(flat_in[i], levels, steps)
    return out


def encode(linear, encoding):
    """Return grey levels 0..255 (float32, unrounded) of linear image values; clips to full scale."""
    if encoding == "srgb":
        return _encode_srgb(np.ascontiguousarray(linear, np.float32), _LEVELS, _STEPS)
    return (255 * np.clip(linear, 0, 1)).astype(np.float32)


@njit(cache=True, nogil=True, fastmath=True)
def _encode_noise_srgb(values, variance, declared, levels, steps):
    encoded, noise = np.empty_like(values), np.empty_like(values)
    flat_in, flat_variance, flat_encoded, flat_noise = values.ravel(), variance.ravel(), encoded.ravel(), noise.ravel()
    for i in range(flat_in.size):
        spread = np.sqrt(flat_variance[i]) / np.float32(255)
        own = _level(flat_in[i] + spread, levels, steps) - _level(flat_in[i] - spread, levels, steps)
        flat_encoded[i] = _level(flat_in[i], levels, steps)
        flat_noise[i] = np.sqrt(declared * declared + np.float32(0.25) * own * own)
    return encoded, noise


def encode_with_noise(linear, variance, declared_dn, encoding):
    """Return (grey levels as ``encode``, standard deviation of their noise in grey levels), each of the shape of ``linear``.

    ``variance`` (as ``linear``), squared levels of full scale 255, is that of the linear values; a declared noise adds to it.
    """
    if encoding == "srgb":
        values = np.ascontiguousarray(linear, np.float32)
        variance = np.ascontiguousarray(np.broadcast_to(variance, values.shape), np.float32)
        return _encode_noise_srgb(values, variance, np.float32(declared_dn), _LEVELS, _STEPS)
    spread = np.sqrt(variance) / np.float32(255)
    own = (encode(linear + spread, encoding) - encode(linear - spread, encoding)) / 2
    return encode(linear, encoding), np.hypot(np.float32(declared_dn), own)


_LINEAR = srgb_decode(np.linspace(0, 1, 8193))


@njit(cache=True, nogil=True)
def _decode_srgb(values, table):
    out = np.empty(values.shape, np.float32)
    flat_in, flat_out = values.ravel(), out.ravel()
    last = table.shape[0] - 1
    for i in range(flat_in.size):
        v = flat_in[i] / 255.0
        if v < 0:
            flat_out[i] = v / 12.92
        elif v >= 1:
            flat_out[i] = ((v + 0.055) / 1.055) ** 2.4
        else:
            t = v * last
            k = int(t)
            flat_out[i] = table[k] + (t - k) * (table[k + 1] - table[k])
    return out


def decode(grey, encoding):
    """Return linear image values (float32) of grey levels; levels below 0 lie on the curve's straight foot."""
    if encoding == "srgb":
        return _decode_srgb(np.ascontiguousarray(grey), _LINEAR)
    return (np.asarray(grey, np.float64) / 255).astype(np.float32)


def mean_of_clipped(levels, noise_dn):
    """Return the mean of grey levels with Gaussian noise (a number or as the levels) that are clipped to 0..255.

    E[max(X, 0)] = m Phi(m / s) + s phi(m / s) for X of mean m and standard deviation s; so for 255.
    """
    if np.ndim(noise_dn) == 0 and noise_dn <= 0:
        return np.clip(levels, 0, 255)
    reach = CLIPPED_SD * np.max(noise_dn)
    if levels.min(initial=255) >= reach and levels.max(initial=0) <= 255 - reach:
        return levels.copy()
    return _mean_of_clipped(np.ascontiguousarray(levels), np.broadcast_to(np.float32(noise_dn), levels.shape))


@njit(cache=True, nogil=True)
def _mean_of_clipped(levels, noise):
    out = np.empty_like(levels)
    flat_in, flat_out = levels.ravel(), out.ravel()
    for i, s in enumerate(noise.flat):
        level = flat_in[i]
        s = max(s, np.float32(1e-6))
        mean = min(max(level, np.float32(0.0)), np.float32(255.0))
        for sign, bound in ((1.0, 0.0), (-1.0, 255.0)):
            d = sign * (level - bound) / s  # inwards, in standard deviations
            if d < CLIPPED_SD:
                inside = 0.5 * math.erfc(-d / SQRT_2)
                mean = bound + sign * s * (d * inside + math.exp(-d * d / 2) / SQRT_TAU)
        flat_out[i] = mean
    return out


@njit(cache=True, nogil=True)
def look_up(values, table, low, high):
    """Return a table's values (n,), linear between, at values (any shape) float32 of which low and high are its ends."""
    out = np.empty_like(values)
    flat_in, flat_out = values.ravel(), out.ravel()
    last = table.shape[0] - 1
    low, high = np.float32(low), np.float32(high)
    per_step = np.float32(last) / (high - low)
    for i in range(flat_in.size):
        t = (min(max(flat_in[i], low), high) - low) * per_step
        k = min(np.int32(t), np.int32(last - 1))
        flat_out[i] = table[k] + (t - np.float32(k)) * (table[k + 1] - table[k])
    return out
