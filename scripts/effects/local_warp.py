"""A smooth displacement of the image that no lens formula describes, the same in every capture (headset passthrough).

A grid of 8 x 6 control points over the frame, uniform cubic B-splines between them; parameters are displacements of the
control points. Source: de Boor, uniform cubic B-splines; free-form deformation of Sederberg and Parry (1986).
"""

import numpy as np

from effects.base import Parameter

STAGE, ORDER = "processing", 5
COLUMNS, ROWS = 8, 6
PARAMETERS = {
    f"d{axis}_{row}{column}": Parameter("px", -60, 60, 0.0, (0.0,), 0.4, f"move of a control point along {axis}", 4.0)
    for axis in "xy"
    for row in range(ROWS)
    for column in range(COLUMNS)
}


def _weights(t, points):
    """Return B-spline weights (n, points) at t (n,) in 0..1 over the frame; held at the ends."""
    u = np.clip(t, 0, 1) * (points - 3)
    k = np.minimum(u.astype(int), points - 4)
    f = u - k
    basis = np.stack([(1 - f) ** 3, 3 * f**3 - 6 * f**2 + 4, -3 * f**3 + 3 * f**2 + 3 * f + 1, f**3], axis=1) / 6
    out = np.zeros((len(t), points))
    for n in range(4):
        out[np.arange(len(t)), k + n] += basis[:, n]
    return out


def map_points(xy, view, p, channel):
    """Displace points by the spline."""
    across = _weights(xy[:, 0] / (view.width - 1), COLUMNS)
    down = _weights(xy[:, 1] / (view.height - 1), ROWS)
    values = np.array([p[k] for k in PARAMETERS]).reshape(2, ROWS, COLUMNS)
    return xy + np.einsum("nr,arc,nc->na", down, values, across)
