"""Coefficients of a cosine transform rounded to steps: the mean of what a block codec does to an image with noise."""

import math

import numpy as np

from effects.exponential import FLATTER, steep_exponential
from kernels import njit

BLOCK = 8
NO_NOISE = 1e-6


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


@njit(cache=True, nogil=True)
def by_blocks(plane, noise, table):
    """Return (plane with the lower of two steps of its blocks' means, with the upper one, probability of the upper one).

    plane (rows, columns) of whole blocks, noise and probability (block rows, block columns). An orthonormal transform leaves
    white noise as it is: of all other coefficients the mean of the two steps is taken. A row of blocks is transformed at once,
    what has the same place in its block side by side.
    """
    low, high = np.empty_like(plane), np.empty_like(plane)
    share = np.empty(noise.shape, np.float32)
    columns, count = plane.shape[1], noise.shape[1]
    strip, turned = np.empty((BLOCK, columns), np.float32), np.empty((BLOCK, columns), np.float32)
    by_block, by_place = strip.reshape(BLOCK, count, BLOCK), turned.reshape(BLOCK, BLOCK, count)
    coefficients, sd = np.empty((BLOCK, columns), np.float32), np.empty(count, np.float32)
    for i in range(noise.shape[0]):
        rows = slice(i * BLOCK, (i + 1) * BLOCK)
        for j in range(count):
            sd[j] = max(noise[i, j], np.float32(NO_NOISE))
        _product(COSINES, plane[rows], strip)
        by_place[:] = by_block.transpose(2, 0, 1)
        _product(COSINES, turned, coefficients)
        for v in range(BLOCK):
            for u in range(BLOCK):
                of_frequency = coefficients[v, u * count : (u + 1) * count]
                if u == 0 and v == 0:
                    _split(of_frequency, table[u, v], sd, share[i])
                else:
                    _quantise(of_frequency, table[u, v], sd)
        _product(COSINES_BACK, coefficients, turned)
        by_block[:] = by_place.transpose(1, 2, 0)
        _product(COSINES_BACK, strip, low[rows])
    step = table[0, 0] / np.float32(BLOCK)
    for r in range(plane.shape[0]):
        for c in range(columns):
            high[r, c] = low[r, c] + step
    return low, high, share


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
def _upper_share(value, step, sd):
    """Return the probability that a value with noise is above the middle of two steps: the normal distribution, to 1e-6.

    Source: Abramowitz and Stegun, "Handbook of Mathematical Functions" (1964), 26.2.17.
    """
    one, half = np.float32(1), np.float32(0.5)
    steps = value / step
    d = (steps - np.floor(steps) - half) * step / sd
    far = min(abs(d), np.float32(6))
    x = far * far * np.float32(1 / (2 * FLATTER))
    e = steep_exponential(x)
    t = one / (one + P0 * far)
    beyond = e * t * (P1 + t * (P2 + t * (P3 + t * (P4 + t * P5))))
    return beyond if d < 0 else one - beyond


@njit(cache=True, nogil=True, fastmath=True)
def _quantise(values, step, sd):
    """Put the means of values (n,) with noise of ``sd`` (n,) that are rounded to steps in their place."""
    for k in range(len(values)):
        values[k] = (np.floor(values[k] / step) + _upper_share(values[k], step, sd[k])) * step


@njit(cache=True, nogil=True, fastmath=True)
def _split(values, step, sd, share):
    """Put the step below values (n,) in their place, and in ``share`` the probability that noise takes them to the one above."""
    for k in range(len(values)):
        share[k] = _upper_share(values[k], step, sd[k])
        values[k] = np.floor(values[k] / step) * step
