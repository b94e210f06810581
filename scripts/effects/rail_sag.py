"""The rail is bent: the plates leave their plane smoothly along it.

z = slope_m t + bow_m 4 t (1 - t) + wave_m sin(2 pi t), t from 0 at the first plate to 1 at the last along y; plates
tilt with the rail. Source: first terms of a bent beam's shape.
"""

from dataclasses import replace

import numpy as np

from effects.base import Parameter
from rig.geometry import make_pose

STAGE, ORDER = "scene", 30
AFFECTS = "geometry"
SHORTEST_RAIL_M = 0.01
PARAMETERS = {
    "bow_m": Parameter(
        unit="m", lower=-0.2, upper=0.2, null=0.0, matters=0.001, doc="height of the rail's middle over its ends"
    ),
    "slope_m": Parameter(
        unit="m", lower=-0.2, upper=0.2, null=0.0, matters=0.001, doc="height of the far end over the near one"
    ),
    "wave_m": Parameter(
        unit="m", lower=-0.1, upper=0.1, null=0.0, matters=0.001, doc="amplitude of one whole wave along the rail"
    ),
}


def change_scene(scene, p):
    """Lift and tilt every plate."""
    y = np.array([plate.T_world_plate[1, 3] for plate in scene.plates])
    length = float(np.ptp(y))
    if length < SHORTEST_RAIL_M:
        return scene  # one plate, or a row across: no rail to bend
    t = (y - y.min()) / length
    z = p["slope_m"] * t + p["bow_m"] * 4 * t * (1 - t) + p["wave_m"] * np.sin(2 * np.pi * t)
    rise = (p["slope_m"] + p["bow_m"] * 4 * (1 - 2 * t) + p["wave_m"] * 2 * np.pi * np.cos(2 * np.pi * t)) / length
    plates = []
    for plate, lift, slope in zip(scene.plates, z, rise, strict=True):
        T = plate.T_world_plate.copy()
        T[:3, :3] = make_pose([np.arctan(slope), 0, 0], [0, 0, 0])[:3, :3] @ T[:3, :3]
        T[2, 3] += lift
        plates.append(replace(plate, T_world_plate=T))
    return scene.with_(plates=tuple(plates))
