"""Field curvature: the sharp surface is curved, so that the spread grows with the image radius.

sigma = sigma_corner_px (r / r_corner)^2, Gaussian. Source: Petzval curvature, third-order (Seidel) aberrations.
"""

import numpy as np

from effects.base import Parameter
from effects.filters import LEVELS_PX, squared_radius, varying_blur

STAGE, ORDER = "lens", 130
PARAMETERS = {
    "sigma_corner_px": Parameter(
        "px", 0.0, 8.0, 0.0, (1.0, 3.0), 0.3, "standard deviation of the spread in the corners"
    )
}


def apply(image, view, p, rng):
    """Blur by a Gaussian that grows with the square of the radius."""
    sigma = p["sigma_corner_px"] * squared_radius(view, image.shape[:2])
    return varying_blur(image, np.minimum(sigma, np.float32(LEVELS_PX[-1])))
