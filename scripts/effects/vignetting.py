"""Vignetting: the image is darker away from its centre.

Factor 1 - a2 r^2 - a4 r^4 - a6 r^6, r in units of half the diagonal. Source: the polynomial ("pa") model of Adobe and
lensfun; cos^4 falloff is near it.
"""

import numpy as np

from effects.base import Parameter
from effects.filters import pixel_grid, squared_radius

STAGE, ORDER = "lens", 140
AFFECTS = "intensity"
PARAMETERS = {
    "a2": Parameter(
        unit="1", lower=-0.5, upper=1.0, null=0.0, matters=0.01, doc="loss of light, quadratic part, at the corner"
    ),
    "a4": Parameter(
        unit="1", lower=-1.5, upper=1.0, null=0.0, matters=0.03, doc="loss of light, fourth-order part, at the corner"
    ),
    "a6": Parameter(
        unit="1",
        lower=-1.0,
        upper=1.0,
        null=0.0,
        matters=0.05,
        doc="loss of light, sixth-order part, at the corner",
        prior_sd=0.3,
    ),
}


def apply(image, view, p, rng):
    """Darken by the radius."""
    r2 = squared_radius(*pixel_grid(view, image.shape[:2]), view)
    a2, a4, a6 = (np.float32(p[key]) for key in ("a2", "a4", "a6"))
    return image * np.maximum(1 - r2 * (a2 + r2 * (a4 + r2 * a6)), 0)[..., None]
