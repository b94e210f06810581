"""Denoising: smoothing, most of it of a kind that keeps edges.

A bilateral filter, range strength_dn, reach in space reach_px; a share median_share of a median of 3 x 3 pixels, or of
5 x 5; and a share average_share of a plain average, Gaussian or over a square. Sources: Tomasi and Manduchi, "Bilateral
filtering for gray and color images" (1998); Tukey, "Exploratory Data Analysis" (1977).
"""

import cv2
import numpy as np

from effects.base import Parameter
from effects.exponential import FLATTER, steep_exponential
from effects.filters import box, box_taps, gaussian, gaussian_reach_px, gaussian_taps
from effects.medians import BEYOND_MEAN, mean_of_median
from effects.noise_kernels import centred
from kernels import njit

STAGE, ORDER = "processing", 30
AFFECTS = "intensity"
DIAMETER_PX = 9  # of the bilateral filter's window: 7 cut off a reach of 1.8 px
MEDIAN_PX, WIDE_MEDIAN_PX = 3, 5
# Variances of noise that widen the square of a bilateral filter's range: for its mean, and for the noise that it leaves; between
# 1, that of the neighbours, and 2, that of their differences from a pixel that has its own
MEAN_WIDENS, NOISE_WIDENS = 1.5, 1.25
WINDOW = np.ones((DIAMETER_PX, DIAMETER_PX), np.uint8)
STRAIGHT_DN = np.float32(1e-3)  # a bend of this in all places moves a level by some thousandths
TAPS = 2 * 16 + 1  # more than the widest average has
PARAMETERS = {
    "strength_dn": Parameter(
        unit="dn", lower=0.0, upper=80.0, null=0.0, matters=0.5, doc="standard deviation of levels that are averaged"
    ),
    "reach_px": Parameter(
        unit="px",
        lower=0.4,
        upper=3.0,
        null=1.5,
        matters=0.1,
        doc="standard deviation of the distance over which they are",
        auxiliary=True,
    ),
    "median_share": Parameter(unit="1", lower=0.0, upper=1.0, null=0.0, matters=0.1, doc="share of the median"),
    "median_wide": Parameter(
        unit="1",
        lower=0.0,
        upper=1.0,
        null=0.0,
        matters=0.2,
        doc="of which over 5 x 5 pixels, not 3 x 3",
        auxiliary=True,
    ),
    "average_share": Parameter(unit="1", lower=0.0, upper=1.0, null=0.0, matters=0.1, doc="share of the average"),
    "average_px": Parameter(
        unit="px",
        lower=0.4,
        upper=3.0,
        null=0.8,
        matters=0.1,
        doc="standard deviation of the distance over which it goes",
        auxiliary=True,
    ),
    "average_square": Parameter(
        unit="1",
        lower=0.0,
        upper=1.0,
        null=0.0,
        matters=0.2,
        doc="of which over a square, not Gaussian",
        auxiliary=True,
    ),
}
STARTS = (
    {"strength_dn": 2.0},
    {"strength_dn": 8.0},
    {"strength_dn": 20.0},
    {"median_share": 0.7},
    {"average_share": 0.5},
)


def bilateral(plane, p, noise_dn=0.0):
    """Return a channel averaged over what is near in place and in level: its mean where it has noise, a number or as the plane.

    Noise widens the range, and brings what it averages nearer: means of exp(-d^2 / 2 s^2) and of d times that, over normal d.
    """
    if p["strength_dn"] == 0:
        return plane
    reach = DIAMETER_PX // 2
    padded = cv2.copyMakeBorder(plane, reach, reach, reach, reach, cv2.BORDER_REFLECT_101)
    squares = np.float32(p["strength_dn"] ** 2) + np.float32(MEAN_WIDENS) * np.square(noise_dn, dtype=np.float32)
    share = np.broadcast_to(np.float32(p["strength_dn"] ** 2) / squares, plane.shape)
    changes = cv2.dilate(_bends(padded), WINDOW)[reach:-reach, reach:-reach]
    return _averaged(padded, changes, near(p), share, np.float32(1 / (2 * FLATTER * p["strength_dn"] ** 2)))


def near(p):
    """Return the bilateral filter's weights (DIAMETER_PX, DIAMETER_PX) by place."""
    reach = DIAMETER_PX // 2
    apart = np.arange(-reach, reach + 1) ** 2
    apart = apart[:, None] + apart
    return np.where(apart <= reach**2, np.exp(-apart / (2 * p["reach_px"] ** 2)), 0).astype(np.float32)


@njit(cache=True, nogil=True, fastmath=True)
def _bends(image):
    """Return 1 where levels (rows, columns) are no slope, along any of four lines, to ``STRAIGHT_DN``: uint8."""
    bends = np.zeros(image.shape, np.uint8)
    for r in range(1, image.shape[0] - 1):
        above, own, below = image[r - 1], image[r], image[r + 1]
        for c in range(1, image.shape[1] - 1):
            twice = own[c] + own[c]
            upright = max(abs(own[c - 1] + own[c + 1] - twice), abs(above[c] + below[c] - twice))
            slanted = max(abs(above[c - 1] + below[c + 1] - twice), abs(above[c + 1] + below[c - 1] - twice))
            bends[r, c] = max(upright, slanted) > STRAIGHT_DN
    return bends


