"""The exposure is not the nominal one: all light is scaled, and what exceeds full scale is clipped (at the encoding).

Source: EMVA 1288, linear camera model with saturation.
"""

import numpy as np

from effects.base import Parameter

STAGE, ORDER = "sensor", 10
AFFECTS = "intensity"
OWN_WHERE_OPEN = {"exposure": ("scale",)}
SHARED_WHERE_OPEN = ("reflectance",)  # both are told against the ground, which keeps its own
PARAMETERS = {
    "scale": Parameter(
        unit="1", lower=0.1, upper=10.0, null=1.0, matters=0.01, doc="true exposure over the nominal one"
    )
}


def apply(image, view, p, rng):
    """Scale all light."""
    return image * np.float32(p["scale"])
