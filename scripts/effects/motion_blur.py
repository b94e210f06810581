"""Motion blur: the camera moves straight and evenly while the shutter is open.

The image is averaged along the segment (dx, dy), centred: variance length^2 / 12 along it. Source: linear motion point
spread function, e.g. M. M. Sondhi, "Image restoration: the removal of spatially invariant degradations" (1972).
"""

import numpy as np

from effects.base import Parameter
from effects.filters import convolve, spread_points

STAGE, ORDER = "shutter", 20
AFFECTS = "point_spread"
PIECES_PER_PX = 16
PARAMETERS = {
    "dx_px": Parameter(
        unit="px", lower=-40, upper=40, null=0.0, matters=0.4, doc="motion to the right during the exposure"
    ),
    "dy_px": Parameter(
        unit="px", lower=-40, upper=40, null=0.0, matters=0.4, doc="motion downwards during the exposure"
    ),
}
STARTS = ({"dx_px": 2.0}, {"dy_px": 2.0}, {"dx_px": 1.5, "dy_px": 1.5}, {"dx_px": 1.5, "dy_px": -1.5})


def motion_blur_kernel(dx, dy):
    """Return the point spread function (odd, odd) of a straight motion in the image: points along it."""
    length = np.hypot(dx, dy)
    n = 64 + int(PIECES_PER_PX * length)
    t = (np.arange(n) + 0.5) / n - 0.5
    return spread_points(t * dx, t * dy)


def spread(xy, view, p, n):
    """Return (directions (1, 1, 2) px, shares (n, 1)) of the n parts of the exposure, everywhere alike, as far before its middle
    as after it.
    """
    after = (np.arange(n // 2) + 0.5) / n
    return np.array([[[p["dx_px"], p["dy_px"]]]]), np.concatenate([after, -after])[:, None]


def apply(image, view, p, rng):
    """Average along the motion."""
    if p["dx_px"] == 0 and p["dy_px"] == 0:
        return image
    return convolve(image, motion_blur_kernel(p["dx_px"], p["dy_px"]))
