"""A smooth curve on the encoded values, ends fixed and never falling.

v' = s + contrast s (1 - s)(2 s - 1) + toe b(s) + shoulder b(1 - s) at s = v^gamma, b(s) = s (1 - s)^4 / 0.08192: gamma
brightens or darkens the middle, contrast is an S, toe and shoulder are bumps with their tops at 1/5 and 4/5.
Source: the power, sigmoid and toe curves of raw converters.
"""

import numpy as np

from effects.base import Parameter

STAGE, ORDER = "processing", 20
PARAMETERS = {
    "gamma": Parameter("1", 0.3, 3.0, 1.0, (1.0,), 0.01, "exponent of encoded values"),
    "contrast": Parameter("1", -1.8, 1.5, 0.0, (0.0,), 0.03, "strength of the S"),
    "toe_dn": Parameter("dn", -60.0, 60.0, 0.0, (0.0,), 2.0, "lift of the shadows, at a fifth of full scale"),
    "shoulder_dn": Parameter("dn", -60.0, 60.0, 0.0, (0.0,), 2.0, "lift of the lights, at four fifths"),
}
STEPS = 4096


def curve(p):
    """Return the grey levels (STEPS + 1,) that encoded values 0..255 become."""
    s = np.linspace(0, 1, STEPS + 1) ** p["gamma"]
    bent = s + p["contrast"] * s * (1 - s) * (2 * s - 1)
    bent += (p["toe_dn"] * s * (1 - s) ** 4 + p["shoulder_dn"] * (1 - s) * s**4) / (0.08192 * 255)
    return 255 * np.maximum.accumulate(np.clip(bent, 0, 1))


def apply(image, view, p, rng):
    """Bend the encoded values."""
    if all(p[k] == q.null for k, q in PARAMETERS.items()):
        return image  # not through a table
    at = np.clip(image, 0, 255) * np.float32(STEPS / 255)
    table = curve(p).astype(np.float32)
    low = np.minimum(at.astype(np.int32), STEPS - 1)
    return table[low] + (at - low.astype(np.float32)) * (table[low + 1] - table[low])
