"""Defocus: what is nearer or farther than the plane in focus is spread over a disc.

Standard deviation (per axis) sigma = blur_px_per_dioptre |1 / z - 1 / focus_m|, z the depth of the ground plane at the
pixel along the optical axis, a disc of radius 2 sigma. Source: thin-lens circle of confusion, e.g. Hecht, "Optics".
"""

import numpy as np

from effects.base import Parameter
from effects.filters import LEVELS_PX, disc, pixel_grid, varying_blur

STAGE, ORDER = "lens", 120
NEAREST_M = 0.05
PARAMETERS = {
    "blur_px_per_dioptre": Parameter("px m", 0.0, 10.0, 0.0, (0.6, 1.5), 0.15, "spread per dioptre out of focus"),
    "focus_m": Parameter("m", 0.1, 20.0, 1.0, (0.5, 1.5), 0.05, "depth that is in focus"),
}


def inverse_depth(view, shape):
    """Return 1 / depth (rows, columns), 1/m, of the ground plane z = 0 along the optical axis; 0 above the horizon.

    A plane's inverse depth is linear in pixels: normal . (x, y, 1) = (normal . t) / z.
    """
    x, y = pixel_grid(view, shape)
    R, t = view.T_cam_world[:3, :3], view.T_cam_world[:3, 3]
    normal = (R[:, 2] / (R[:, 2] @ t)).astype(np.float32)
    slope = normal[0] * (x - view.K[0, 2]) / view.K[0, 0] + normal[1] * (y - view.K[1, 2]) / view.K[1, 1] + normal[2]
    return np.clip(slope, 0, 1 / NEAREST_M)


def apply(image, view, p, rng):
    """Blur each pixel by its own disc."""
    if p["blur_px_per_dioptre"] == 0:
        return image
    sigma = p["blur_px_per_dioptre"] * np.abs(inverse_depth(view, image.shape[:2]) - 1 / p["focus_m"])
    return varying_blur(image, np.minimum(sigma, LEVELS_PX[-1]), disc)
