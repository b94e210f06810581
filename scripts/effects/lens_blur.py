"""The lens spreads each point alike over the whole image: a Gaussian point spread function.

Source: the usual approximation of an optical transfer function, e.g. Burns, "Slanted-edge MTF for digital camera and
scanner analysis" (2000).
"""

import numpy as np

from effects.base import Parameter
from effects.filters import gaussian, gaussian_points

STAGE, ORDER = "lens", 110
AFFECTS = "point_spread"
PARTS = 36
FINE_PX = 0.5  # of the spread that is drawn by parts
PARAMETERS = {
    "sigma_px": Parameter(
        unit="px", lower=0.0, upper=8.0, null=0.0, matters=0.15, doc="standard deviation of the spread"
    )
}
STARTS = ({"sigma_px": 0.7}, {"sigma_px": 2.0})


def spread(xy, view, p, n):
    """Return (directions (1, 2, 2) px, shares (n, 2)) of the n parts of a point's light, everywhere alike.

    Enough of it to keep pixels from showing stripes finer than they are as coarser ones; ``left_to_blur`` is the rest.
    """
    return min(p["sigma_px"], FINE_PX) * np.eye(2)[None], gaussian_points(n)


def left_to_blur(p):
    """Return the parameters of what ``spread`` leaves to ``apply``."""
    return {"sigma_px": float(np.sqrt(max(p["sigma_px"] ** 2 - FINE_PX**2, 0.0)))}


def apply(image, view, p, rng):
    """Blur by a Gaussian."""
    return gaussian(image, p["sigma_px"])
