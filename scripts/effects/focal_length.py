"""The focal length is not the nominal one: the image is scaled about the principal point.

x' = c + ratio (x - c). Source: pinhole camera model.
"""

from effects.base import Parameter

STAGE, ORDER = "lens", 50
PARAMETERS = {"ratio": Parameter("1", 0.5, 2.0, 1.0, (1.0,), 0.001, "true focal length over the nominal one")}


def map_points(xy, view, p, channel):
    """Scale about the principal point."""
    c = view.K[:2, 2]
    return c + p["ratio"] * (xy - c)
