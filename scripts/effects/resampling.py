"""The one interpolation that all geometric effects share: exact coordinates, no blur of its own, no ringing.

cv2.remap rounds coordinates to 1/32 px, which alone costs an edge some grey levels; hence our own.
"""

import functools

import numpy as np
from numba import njit

TAPS = 6
PHASES = 1024


@functools.cache
def kernel_table():
    """Return weights (PHASES + 1, 6) of Lanczos' kernel with three lobes at fractions of a pixel, summing to 1.

    Source: K. Turkowski, "Filters for common resampling tasks", Graphics Gems I (1990).
    """
    fraction = np.arange(PHASES + 1)[:, None] / PHASES
    x = fraction - (np.arange(TAPS) - 2)
    weights = np.sinc(x) * np.sinc(x / 3) * (np.abs(x) < 3)
    return (weights / weights.sum(axis=1, keepdims=True)).astype(np.float32)


@njit(cache=True)
def _sample_plane(image, x, y, table, out):
    rows, columns = image.shape
    last = table.shape[0] - 1
    for r in range(out.shape[0]):
        for c in range(out.shape[1]):
            # NaN compares false: such elements take the corner's value
            u = x[r, c] if x[r, c] > 0 else np.float32(0)
            v = y[r, c] if y[r, c] > 0 else np.float32(0)
            u, v = min(u, np.float32(columns - 1)), min(v, np.float32(rows - 1))
            j, i = int(u), int(v)
            wx, wy = table[int((u - j) * last + 0.5)], table[int((v - i) * last + 0.5)]
            value, low, high = np.float32(0), np.float32(np.inf), np.float32(-np.inf)
            for k in range(6):
                row = image[min(max(i + k - 2, 0), rows - 1)]
                part = np.float32(0)
                for n in range(6):
                    part += wx[n] * row[min(max(j + n - 2, 0), columns - 1)]
                value += wy[k] * part
                if 1 <= k <= 4:
                    for n in range(1, 5):
                        near = row[min(max(j + n - 2, 0), columns - 1)]
                        low, high = min(low, near), max(high, near)
            # a sharp edge would ring; nothing is darker or brighter than what is near
            out[r, c] = min(max(value, low), high)


def sample(image, x, y):
    """Return the image (rows, columns[, channels]) at array coordinates x, y (float32, any one shape)."""
    planes = image[..., None] if image.ndim == 2 else image
    out = np.empty((*x.shape, planes.shape[2]), np.float32)
    for k in range(planes.shape[2]):
        plane = np.empty(x.shape, np.float32)
        _sample_plane(np.ascontiguousarray(planes[..., k], np.float32), x, y, kernel_table(), plane)
        out[..., k] = plane
    return out.reshape(*x.shape, *image.shape[2:])


@njit(cache=True)
def _cubic(t, p0, p1, p2, p3):
    return p1 + 0.5 * t * (p2 - p0 + t * (2 * p0 - 5 * p1 + 4 * p2 - p3 + t * (3 * (p1 - p2) + p3 - p0)))


@njit(cache=True)
def fine_map(grid, step, shape):
    """Return a coarse map at every array element, float32: Catmull-Rom between nodes ``step`` apart, one node before
    the first element and two after the last.
    """
    out = np.empty(shape, np.float32)
    line = np.empty(grid.shape[1])
    for r in range(shape[0]):
        k = r // step + 1
        t = (r % step) / step
        for n in range(grid.shape[1]):
            line[n] = _cubic(t, grid[k - 1, n], grid[k, n], grid[k + 1, n], grid[k + 2, n])
        for c in range(shape[1]):
            n = c // step + 1
            out[r, c] = _cubic((c % step) / step, line[n - 1], line[n], line[n + 1], line[n + 2])
    return out
