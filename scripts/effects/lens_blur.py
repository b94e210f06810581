"""The lens spreads each point alike over the whole image: a Gaussian point spread function, or harder, down to a disc.

Standard deviation sigma_px per axis, of whose square a share ``softness`` is Gaussian: 1 is the usual approximation of an
optical transfer function, 0 a disc of radius 2 sigma. Sources: Burns, "Slanted-edge MTF for digital camera and scanner
analysis" (2000); the thin lens's circle of confusion, e.g. Hecht, "Optics".
"""

import numpy as np

from effects.base import PARTS, Parameter
from effects.filters import gaussian_points, gaussian_reach_px, soft_disc, soft_points

STAGE, ORDER = "lens", 110
AFFECTS = "point_spread"
FINE_PARTS = 36
FINE_PX = 0.5  # of a Gaussian spread, that is drawn by parts
PARAMETERS = {
    "sigma_px": Parameter(
        unit="px", lower=0.0, upper=8.0, null=0.0, matters=0.15, doc="standard deviation of the spread"
    ),
    "softness": Parameter(
        unit="1", lower=0.0, upper=1.0, null=1.0, matters=0.2, doc="Gaussian share of its variance", auxiliary=True
    ),
}
STARTS = ({"sigma_px": 0.7}, {"sigma_px": 2.0})


def parts(p):
    """Return into how many parts a point's light is divided: a disc is drawn whole, of a Gaussian only the finest."""
    return FINE_PARTS if p["softness"] == 1 else PARTS


def spread(xy, view, p, n):
    """Return (directions (1, 2, 2) px, shares (n, 2)) of the n parts of a point's light, everywhere alike.

    Of a Gaussian, enough to keep pixels from showing stripes finer than they are as coarser ones; ``left_to_blur`` is the
    rest. What has a rim is no sum of smaller spreads and drawn whole.
    """
    if p["softness"] == 1:
        return min(p["sigma_px"], FINE_PX) * np.eye(2)[None], gaussian_points(n)
    return p["sigma_px"] * np.eye(2)[None], soft_points(n, p["softness"])


def left_to_blur(p):
    """Return the parameters of what ``spread`` leaves to ``apply``."""
    left = max(p["sigma_px"] ** 2 - FINE_PX**2, 0.0) if p["softness"] == 1 else 0.0
    return {"sigma_px": float(np.sqrt(left)), "softness": 1.0}


def reach_px(p):
    """Return how far ``apply`` looks."""
    return gaussian_reach_px(p["sigma_px"])


def apply(image, view, p, rng):
    """Blur alike everywhere."""
    return soft_disc(p["softness"])(image, p["sigma_px"])
