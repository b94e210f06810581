"""White balance is off: red and blue have another gain than green.

Gains act on linear light, as a camera's processing does before its curve. Source: von Kries gains.
"""

import numpy as np

from effects.base import Parameter
from effects.encoding import decode, encode

STAGE, ORDER = "processing", 10
AFFECTS = "intensity"
MAKES_COLOUR = True
OWN_WHERE_OPEN = {"white_balance": ("red_gain", "blue_gain")}
PARAMETERS = {
    "red_gain": Parameter(unit="1", lower=0.3, upper=3.0, null=1.0, matters=0.005, doc="gain of red over green's"),
    "blue_gain": Parameter(unit="1", lower=0.3, upper=3.0, null=1.0, matters=0.005, doc="gain of blue over green's"),
}


def apply(image, view, p, rng):
    """Scale red and blue in linear light."""
    out = image.copy()
    for channel, gain in ((0, p["red_gain"]), (2, p["blue_gain"])):
        if gain != 1:
            out[..., channel] = encode(np.float32(gain) * decode(image[..., channel], view.encoding), view.encoding)
    return out
