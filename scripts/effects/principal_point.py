"""The principal point is not the nominal one: the image is shifted.

x' = x + (dx, dy). Source: pinhole camera model. Applied after distortion, which is about the optical axis.
"""

import numpy as np

from effects.base import Parameter

STAGE, ORDER = "lens", 60
AFFECTS = "geometry"
PARAMETERS = {
    "dx_px": Parameter(unit="px", lower=-200, upper=200, null=0.0, matters=0.3, doc="shift to the right"),
    "dy_px": Parameter(unit="px", lower=-200, upper=200, null=0.0, matters=0.3, doc="shift downwards"),
}


def map_points(xy, view, p, channel):
    """Shift all points."""
    return xy + np.array([p["dx_px"], p["dy_px"]])
