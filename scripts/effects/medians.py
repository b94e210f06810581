"""Medians over small squares of pixels, of an image and of what it is expected to be under noise."""

import cv2
import numpy as np

from kernels import njit

STEPS = 3  # of Newton's method: the next changes less than a hundredth of the noise
FLAT = 1.0  # times the noise: what differs by less in a square has its mean as the mean of its median
LEAST_NOISE_DN = 0.02
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
    noise = np.broadcast_to(np.float32(noise_dn), plane.shape)
    if noise.max() < LEAST_NOISE_DN:
        return sharp
    reach = side // 2
    padded = cv2.copyMakeBorder(plane, reach, reach, reach, reach, cv2.BORDER_REPLICATE)
    return _median_of_mixture(padded, noise, sharp, side)


@njit(cache=True, nogil=True, fastmath=True)
def _median_of_mixture(padded, noise, sharp, side):
    out = np.empty_like(sharp)
    values = np.empty(side * side, np.float32)
    count, one, zero = np.float32(side * side), np.float32(1), np.float32(0)
    for r in range(out.shape[0]):
        for c in range(out.shape[1]):
            s = noise[r, c]
            if s < LEAST_NOISE_DN:
                out[r, c] = sharp[r, c]
                continue
            low = high = padded[r, c]
            total = zero
            for i in range(side):
                for j in range(side):
                    v = padded[r + i, c + j]
                    values[i * side + j] = v
                    total += v
                    low, high = min(low, v), max(high, v)
            if high - low < FLAT * s:
                out[r, c] = total / count
                continue
            m, inverse = sharp[r, c], one / s
            for _ in range(STEPS):
                above, slope = zero, np.float32(1e-6)
                for k in range(side * side):
                    x = (m - values[k]) * inverse
                    a = abs(x)
                    p = one / (one + a * (A1 + a * (A2 + a * (A3 + a * A4))))
                    tail = p * p * p * p
                    above += np.copysign(one - tail, x)
                    slope += tail * p * (A1 + a * (D2 + a * (D3 + a * D4)))
                # the sum of error functions is nil at the median; its derivative is four times the slope over the noise
                m -= min(max(above / (np.float32(4) * slope), -one), one) * s
            out[r, c] = min(max(m, low), high)
    return out
