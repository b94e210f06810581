"""Field curvature: the sharp surface is curved, so that the spread grows with the image radius.

sigma = sigma_corner_px (r / r_corner)^2, Gaussian. Source: Petzval curvature, third-order (Seidel) aberrations.
"""

from effects.base import Parameter
from effects.filters import relative_radius, varying_blur

STAGE, ORDER = "lens", 130
PARAMETERS = {
    "sigma_corner_px": Parameter(
        "px", 0.0, 8.0, 0.0, (1.0, 3.0), 0.3, "standard deviation of the spread in the corners"
    )
}


def apply(image, view, p, rng):
    """Blur by a Gaussian that grows with the square of the radius."""
    return varying_blur(image, p["sigma_corner_px"] * relative_radius(view, image.shape[:2]) ** 2)
