"""Light that is not ambient and even: a near lamp, its glossy reflection on the plates, haze. All at pixel
centres.
"""

import numpy as np


def _centres(dx, dy):
    x = 0.25 * (dx[:-1, :-1] + dx[1:, :-1] + dx[:-1, 1:] + dx[1:, 1:])
    y = 0.25 * (dy[:-1, :-1] + dy[1:, :-1] + dy[:-1, 1:] + dy[1:, 1:])
    return x, y


def ground_hits(dx, dy, rotation, centre):
    """Return world x, y (m; NaN above the horizon) where pixel centres see the ground, and the depth along
    the axis, m.
    """
    x, y = _centres(dx, dy)
    world = [rotation[0, k] * x + rotation[1, k] * y + rotation[2, k] for k in range(3)]
    with np.errstate(divide="ignore", invalid="ignore"):
        depth = np.where(world[2] < -1e-6, -centre[2] / world[2], np.nan)
    return centre[0] + depth * world[0], centre[1] + depth * world[1], depth


def lamp_irradiance(x, y, lamp):
    """Return the light at ground points over that at the rig's centre (0, 1 m): ambient and a point lamp's
    cos / r^2.
    """

    def near(px, py):
        d2 = (px - lamp["x_m"]) ** 2 + (py - lamp["y_m"]) ** 2 + lamp["z_m"] ** 2
        return lamp["z_m"] ** 3 / d2**1.5

    share = lamp["share"]
    return (1 - share + share * near(x, y)) / (1 - share + share * near(0.0, 1.0))


def glossy_radiance(x, y, centre, lamp):
    """Return the radiance a glossy horizontal sheet at (x, y) adds: Blinn's half-vector lobe with Schlick's
    Fresnel.
    """
    light = np.stack([lamp["x_m"] - x, lamp["y_m"] - y, np.full_like(x, lamp["z_m"])])
    eye = np.stack([centre[0] - x, centre[1] - y, np.full_like(x, centre[2])])
    light /= np.linalg.norm(light, axis=0)
    eye /= np.linalg.norm(eye, axis=0)
    half = light + eye
    half /= np.linalg.norm(half, axis=0)
    fresnel = 0.04 + 0.96 * (1 - np.sum(half * eye, axis=0)) ** 5
    return lamp["strength"] * fresnel / 0.04 * half[2] ** lamp["exponent"]


def shade(radiance, cover, dx, dy, rotation, centre, effects):
    """Return ``radiance`` under the campaign's light; ``cover`` is the plates' share of each pixel."""
    names = {"illumination_gradient", "specular_highlight", "haze"} & effects.keys()
    if not names:
        return radiance
    x, y, depth = ground_hits(dx, dy, rotation, centre)
    seen = np.isfinite(depth)
    if lamp := effects.get("illumination_gradient"):
        radiance = radiance * np.where(seen, lamp_irradiance(x, y, lamp), 1.0)
    if lamp := effects.get("specular_highlight"):
        radiance = radiance + np.where(seen & (cover > 0), cover * glossy_radiance(x, y, centre, lamp), 0.0)
    if air := effects.get("haze"):
        clear = np.where(seen, np.exp(-air["per_m"] * depth), 0.0)
        radiance = radiance * clear + air["airlight"] * (1 - clear)
    return radiance.astype(np.float32)
