"""A smooth displacement of the image that no lens formula describes, the same in every capture (headset passthrough).

A cosine series, u and v from 0 to 1: d(u, v) = sum of a_jk cos(pi j u) cos(pi k v) for x and y, up to j + k = 12, over the
frame and a fifth of it on every side: at its own ends such a series has no slope, which no warp would heed. A prior holds
fine waves smaller than coarse ones, so that the field stays smooth where no plate was seen. Source: Ahmed, Natarajan and
Rao, "Discrete cosine transform" (1974); as bases of smooth warps Ashburner and Friston, "Nonlinear spatial normalization
using basis functions" (1999).
"""

import numpy as np

from effects.base import Parameter

STAGE, ORDER = "processing", 5
AFFECTS = "geometry"
DEGREE = 12
BEYOND = 0.2  # of the frame's sides
WAVES = [(j, k) for j in range(DEGREE + 1) for k in range(DEGREE + 1 - j)]


def _prior_px(j, k):
    """Return the standard deviation of a wave's amplitude, falling with the square of its frequency."""
    return 3.0 / (1 + (j * j + k * k) / 4)


PARAMETERS = {
    f"d{axis}_{j}_{k}": Parameter(
        unit="px",
        lower=-60,
        upper=60,
        null=0.0,
        matters=0.4,
        doc=f"move along {axis}: {j} half waves across, {k} down",
        prior_sd=_prior_px(j, k),
    )
    for axis in "xy"
    for j, k in WAVES
}


def _waves(xy, view):
    """Return the values (n, waves) of all waves at pixels (n, 2)."""
    u, v = (((xy + 0.5) / (view.width, view.height) + BEYOND) / (1 + 2 * BEYOND)).T
    across = np.cos(np.pi * u[:, None] * np.arange(DEGREE + 1))
    down = np.cos(np.pi * v[:, None] * np.arange(DEGREE + 1))
    j, k = np.array(WAVES).T
    return across[:, j] * down[:, k]


def map_points(xy, view, p, channel):
    """Displace points by the series."""
    amplitudes = np.array([p[name] for name in PARAMETERS]).reshape(2, len(WAVES))
    return xy + _waves(xy, view) @ amplitudes.T


def points_by_parameters(xy, view, p, keys):
    """Return the derivatives (n, 2, k) of the points by amplitudes: the waves themselves."""
    waves, out = _waves(xy, view), np.zeros((*xy.shape, len(keys)))
    places = {name: divmod(place, len(WAVES)) for place, name in enumerate(PARAMETERS)}
    for column, key in enumerate(keys):
        axis, wave = places[key]
        out[:, axis, column] = waves[:, wave]
    return out