@njit(cache=True, nogil=True, fastmath=True)
def _averaged(padded, changes, near, share, steepness):
    """Return the mean of each pixel's neighbours, weighted by ``near`` and their levels: OpenCV's filter, in half its time.

    ``changes`` is 0 where a pixel keeps its level: on a slope its neighbours' differences are nil together. share
    (rows, columns) of the range's square in what noise makes of it.
    """
    middle = len(near) // 2
    rows, columns = share.shape
    out = np.ascontiguousarray(padded[middle : middle + rows, middle : middle + columns])
    change, weight, steep = np.empty(columns, np.float32), np.empty(columns, np.float32), np.empty(columns, np.float32)
    for r in range(rows):
        end = 0
        while True:
            start = end
            while start < columns and not changes[r, start]:
                start += 1
            if start == columns:
                break
            end = start
            while end < columns and changes[r, end]:
                end += 1
            count = end - start
            change[:count], weight[:count] = 0, 0
            for c in range(count):  # a slice takes numba seconds to compile
                steep[c] = steepness * share[r, start + c]
            for i in range(middle + 1):
                for j in range(1, middle + 1):
                    if near[middle + i, middle + j] == 0:
                        continue
                    y, x = r + middle, start + middle
                    _add_four(
                        out[r, start:end],
                        padded[y + i, x + j : x + j + count],
                        padded[y + j, x - i : x - i + count],
                        padded[y - i, x - j : x - j + count],
                        padded[y - j, x + i : x + i + count],
                        near[middle + i, middle + j],
                        steep,
                        weight,
                        change,
                    )
            for c in range(count):
                fewer = np.sqrt(share[r, start + c])
                out[r, start + c] += share[r, start + c] * fewer * change[c] / (np.float32(1) + fewer * weight[c])
    return out


@njit(cache=True, nogil=True, fastmath=True)
def _add_four(own, first, second, third, fourth, near, steep, weight, change):
    """Add to weights and changes of pixels (n,) what their neighbours a quarter turn apart bring, all of one weight by place."""
    one = np.float32(1)
    for c in range(len(own)):
        d1, d2, d3, d4 = first[c] - own[c], second[c] - own[c], third[c] - own[c], fourth[c] - own[c]
        e1 = steep_exponential(min(d1 * d1 * steep[c], one))
        e2 = steep_exponential(min(d2 * d2 * steep[c], one))
        e3 = steep_exponential(min(d3 * d3 * steep[c], one))
        e4 = steep_exponential(min(d4 * d4 * steep[c], one))
        weight[c] += near * ((e1 + e2) + (e3 + e4))
        change[c] += near * ((e1 * d1 + e2 * d2) + (e3 * d3 + e4 * d4))


def reach_px(p):
    """Return how far ``apply`` looks."""
    return max(DIAMETER_PX // 2, gaussian_reach_px(p["average_px"]))


def median(plane, p, noise_dn=0.0):
    """Return a channel's median, over the narrow window, the wide one or mixed: its mean where it has noise."""
    narrow = mean_of_median(plane, MEDIAN_PX, noise_dn)
    return mixed(narrow, p["median_wide"], lambda: mean_of_median(plane, WIDE_MEDIAN_PX, noise_dn))


def average(plane, p):
    """Return a channel's average, Gaussian, over a square or mixed."""
    return mixed(gaussian(plane, p["average_px"]), p["average_square"], lambda: box(plane, p["average_px"]))


def mixed(image, share, other):
    """Return an image of which a share is another one, ``other()``, formed where the share is not nil."""
    return image if share == 0 else image + np.float32(share) * (other() - image)


def apply(image, view, p, rng):
    """Filter each channel; the expected image is the mean of those with noise."""
    if p["strength_dn"] == p["median_share"] == p["average_share"] == 0:
        return image
    planes, noise = [], view.noise_dn if rng is None else 0.0
    for c in range(image.shape[2]):
        plane, its_noise = np.ascontiguousarray(image[..., c]), noise[..., c] if np.ndim(noise) else noise
        smooth = mixed(
            bilateral(plane, p, its_noise), p["median_share"], lambda p1=plane, n=its_noise: median(p1, p, n)
        )
        planes.append(mixed(smooth, p["average_share"], lambda p1=plane: average(p1, p)))
    return np.stack(planes, axis=-1)


def noise_kernel(p, noise_dn):
    """Return the kernel (odd, odd) that this is to white noise on flat ground.

    A median is an average and some noise of its own; a bilateral filter is the less of an average the more noise there is.
    """
    average, median, wide, square = p["average_share"], p["median_share"], p["median_wide"], p["average_square"]
    edges_kept = (1 - average) * (1 - median) * _bilateral_kernel(p, noise_dn)
    medians = [
        ((1 - average) * median * share, side) for side, share in ((MEDIAN_PX, 1 - wide), (WIDE_MEDIAN_PX, wide))
    ]
    kernel = edges_kept + sum(share * centred(np.full((side, side), side**-2.0), TAPS) for share, side in medians)
    for share, taps in ((1 - square, gaussian_taps(float(p["average_px"]))), (square, box_taps(p["average_px"]))):
        kernel += average * share * centred(np.outer(taps, taps), TAPS)
    own = sum(share**2 * BEYOND_MEAN[side] for share, side in medians)
    return kernel * np.sqrt(1 + own / (kernel**2).sum())


def _bilateral_kernel(p, noise_dn):
    """Return the kernel (TAPS, TAPS) of the bilateral filter to noise on flat ground: its mean slope there, about."""
    kernel = np.zeros((TAPS, TAPS))
    if p["strength_dn"]:
        alike = p["strength_dn"] / np.sqrt(p["strength_dn"] ** 2 + NOISE_WIDENS * noise_dn**2)
        kernel = centred(near(p).astype(float), TAPS)
        kernel[TAPS // 2, TAPS // 2] = 0
        kernel *= alike**3 / (1 + alike * kernel.sum())
    kernel[TAPS // 2, TAPS // 2] = 1 - kernel.sum()
    return kernel
