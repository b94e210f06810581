"""Vignetting: the image is darker away from its centre.

Factor 1 - a2 r^2 - a4 r^4, r in units of half the diagonal. Source: the polynomial ("pa") model of Adobe and lensfun;
cos^4 falloff is a case of it.
"""

import numpy as np

from effects.base import Parameter
from effects.filters import pixel_grid, squared_radius

STAGE, ORDER = "lens", 140
PARAMETERS = {
    "a2": Parameter("1", -0.5, 1.0, 0.0, (0.0,), 0.01, "loss of light, quadratic part, at the corner"),
    "a4": Parameter("1", -0.8, 0.8, 0.0, (0.0,), 0.01, "loss of light, fourth-order part, at the corner"),
}


def apply(image, view, p, rng):
    """Darken by the radius."""
    r2 = squared_radius(*pixel_grid(view, image.shape[:2]), view)
    return image * np.maximum(1 - r2 * (np.float32(p["a2"]) + np.float32(p["a4"]) * r2), 0)[..., None]
