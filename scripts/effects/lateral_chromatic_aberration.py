"""Lateral chromatic aberration: red and blue are magnified differently from green.

x'_channel = c + ratio_channel (x - c). Source: linear model of lensfun and of Mallon and Whelan, "Calibration and
removal of lateral chromatic aberration in images", Pattern Recognition Letters 28 (2007).
"""

from effects.base import Parameter

STAGE, ORDER = "lens", 30
AFFECTS = "geometry"
CHROMATIC = True
PARAMETERS = {
    "red_ratio": Parameter(
        unit="1", lower=0.95, upper=1.05, null=1.0, matters=0.0003, doc="magnification of red over green's"
    ),
    "blue_ratio": Parameter(
        unit="1", lower=0.95, upper=1.05, null=1.0, matters=0.0003, doc="magnification of blue over green's"
    ),
}


def map_points(xy, view, p, channel):
    """Scale about the principal point by the channel's ratio; green stays."""
    if channel == 1:
        return xy
    c = view.K[:2, 2]
    return c + (p["red_ratio"] if channel == 0 else p["blue_ratio"]) * (xy - c)
