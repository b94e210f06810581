"""Sharpening: unsharp masking of the encoded image.

v' = v + amount (v - blur(v)), a Gaussian of radius_px. Source: unsharp masking as in every image signal processor.
"""

import numpy as np

from effects.base import Parameter
from effects.filters import gaussian, gaussian_taps

STAGE, ORDER = "processing", 40
PARAMETERS = {
    "amount": Parameter("1", 0.0, 5.0, 0.0, (0.5, 0.5), 0.05, "strength"),
    "radius_px": Parameter(
        "px", 0.4, 6.0, 1.0, (1.0, 2.0), 0.3, "standard deviation of the blurred copy", qualifies=True
    ),
}


def apply(image, view, p, rng):
    """Add what a blur takes away."""
    return image + np.float32(p["amount"]) * (image - gaussian(image, p["radius_px"]))


def noise_gain(p):
    """Return by what white noise grows: the root of the summed squares of the mask."""
    taps = gaussian_taps(p["radius_px"])
    middle, squares = taps.max() ** 2, (taps**2).sum() ** 2
    return np.sqrt((1 + p["amount"]) ** 2 - 2 * p["amount"] * (1 + p["amount"]) * middle + p["amount"] ** 2 * squares)
