"""Tangential (decentring) lens distortion: the lens elements are not on one axis.

x' = x + 2 p1 x y + p2 (r^2 + 2 x^2), y' = y + p1 (r^2 + 2 y^2) + 2 p2 x y, normalised. Source: A. E. Conrady (1919),
D. C. Brown, "Decentering distortion of lenses", Photogrammetric Engineering 32 (1966); OpenCV's naming.
"""

import numpy as np

from effects.base import Parameter, to_pixels, to_rays

STAGE, ORDER = "lens", 20
AFFECTS = "geometry"
PARAMETERS = {
    "p1": Parameter(unit="1", lower=-0.2, upper=0.2, null=0.0, matters=0.0005, doc="vertical decentring"),
    "p2": Parameter(unit="1", lower=-0.2, upper=0.2, null=0.0, matters=0.0005, doc="horizontal decentring"),
}


def map_points(xy, view, p, channel):
    """Move points by the decentring term."""
    rays = to_rays(xy, view)
    x, y = rays.T
    r2 = x * x + y * y
    dx = 2 * p["p1"] * x * y + p["p2"] * (r2 + 2 * x * x)
    dy = p["p1"] * (r2 + 2 * y * y) + 2 * p["p2"] * x * y
    return to_pixels(rays + np.stack([dx, dy], axis=1), view)
