"""Defocus: what is nearer or farther than the plane in focus is spread over a disc, its edge sharp or soft.

Standard deviation (per axis) sigma = blur_px_per_dioptre |1 / z - 1 / focus_m|, z the depth of the ground plane at the
pixel along the optical axis: a disc of radius 2 sigma, the thin lens's circle of confusion (e.g. Hecht, "Optics"), down to
a Gaussian, as which aberrations and diffraction leave it (e.g. Pentland, "A new sense for depth of field", 1987).
"""

import numpy as np

from effects.base import Parameter, inverse_depth
from effects.filters import LEVELS_PX, pixel_grid, soft_disc, soft_points, varying_blur

STAGE, ORDER = "lens", 120
AFFECTS = "point_spread"
NEAREST_M = 0.05
PARAMETERS = {
    "blur_px_per_dioptre": Parameter(
        unit="px m", lower=0.0, upper=10.0, null=0.0, matters=0.15, doc="spread per dioptre out of focus"
    ),
    "focus_m": Parameter(
        unit="m", lower=0.1, upper=20.0, null=1.0, matters=0.05, doc="depth that is in focus", auxiliary=True
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
STARTS = tuple(
    {"blur_px_per_dioptre": blur, "focus_m": focus, "softness": 0.5} for blur, focus in ((0.6, 0.5), (1.5, 1.5))
)


def spread_px(x, y, view, p):
    """Return the standard deviation of the spread at pixels x, y."""
    sigma = p["blur_px_per_dioptre"] * np.abs(np.minimum(inverse_depth(x, y, view), 1 / NEAREST_M) - 1 / p["focus_m"])
    return np.minimum(sigma, LEVELS_PX[-1])


def spread(xy, view, p, n):
    """Return (directions (m, 2, 2) px, shares (n, 2)) of the n parts of the light that lands at pixels xy (m, 2)."""
    return spread_px(*xy.T, view, p)[:, None, None] * np.eye(2), soft_points(n, p["softness"])


def apply(image, view, p, rng):
    """Blur each pixel by its own spread."""
    if p["blur_px_per_dioptre"] == 0:
        return image
    return varying_blur(image, spread_px(*pixel_grid(view, image.shape[:2]), view, p), soft_disc(p["softness"]))
