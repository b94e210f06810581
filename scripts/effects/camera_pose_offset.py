"""The camera is mounted off its nominal place and direction, the same at every station.

T_cam_world = T_mount T_nominal; turns and steps are in the nominal camera's frame (x right, y down, z forward).
Source: rigid hand-eye offset.
"""

import numpy as np

from effects.base import Parameter
from rig.geometry import make_pose

STAGE, ORDER = "scene", 10
AFFECTS = "geometry"
PARAMETERS = {
    "turn_x_deg": Parameter(
        unit="deg", lower=-20, upper=20, null=0.0, matters=0.1, doc="the scene's turn about the camera's x axis"
    ),
    "turn_y_deg": Parameter(
        unit="deg", lower=-20, upper=20, null=0.0, matters=0.1, doc="the scene's turn about the camera's y axis"
    ),
    "turn_z_deg": Parameter(
        unit="deg", lower=-20, upper=20, null=0.0, matters=0.1, doc="the scene's turn about the camera's z axis"
    ),
    "step_x_m": Parameter(
        unit="m", lower=-0.3, upper=0.3, null=0.0, matters=0.001, doc="the scene's step along the camera's x axis"
    ),
    "step_y_m": Parameter(
        unit="m", lower=-0.3, upper=0.3, null=0.0, matters=0.001, doc="the scene's step along the camera's y axis"
    ),
    "step_z_m": Parameter(
        unit="m", lower=-0.3, upper=0.3, null=0.0, matters=0.001, doc="the scene's step along the camera's z axis"
    ),
}


def change_scene(scene, p):
    """Move the camera's mount."""
    rvec = np.radians([p[f"turn_{a}_deg"] for a in "xyz"])
    return scene.with_(T_cam_mount=make_pose(rvec, [p[f"step_{a}_m"] for a in "xyz"]) @ scene.T_cam_mount)
