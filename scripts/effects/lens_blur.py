"""The lens spreads each point alike over the whole image: a Gaussian point spread function, or harder, down to a disc.

Standard deviation sigma_px per axis, of whose square a share ``softness`` is Gaussian: 1 is the usual approximation of an
optical transfer function, 0 a disc of radius 2 sigma. Sources: Burns, "Slanted-edge MTF for digital camera and scanner
analysis" (2000); the thin lens's circle of confusion, e.g. Hecht, "Optics".
"""

import numpy as np

from effects.base import Parameter
from effects.filters import gaussian_reach_px, soft_disc, soft_points

STAGE, ORDER = "lens", 110
AFFECTS = "point_spread"
FINE_PX = 0.5  # of a Gaussian spread, that is drawn by parts: without it pixels show stripes finer than they are
PARAMETERS = {
    "sigma_px": Parameter(
        unit="px", lower=0.0, upper=8.0, null=0.0, matters=0.15, doc="standard deviation of the spread"
    ),
    "softness": Parameter(
        unit="1", lower=0.0, upper=1.0, null=1.0, matters=0.2, doc="Gaussian share of its variance", auxiliary=True
    ),
}
STARTS = ({"sigma_px": 0.7}, {"sigma_px": 2.0})


def spread(xy, view, p, n):
    """Return (directions (1, 2, 2) px, shares (n, 2)) of the n parts of a point's light, everywhere alike.

    A disc is drawn whole (what has a rim is no sum of smaller spreads), of a Gaussian the finest; ``left_to_blur`` is the rest.
    """
    disc, fine, _ = variances_px2(p)
    return np.sqrt(disc + fine) * np.eye(2)[None], soft_points(n, fine / (disc + fine) if disc else 1.0)


def variances_px2(p):
    """Return the variances per axis, squared pixels, of the disc, of the Gaussian drawn with it and of the rest of that."""
    gaussian = p["softness"] * p["sigma_px"] ** 2
    fine = min(gaussian, FINE_PX**2)
    return (1 - p["softness"]) * p["sigma_px"] ** 2, fine, gaussian - fine


def left_to_blur(p):
    """Return the parameters of what ``spread`` leaves to ``apply``."""
    return {"sigma_px": float(np.sqrt(variances_px2(p)[2])), "softness": 1.0}


def reach_px(p):
    """Return how far ``apply`` looks."""
    return gaussian_reach_px(p["sigma_px"])


def apply(image, view, p, rng):
    """Blur alike everywhere."""
    return soft_disc(p["softness"])(image, p["sigma_px"])
