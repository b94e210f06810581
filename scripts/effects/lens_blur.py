"""The lens spreads each point alike over the whole image: a Gaussian point spread function.

Source: the usual approximation of an optical transfer function, e.g. Burns, "Slanted-edge MTF for digital camera and
scanner analysis" (2000).
"""

from effects.base import Parameter
from effects.filters import gaussian

STAGE, ORDER = "lens", 110
PARAMETERS = {"sigma_px": Parameter("px", 0.0, 8.0, 0.0, (0.7, 2.0), 0.15, "standard deviation of the spread")}


def apply(image, view, p, rng):
    """Blur by a Gaussian."""
    return gaussian(image, p["sigma_px"])
