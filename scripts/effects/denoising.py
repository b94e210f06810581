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
from kernels import njit

STAGE, ORDER = "processing", 30
AFFECTS = "intensity"
DIAMETER_PX = 9  # of the bilateral filter's window: 7 cut off a reach of 1.8 px
MEDIAN_PX, WIDE_MEDIAN_PX = 3, 5
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


def bilateral(plane, p):
    """Return a channel averaged over what is near in place and in level."""
    if p["strength_dn"] == 0:
        return plane
    reach = DIAMETER_PX // 2
    apart = np.arange(-reach, reach + 1) ** 2
    apart = apart[:, None] + apart
    near = np.where(apart <= reach**2, np.exp(-apart / (2 * p["reach_px"] ** 2)), 0).astype(np.float32)
    padded = cv2.copyMakeBorder(plane, reach, reach, reach, reach, cv2.BORDER_REFLECT_101)
    return _averaged(padded, near, np.float32(1 / (2 * FLATTER * p["strength_dn"] ** 2)))


@njit(cache=True, nogil=True, fastmath=True)
def _averaged(padded, near, steepness):
    """Return the mean of each pixel's neighbours, weighted by ``near`` and their levels: OpenCV's filter, in half its time."""
    size = len(near)
    middle, one = size // 2, np.float32(1)
    rows, columns = padded.shape[0] - size + 1, padded.shape[1] - size + 1
    out = np.empty((rows, columns), np.float32)
    change, weight = np.empty(columns, np.float32), np.empty(columns, np.float32)
    for r in range(rows):
        own = padded[r + middle, middle : middle + columns]
        change[:], weight[:] = 0, 0
        for i in range(size):
            for j in range(size):
                if near[i, j] == 0:
                    continue
                other = padded[r + i, j : j + columns]
                for c in range(columns):
                    d = other[c] - own[c]
                    x = min(d * d * steepness, one)
                    e = steep_exponential(x) * near[i, j]
                    weight[c] += e
                    change[c] += e * d
        for c in range(columns):
            out[r, c] = own[c] + change[c] / weight[c]
    return out


def reach_px(p):
    """Return how far ``apply`` looks."""
    return DIAMETER_PX // 2 + gaussian_reach_px(p["average_px"])


def median(plane, p):
    """Return a channel's median, over the narrow window, the wide one or mixed."""
    narrow = cv2.medianBlur(plane, MEDIAN_PX)
    return mixed(narrow, p["median_wide"], lambda: cv2.medianBlur(plane, WIDE_MEDIAN_PX))


def average(plane, p):
    """Return a channel's average, Gaussian, over a square or mixed."""
    return mixed(gaussian(plane, p["average_px"]), p["average_square"], lambda: box(plane, p["average_px"]))


def mixed(image, share, other):
    """Return an image of which a share is another one, ``other()``, formed where the share is not nil."""
    return image if share == 0 else image + np.float32(share) * (other() - image)


def apply(image, view, p, rng):
    """Filter each channel."""
    if p["strength_dn"] == p["median_share"] == p["average_share"] == 0:
        return image
    planes = []
    for plane in (np.ascontiguousarray(image[..., c]) for c in range(image.shape[2])):
        smooth = mixed(bilateral(plane, p), p["median_share"], lambda plane=plane: median(plane, p))
        planes.append(mixed(smooth, p["average_share"], lambda plane=plane: average(plane, p)))
    return np.stack(planes, axis=-1)


def centred(taps):
    """Return odd taps in the middle of TAPS ones."""
    return np.pad(taps, (TAPS - len(taps)) // 2)


def noise_gain(p):
    """Return by what white noise grows in the average: the root of its kernel's summed squares; 1 of what keeps edges."""
    share, square = p["average_share"], p["average_square"]
    if share == 0:
        return 1.0
    smooth, flat = centred(gaussian_taps(float(p["average_px"]))), centred(box_taps(p["average_px"]))
    kernel = share * ((1 - square) * np.outer(smooth, smooth) + square * np.outer(flat, flat))
    kernel[TAPS // 2, TAPS // 2] += 1 - share
    return float(np.sqrt((kernel**2).sum()))
