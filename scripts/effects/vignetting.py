"""Vignetting: the image is darker away from its centre.

Factor 1 - a2 r^2 - a4 r^4 - a6 r^6, r in units of half the diagonal. Source: the polynomial ("pa") model of Adobe and
lensfun; cos^4 falloff is near it.
"""

import numpy as np

from effects.base import Parameter
from effects.filters import pixel_grid, squared_radius

STAGE, ORDER = "lens", 140
PARAMETERS = {
    "a2": Parameter("1", -0.5, 1.0, 0.0, (0.0,), 0.01, "loss of light, quadratic part, at the corner"),
    "a4": Parameter("1", -1.5, 1.0, 0.0, (0.0,), 0.03, "loss of light, fourth-order part, at the corner"),
    "a6": Parameter("1", -1.0, 1.0, 0.0, (0.0,), 0.05, "loss of light, sixth-order part, at the corner", 0.3),
}


def apply(image, view, p, rng):
    """Darken by the radius."""
    r2 = squared_radius(*pixel_grid(view, image.shape[:2]), view)
    a2, a4, a6 = (np.float32(p[key]) for key in ("a2", "a4", "a6"))
    return image * np.maximum(1 - r2 * (a2 + r2 * (a4 + r2 * a6)), 0)[..., None]
