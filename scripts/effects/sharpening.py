"""Sharpening: unsharp masking of the encoded image.

v' = v + amount (v - blur(v)), a Gaussian of radius_px. Source: unsharp masking as in every image signal processor.
"""

import numpy as np

from effects.base import Parameter
from effects.filters import gaussian, gaussian_reach_px, gaussian_taps

STAGE, ORDER = "processing", 40
AFFECTS = "intensity"
PARAMETERS = {
    "amount": Parameter(unit="1", lower=0.0, upper=5.0, null=0.0, matters=0.05, doc="strength"),
    "radius_px": Parameter(
        unit="px",
        lower=0.4,
        upper=6.0,
        null=1.0,
        matters=0.3,
        doc="standard deviation of the blurred copy",
        auxiliary=True,
    ),
}
STARTS = ({"amount": 0.5}, {"amount": 0.5, "radius_px": 2.0})


def reach_px(p):
    """Return how far ``apply`` looks."""
    return gaussian_reach_px(p["radius_px"])


def apply(image, view, p, rng):
    """Add what a blur takes away."""
    return image + np.float32(p["amount"]) * (image - gaussian(image, p["radius_px"]))


def noise_gain(p):
    """Return by what white noise grows: the root of the summed squares of the mask."""
    taps = gaussian_taps(p["radius_px"])
    middle, squares = taps.max() ** 2, (taps**2).sum() ** 2
    return np.sqrt((1 + p["amount"]) ** 2 - 2 * p["amount"] * (1 + p["amount"]) * middle + p["amount"] ** 2 * squares)
