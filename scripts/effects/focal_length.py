"""The focal length is not the nominal one: the image is scaled about the principal point.

x' = c + ratio (x - c). Source: pinhole camera model.
"""

from effects.base import Parameter

STAGE, ORDER = "lens", 50
AFFECTS = "geometry"
PARAMETERS = {
    "ratio": Parameter(
        unit="1", lower=0.5, upper=2.0, null=1.0, matters=0.001, doc="true focal length over the nominal one"
    )
}


def map_points(xy, view, p, channel):
    """Scale about the principal point."""
    c = view.K[:2, 2]
    return c + p["ratio"] * (xy - c)
