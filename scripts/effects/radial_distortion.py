"""Radial lens distortion: magnification changes with the distance from the optical axis.

x' = x (1 + k1 r^2 + k2 r^4 + k3 r^6) in normalised coordinates; k1 < 0 is barrel. Source: D. C. Brown, "Close-range
camera calibration", Photogrammetric Engineering 37 (1971); OpenCV's sign and order. Beyond the radius at which the
polynomial turns back it is continued by its tangent, so that points far outside the frame stay outside.
"""

import functools

import numpy as np

from effects.base import Parameter, to_pixels, to_rays

STAGE, ORDER = "lens", 10
AFFECTS = "geometry"
PARAMETERS = {
    "k1": Parameter(unit="1", lower=-1.0, upper=1.0, null=0.0, matters=0.003, doc="second-order coefficient"),
    "k2": Parameter(unit="1", lower=-10.0, upper=10.0, null=0.0, matters=0.003, doc="fourth-order coefficient"),
    "k3": Parameter(unit="1", lower=-30.0, upper=30.0, null=0.0, matters=0.003, doc="sixth-order coefficient"),
}


@functools.lru_cache
def turning_radius(k1, k2, k3):
    """Return the normalised radius at which r (1 + k1 r^2 + ...) stops growing; infinite where it never does."""
    roots = np.roots([7 * k3, 5 * k2, 3 * k1, 1.0])
    real = roots[np.isreal(roots)].real
    positive = real[real > 1e-9]
    return float(np.sqrt(positive.min())) if len(positive) else np.inf


def map_points(xy, view, p, channel):
    """Move points along their radius."""
    rays = to_rays(xy, view)
    r = np.linalg.norm(rays, axis=1, keepdims=True)
    limit = 0.98 * turning_radius(p["k1"], p["k2"], p["k3"])
    inside = np.minimum(r, limit)
    s = inside**2
    bent = inside * (1 + s * (p["k1"] + s * (p["k2"] + s * p["k3"])))
    slope = 1 + s * (3 * p["k1"] + s * (5 * p["k2"] + s * 7 * p["k3"]))
    bent = bent + slope * (r - inside)
    return to_pixels(rays * (bent / np.maximum(r, 1e-12)), view)
