"""Medians over small squares of pixels, of an image and of what it is expected to be under noise."""

import cv2
import numpy as np

from kernels import njit

STEPS = 3  # of Newton's method: the next changes less than a hundredth of the noise
FLAT = np.float32(1)  # times the noise: what differs by less in a square has its mean as the mean of its median
MIN_NOISE_DN = np.float32(0.02)
# of the normal distribution's error function, to 5e-4: Abramowitz and Stegun (1964), 7.1.27, its argument over the root of 2
A1, A2, A3, A4 = (np.float32(a / 2 ** (k / 2)) for k, a in enumerate((0.278393, 0.230389, 0.000972, 0.078108), 1))
D2, D3, D4 = np.float32(2) * A2, np.float32(3) * A3, np.float32(4) * A4
# Variance of the median of squares of standard normal numbers beyond that of their mean, with which it varies alike
BEYOND_MEAN = {3: 0.1659 - 1 / 9, 5: 0.0618 - 1 / 25}


def mean_of_median(plane, side, noise_dn):
    """Return the mean of the median over squares of ``side`` pixels, 3 or 5, of a plane (rows, columns) with Gaussian noise.

    ``noise_dn`` is its standard deviation, a number or as the plane.

    It is the median of the mixture of the pixels' distributions, which is as near as 0.13 of the noise where a step crosses the
    square, and nearer elsewhere.
    """
    sharp = cv2.medianBlur(plane, side)
    noise = np.full(plane.shape, noise_dn, np.float32)  # of one type, whatever it was: each is compiled
    if noise.max() < MIN_NOISE_DN:
        return sharp
    square = np.ones((side, side), np.uint8)
    low, high = (of(plane, square, borderType=cv2.BORDER_REPLICATE) for of in (cv2.erode, cv2.dilate))
    mean = cv2.blur(plane, (side, side), borderType=cv2.BORDER_REPLICATE)
    reach = side // 2
    padded = cv2.copyMakeBorder(plane, reach, reach, reach, reach, cv2.BORDER_REPLICATE)
    return _median_of_mixture(padded, noise, sharp, low, high, mean, side)


@njit(cache=True, nogil=True, fastmath=True)
def _median_of_mixture(padded, noise, sharp, low, high, mean, side):
    """Return the median of the mixture of each square's pixels (rows, columns): of those of a row that are not flat at once."""
    out, columns = sharp.copy(), sharp.shape[1]
    places, m, inverse = np.empty(columns, np.int32), np.empty(columns, np.float32), np.empty(columns, np.float32)
    values, above, slope = np.empty((side * side, columns), np.float32), np.empty_like(m), np.empty_like(m)
    one = np.float32(1)
    for r in range(out.shape[0]):
        count = 0
        for c in range(columns):
            if noise[r, c] < MIN_NOISE_DN:
                continue
            if high[r, c] - low[r, c] < FLAT * noise[r, c]:
                out[r, c] = mean[r, c]
            else:
                places[count], m[count], inverse[count] = c, sharp[r, c], one / noise[r, c]
                count += 1
        for i in range(side * side):
            of_row = padded[r + i // side, i % side :]
            for k in range(count):
                values[i, k] = of_row[places[k]]
        for _ in range(STEPS):
            above[:count], slope[:count] = 0, 1e-6
            for i in range(side * side):
                _add_tails(values[i, :count], m, inverse, above, slope)
            for k in range(count):
                # the sum of error functions is nil at the median; its derivative is four times the slope over the noise
                m[k] -= min(max(above[k] / (np.float32(4) * slope[k]), -one), one) / inverse[k]
        for k in range(count):
            c = places[k]
            out[r, c] = min(max(m[k], low[r, c]), high[r, c])
    return out


@njit(cache=True, nogil=True, fastmath=True)
def _add_tails(values, m, inverse, above, slope):
    """Add to the sums over a mixture what normal distributions about some values (n,) bring at m, and to their slopes."""
    one = np.float32(1)
    for k in range(len(values)):
        x = (m[k] - values[k]) * inverse[k]
        a = abs(x)
        p = one / (one + a * (A1 + a * (A2 + a * (A3 + a * A4))))
        tail = p * p * p * p
        above[k] += np.copysign(one - tail, x)
        slope[k] += tail * p * (A1 + a * (D2 + a * (D3 + a * D4)))
