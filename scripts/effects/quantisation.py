"""Coefficients of a cosine transform rounded to steps: the mean of what a block codec does to an image with noise."""

import math

import numpy as np

from effects.exponential import FLATTER, steep_exponential
from kernels import njit

BLOCK = 8
NO_NOISE = 1e-6
NOISY = np.float32(0.3)  # steps, of noise, from which a rounding's error is a sine
ONE, HALF, MAX_STEPS_OFF = np.float32(1), np.float32(0.5), np.float32(6)


def _cosines():
    k = np.arange(BLOCK)
    basis = np.sqrt(2 / BLOCK) * np.cos(np.pi * (2 * k[None] + 1) * k[:, None] / (2 * BLOCK))
    basis[0] /= np.sqrt(2)
    return basis.astype(np.float32)


COSINES = _cosines()
COSINES_BACK = np.ascontiguousarray(COSINES.T)
P0, P1, P2, P3, P4, P5 = (  # of the normal distribution; all but the first over the root of 2 pi
    np.float32(p)
    for p in (
        0.2316419,
        *(np.array([0.31938153, -0.356563782, 1.781477937, -1.821255978, 1.330274429]) / math.tau**0.5),
    )
)


LAGS = BLOCK - 1
ALIKE = np.array([np.correlate(c, c, "full") for c in COSINES.astype(float)])  # of coefficients, by pixels apart


def gains_of(correlations):
    """Return by what noise is more in each coefficient (8, 8) of a block than in a pixel, or less; of white noise 1.

    correlations (15, 15) from pixel to pixel, by rows and columns apart.
    """
    return np.sqrt(np.maximum(ALIKE @ correlations @ ALIKE.T, 0)).astype(np.float32)


