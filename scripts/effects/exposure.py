"""The exposure is not the nominal one: all light is scaled, and what exceeds full scale is clipped (at the encoding).

Source: EMVA 1288, linear camera model with saturation.
"""

import numpy as np

from effects.base import Parameter

STAGE, ORDER = "sensor", 10
PARAMETERS = {"scale": Parameter("1", 0.1, 10.0, 1.0, (1.0,), 0.01, "true exposure over the nominal one")}


def apply(image, view, p, rng):
    """Scale all light."""
    return image * np.float32(p["scale"])
