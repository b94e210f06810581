"""A smooth curve on the encoded values, ends fixed.

v' = v^gamma + contrast s (1 - s)(2 s - 1) at s = v^gamma: gamma brightens or darkens the middle, contrast is an S.
Source: the power and sigmoid curves of raw converters.
"""

import numpy as np

from effects.base import Parameter

STAGE, ORDER = "processing", 20
PARAMETERS = {
    "gamma": Parameter("1", 0.3, 3.0, 1.0, (1.0,), 0.01, "exponent of encoded values"),
    "contrast": Parameter(
        "1", -1.8, 0.95, 0.0, (0.0,), 0.02, "strength of the S; beyond these bounds the curve would turn back"
    ),
}


def apply(image, view, p, rng):
    """Bend the encoded values."""
    if p["gamma"] == 1 and p["contrast"] == 0:
        return image  # not through a division and a power
    s = np.power(np.clip(image, 0, 255) / np.float32(255), np.float32(p["gamma"]))
    return np.float32(255) * (s + np.float32(p["contrast"]) * s * (1 - s) * (2 * s - 1))
