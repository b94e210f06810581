"""Veiling glare: a share of the image's light is scattered evenly over all of it.

x' = (1 - share) x + share mean(x). Source: ISO 9358, veiling glare index.
"""

import numpy as np

from effects.base import Parameter
from effects.filters import frame_of

STAGE, ORDER = "lens", 150
AFFECTS = "intensity"
PARAMETERS = {
    "share": Parameter(
        unit="1", lower=0.0, upper=0.8, null=0.0, matters=0.004, doc="share of the light that is scattered"
    )
}


def apply(image, view, p, rng):
    """Mix with the frame's mean."""
    mean = image[frame_of(view)].mean(axis=(0, 1), dtype=np.float64).astype(np.float32)
    return np.float32(1 - p["share"]) * image + np.float32(p["share"]) * mean
