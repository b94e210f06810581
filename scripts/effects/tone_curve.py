"""A smooth curve on the encoded values, ends fixed and never falling; before other processing, within it or after it.

v' = v + d(v): d is a natural cubic spline through 0 at black and white and through lift_at_20_pct_dn .. lift_at_90_pct_dn at
tenths of full scale; a knot below all levels that a rig shows would be free to bend the rest. Source: de Boor, "A Practical
Guide to Splines" (1978); as a camera's curve e.g. Grossberg and Nayar, "What is the space of camera response functions?"
(2003), for which a few smooth parts are enough.

Cameras differ in where it stands (e.g. Ramanath et al., "Color image processing pipeline", 2005): before smoothing and
sharpening, between them, or after both.
"""

import functools

import numpy as np

from effects.base import Parameter
from effects.encoding import look_up

STAGE, ORDER = "processing", (20, 35, 45)
AFFECTS = "intensity"
PERCENT = range(20, 100, 10)
PARAMETERS = {
    f"lift_at_{k}_pct_dn": Parameter(
        unit="dn", lower=-100.0, upper=100.0, null=0.0, matters=2.0, doc=f"lift at {k} % of full scale", prior_sd=40.0
    )
    for k in PERCENT
}
LIFTS = tuple(PARAMETERS)
PARAMETERS["place"] = Parameter(
    unit="1",
    lower=0,
    upper=2,
    null=0,
    matters=1,
    doc="0: before denoising and sharpening, 1: between them, 2: after both",
    auxiliary=True,
    discrete=True,
)
STEPS = 4096


@functools.cache
def _waves():
    """Return d(v) of each knot lifted by one (STEPS + 1, knots)."""
    knots, v = np.array([0, *PERCENT, 100]) / 100, np.linspace(0, 1, STEPS + 1)
    return natural_spline(knots, np.eye(len(knots))[:, 1:-1], v)


def natural_spline(x, y, v):
    """Return the natural cubic spline through y (n, m) at increasing x (n,), at v (k,) within them: (k, m)."""
    h = np.diff(x)[:, None]
    slope = np.diff(y, axis=0) / h
    A = np.diag(2 * (h[:-1] + h[1:])[:, 0]) + np.diag(h[1:-1, 0], 1) + np.diag(h[1:-1, 0], -1)
    bend = np.zeros_like(y)  # second derivatives at x
    bend[1:-1] = np.linalg.solve(A, 6 * np.diff(slope, axis=0))
    k = np.clip(np.searchsorted(x, v, side="right") - 1, 0, len(x) - 2)
    t, h = (v - x[k])[:, None], h[k]
    linear = slope[k] - h * (2 * bend[k] + bend[k + 1]) / 6
    return y[k] + t * (linear + t * (bend[k] / 2 + t * (bend[k + 1] - bend[k]) / (6 * h)))


def curve(p):
    """Return the grey levels (STEPS + 1,) that encoded values 0..255 become."""
    bent = np.linspace(0, 255, STEPS + 1) + _waves() @ [p[name] for name in LIFTS]
    return np.maximum.accumulate(np.clip(bent, 0, 255))


def apply(image, view, p, rng):
    """Bend the encoded values.

    What an expected image has beyond black and white, it keeps: noise decides, at the end, how much of it is clipped.
    """
    if not any(p[k] for k in LIFTS):
        return image  # not through a table
    bent = look_up(np.ascontiguousarray(image), curve(p).astype(np.float32), 0.0, 255.0)
    is_beyond = rng is None and (image.min(initial=0) < 0 or image.max(initial=255) > 255)
    return bent + (image - np.clip(image, 0, 255)) if is_beyond else bent
