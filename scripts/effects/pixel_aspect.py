"""Pixels are not square: the image is higher or lower than its width says, about the principal point.

y' = c + ratio (y - c). Source: pinhole camera model with two focal lengths, ratio = fy / fx; sensors that skip or scale lines.
"""

import numpy as np

from effects.base import Parameter

STAGE, ORDER = "lens", 55
AFFECTS = "geometry"
ONLY_BOARDS = True
PARAMETERS = {
    "ratio": Parameter(
        unit="1", lower=0.7, upper=1.4, null=1.0, matters=0.001, doc="focal length in rows over that in columns"
    )
}


def map_points(xy, view, p, channel):
    """Scale rows about the principal point."""
    c = view.K[1, 2]
    return np.stack([xy[..., 0], xy[..., 1] + (p["ratio"] - 1) * (xy[..., 1] - c)], axis=-1)