def noise_of_blocks(noise_dn, shape, across=1, down=1):
    """Return the noise (block rows, block columns) in blocks whose values are of (across, down) pixels of an image: of uneven
    noise the mean variance counts. ``noise_dn`` is a number or (rows, columns, C).
    """
    width, height = BLOCK * across, BLOCK * down
    if np.ndim(noise_dn):
        return _root_mean_square(np.ascontiguousarray(noise_dn, np.float32), width, height)
    return np.full((-(-shape[0] // height), -(-shape[1] // width)), noise_dn, np.float32)


@njit(cache=True, nogil=True)
def _root_mean_square(values, width, height):
    """Return the root mean square (block rows, block columns) of an array (rows, columns, C), its last row and column again."""
    rows, columns, channels = values.shape
    out = np.empty((-(-rows // height), -(-columns // width)), np.float32)
    for i in range(out.shape[0]):
        for j in range(out.shape[1]):
            total = np.float32(0.0)
            for r in range(i * height, (i + 1) * height):
                for c in range(j * width, (j + 1) * width):
                    for k in range(channels):
                        total += values[min(r, rows - 1), min(c, columns - 1), k] ** 2
            out[i, j] = np.sqrt(total / np.float32(width * height * channels))
    return out


@njit(cache=True, nogil=True)
def by_blocks(plane, noise, gains, rounding, table):
    """Return (plane with the lower of two steps of its blocks' means, probability of the upper one, evenness).

    plane (rows, columns) of whole blocks; the others and noise (block rows, block columns). Of all other coefficients the mean of
    the two steps is taken. ``gains`` (8, 8) are what noise is in each coefficient (``gains_of``), ``rounding`` is the standard
    deviation of what is added to it by whole numbers. Evenness is the share that is left of a rounding to whole
    numbers where these coefficients vary: of the error's first harmonic, the product of what each one's two steps leave. A row of
    blocks is transformed at once, what has the same place in its block side by side.
    """
    low = np.empty_like(plane)
    share, even = np.empty(noise.shape, np.float32), np.empty(noise.shape, np.float32)
    columns, count = plane.shape[1], noise.shape[1]
    strip, turned = np.empty((BLOCK, columns), np.float32), np.empty((BLOCK, columns), np.float32)
    by_block, by_place = strip.reshape(BLOCK, count, BLOCK), turned.reshape(BLOCK, BLOCK, count)
    coefficients, sd = np.empty((BLOCK, columns), np.float32), np.empty(count, np.float32)
    for i in range(noise.shape[0]):
        rows = slice(i * BLOCK, (i + 1) * BLOCK)
        for j in range(count):
            even[i, j] = 1
        _product(COSINES, plane[rows], strip)
        _write(by_block.transpose(2, 0, 1), by_place)
        _product(COSINES, turned, coefficients)
        for v in range(BLOCK):
            for u in range(BLOCK):
                of_frequency = coefficients[v, u * count : (u + 1) * count]
                for j in range(count):
                    sd[j] = max(np.sqrt((gains[v, u] * noise[i, j]) ** 2 + rounding * rounding), np.float32(NO_NOISE))
                if u == 0 and v == 0:
                    _split(of_frequency, table[u, v], sd, share[i])
                else:
                    _quantise(of_frequency, table[u, v], sd, even[i])
        _product(COSINES_BACK, coefficients, turned)
        _write(by_place.transpose(1, 2, 0), by_block)
        _product(COSINES_BACK, strip, low[rows])
        for j in range(count):
            even[i, j] = np.sqrt(even[i, j])
    return low, share, even


@njit(cache=True, nogil=True)
def _write(values, out):
    """Write values (m, n, k) to ``out``; number by number, as slices take numba seconds to compile."""
    for i in range(out.shape[0]):
        for j in range(out.shape[1]):
            for k in range(out.shape[2]):
                out[i, j, k] = values[i, j, k]


@njit(cache=True, nogil=True)
def _product(basis, values, out):
    """Write basis (8, 8) @ values (8, n) to ``out``."""
    for u in range(BLOCK):
        b0, b1, b2, b3, b4, b5, b6, b7 = basis[u]
        for k in range(values.shape[1]):
            first = b0 * values[0, k] + b1 * values[1, k] + b2 * values[2, k] + b3 * values[3, k]
            last = b4 * values[4, k] + b5 * values[5, k] + b6 * values[6, k] + b7 * values[7, k]
            out[u, k] = first + last


@njit(cache=True, nogil=True, fastmath=True)
def _beyond(d):
    """Return the probability that a standard normal number exceeds d, not negative: to 1e-6.

    Source: Abramowitz and Stegun, "Handbook of Mathematical Functions" (1964), 26.2.17.
    """
    far = min(d, MAX_STEPS_OFF)
    e = steep_exponential(far * far * np.float32(1 / (2 * FLATTER)))
    t = ONE / (ONE + P0 * far)
    return e * t * (P1 + t * (P2 + t * (P3 + t * (P4 + t * P5))))


@njit(cache=True, nogil=True, fastmath=True)
def _rounded_in_noise(x, sd):
    """Return the mean of a number with noise of ``sd``, at least NOISY, rounded to a whole one.

    Of a rounding's error the first harmonic is left, sin(2 pi x) exp(-2 pi^2 sd^2) / pi.
    """
    f = x - np.floor(x + HALF)
    far = min(sd * sd * np.float32(2 * np.pi**2 / FLATTER), ONE)
    slope = np.float32(8) * f * (ONE - np.float32(2) * abs(f))  # a parabola of the sine, and then the sine
    sine = slope * (np.float32(0.775) + np.float32(0.225) * abs(slope))
    return x - sine * steep_exponential(far) * np.float32(1 / np.pi)


@njit(fastmath=True, inline="always")
def _rounded(x, sd):
    """Return (mean of a number with noise of ``sd`` rounded to a whole one, probability of another than the nearest).

    Little noise leaves the nearest whole number or one of its neighbours. Both are computed, and one is taken without a
    branch, inline: numbers are then done side by side.
    """
    nearest = np.floor(x + HALF)
    up, down = _beyond((HALF + nearest - x) / sd), _beyond((HALF + x - nearest) / sd)
    quiet, noisy, is_noisy = nearest + up - down, _rounded_in_noise(x, sd), np.float32(sd >= NOISY)
    return quiet + is_noisy * (noisy - quiet), up + down + is_noisy * (HALF - up - down)


@njit(cache=True, nogil=True, fastmath=True)
def _quantise(values, step, sd, even):
    """Put the means of values (n,) with noise of ``sd`` (n,) that are rounded to steps in their place.

    ``even`` (n,), squared, becomes less by what the steps of each leave of a whole number's harmonic, over a block's pixels.
    """
    leap = np.float32(2) * (ONE - np.exp(np.float32(-2 * np.pi**2 / BLOCK**2) * step * step))
    if sd.min() >= NOISY * step:
        for k in range(len(values)):
            values[k] = _rounded_in_noise(values[k] / step, sd[k] / step) * step
            even[k] *= ONE - leap * HALF * HALF
        return
    for k in range(len(values)):
        mean, other = _rounded(values[k] / step, sd[k] / step)
        values[k] = mean * step
        even[k] *= ONE - leap * other * (ONE - other)


@njit(cache=True, nogil=True, fastmath=True)
def _split(values, step, sd, share):
    """Put the step below the mean of values (n,) in their place, and in ``share`` how far it lies towards the one above."""
    for k in range(len(values)):
        mean, _ = _rounded(values[k] / step, sd[k] / step)
        below = np.floor(mean)
        share[k] = mean - below
        values[k] = below * step
