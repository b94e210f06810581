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


def noise_kernel(p, noise_dn):
    """Return the mask (odd, odd): what is added to a pixel and what its blur takes away."""
    taps = gaussian_taps(p["radius_px"])
    kernel = -p["amount"] * np.outer(taps, taps)
    kernel[len(taps) // 2, len(taps) // 2] += 1 + p["amount"]
    return kernel
