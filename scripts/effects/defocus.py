"""Defocus: what is nearer or farther than the plane in focus is spread over a disc.

Standard deviation (per axis) sigma = blur_px_per_dioptre |1 / z - 1 / focus_m|, z the depth along the optical axis of the
ground plane at the pixel, a disc of radius 2 sigma. Source: thin-lens circle of confusion.
"""

import numpy as np

from effects.base import Parameter
from effects.filters import disc, pixel_grid, varying_blur

STAGE, ORDER = "lens", 120
FARTHEST_M = 50.0
PARAMETERS = {
    "blur_px_per_dioptre": Parameter("px m", 0.0, 10.0, 0.0, (0.6, 1.5), 0.15, "spread per dioptre out of focus"),
    "focus_m": Parameter("m", 0.1, 20.0, 1.0, (0.5, 1.5), 0.05, "depth that is in focus"),
}


def depth_m(view, shape):
    """Return the depth (rows, columns) of the ground plane z = 0 along the optical axis, at most 50 m."""
    x, y = pixel_grid(view, shape)
    R, t = view.T_cam_world[:3, :3], view.T_cam_world[:3, 3]
    normal, height = R[:, 2], -(R[:, 2] @ t)
    # rays (x, y, 1) * z meet the plane where normal . (ray z) = normal . t, i.e. -height
    slope = normal[0] * (x - view.K[0, 2]) / view.K[0, 0] + normal[1] * (y - view.K[1, 2]) / view.K[1, 1] + normal[2]
    with np.errstate(divide="ignore", invalid="ignore"):
        depth = -height / slope
    return np.where((slope < 0) & (depth < FARTHEST_M), depth, FARTHEST_M)


def apply(image, view, p, rng):
    """Blur each pixel by its own disc."""
    depth = np.maximum(depth_m(view, image.shape[:2]), 0.05)
    sigma = p["blur_px_per_dioptre"] * np.abs(1 / depth - 1 / p["focus_m"])
    return varying_blur(image, np.minimum(sigma, 8.0), disc)
