"""Field curvature: the sharp surface is curved, so that the spread grows with the image radius.

sigma = sigma_corner_px (r / r_corner)^2 per axis, a disc of radius 2 sigma as what is out of focus, or softer, down to a
Gaussian. Source: Petzval curvature, third-order (Seidel) aberrations.
"""

import numpy as np

from effects.base import Parameter
from effects.filters import LEVELS_PX, pixel_grid, soft_disc, soft_points, squared_radius, varying_blur

STAGE, ORDER = "lens", 130
AFFECTS = "point_spread"
PARAMETERS = {
    "sigma_corner_px": Parameter(
        unit="px", lower=0.0, upper=8.0, null=0.0, matters=0.3, doc="standard deviation of the spread in the corners"
    ),
    "softness": Parameter(
        unit="1",
        lower=0.0,
        upper=1.0,
        null=0.0,
        matters=0.2,
        doc="Gaussian share of the disc's variance",
        auxiliary=True,
    ),
}
STARTS = tuple({"sigma_corner_px": sigma, "softness": 0.5} for sigma in (1.0, 3.0))


def spread_px(x, y, view, p):
    """Return the standard deviation of the spread at pixels x, y."""
    return np.minimum(p["sigma_corner_px"] * squared_radius(x, y, view), np.float32(LEVELS_PX[-1]))


def spread(xy, view, p, n):
    """Return (directions (m, 2, 2) px, shares (n, 2)) of the n parts of the light that lands at pixels xy (m, 2)."""
    return spread_px(*xy.T, view, p)[:, None, None] * np.eye(2), soft_points(n, p["softness"])


def apply(image, view, p, rng):
    """Blur each pixel by its own spread."""
    return varying_blur(image, spread_px(*pixel_grid(view, image.shape[:2]), view, p), soft_disc(p["softness"]))
