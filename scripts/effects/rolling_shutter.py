"""Rolling shutter: rows are read one after the other while the camera moves.

A row y' is read at a time t that is counted in rows from the middle one. What moves evenly over the image shifts by
x' = x + skew_x t, y' = y + skew_y t. A camera that pans by pan_x t / f (radians, about its vertical axis) turns every ray,
which shifts the image's sides more than its middle. A sliding camera shifts near things more: a share slide_m / z of the
focal length over the whole read-out, z the depth of the ground plane. Source: Meingast, Geyer and Sastry, "Geometric
models of rolling-shutter cameras" (2005).
"""

import numpy as np

from effects.base import Parameter, inverse_depth, to_pixels, to_rays

STAGE, ORDER = "shutter", 10
AFFECTS = "geometry"
PARAMETERS = {
    "skew_x": Parameter(
        unit="px/row",
        lower=-0.3,
        upper=0.3,
        null=0.0,
        matters=0.001,
        doc="shift of the whole image to the right from row to row",
    ),
    "skew_y": Parameter(
        unit="px/row",
        lower=-0.3,
        upper=0.3,
        null=0.0,
        matters=0.001,
        doc="shift of the whole image downwards from row to row",
    ),
    "pan_x": Parameter(
        unit="px/row",
        lower=-0.3,
        upper=0.3,
        null=0.0,
        matters=0.001,
        doc="shift to the right at the middle, camera panning",
    ),
    "slide_m": Parameter(
        unit="m",
        lower=-0.2,
        upper=0.2,
        null=0.0,
        matters=0.0005,
        doc="way of the scene to the right over the whole read-out",
    ),
}


def map_points(xy, view, p, channel):
    """Shift points by the time at which their row is read."""
    t = (xy[:, 1] - (view.height - 1) / 2) / (1 - p["skew_y"])
    shift = np.stack([p["skew_x"] * t, p["skew_y"] * t], axis=1)
    if p["slide_m"] != 0:
        shift[:, 0] += view.K[0, 0] * p["slide_m"] * inverse_depth(*xy.T, view) * t / view.height
    if p["pan_x"] != 0:
        shift += panned(xy, p["pan_x"] * t / view.K[0, 0], view) - xy
    return xy + shift


def panned(xy, angle, view):
    """Return where pixels (n, 2) go when the camera turns about its y axis, its scene to the right, by angles (n,), rad."""
    x, y = to_rays(xy, view).T
    c, s = np.cos(angle), np.sin(angle)
    return to_pixels(np.stack([x * c + s, y], axis=1) / (c - x * s)[:, None], view)
