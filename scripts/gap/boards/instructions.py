"""What a photographer can be asked for, and where the camera then is: each says by itself what further photographs would be."""

from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np

from rig.geometry import make_pose, transform

FURTHER = 4  # photographs that an instruction stands for
ROLL = make_pose([0.0, 0.0, np.pi / 2], [0.0, 0.0, 0.0])
ASIDE = np.deg2rad(45.0)
FRONTAL = np.diag([1.0, -1.0, -1.0])
CORNER = 0.3  # of the frame's width and height, from its middle


@dataclass(frozen=True)
class Instruction:
    """Words to a photographer, and what is another way in photographs like those that there are: the camera's ``pose``, a
    function (None: as it was), and how many times as long they are exposed. Nothing is: as many more of the same.
    """

    words: str
    pose: Callable | None = None
    exposure: float = 1.0

    def views(self, views, middle):
        """Return some effects.base.View of a board whose middle (3,) is known, from where the instruction has the camera."""
        if self.pose is None:
            return list(views)
        depth_m = float(np.median([transform(v.T_cam_world, middle)[2] for v in views]))
        return [replace(v, T_cam_world=self.pose(v.T_cam_world, k, middle, depth_m, v)) for k, v in enumerate(views)]


def _rolled(T, k, middle, depth_m, view):
    return ROLL @ T


def _looking(R, middle, at_cam):
    """Return T_cam_world with a rotation that has the board's middle at a place in the camera's frame."""
    T = np.eye(4)
    T[:3, :3], T[:3, 3] = R, at_cam - R @ middle
    return T


def _aslant(T, k, middle, depth_m, view):
    axis = [[1.0, 0, 0], [0, 1.0, 0], [-1.0, 0, 0], [0, -1.0, 0]][k % 4]
    R = make_pose(ASIDE * np.array(axis), np.zeros(3))[:3, :3] @ FRONTAL
    return _looking(R, middle, np.array([0.0, 0.0, depth_m]))


def _in_a_corner(T, k, middle, depth_m, view):
    to = CORNER * np.array([[-1, -1], [1, -1], [1, 1], [-1, 1]][k % 4]) * [view.width, view.height]
    ray = [
        (view.width / 2 + to[0] - view.K[0, 2]) / view.K[0, 0],
        (view.height / 2 + to[1] - view.K[1, 2]) / view.K[1, 1],
    ]
    return _looking(T[:3, :3], middle, depth_m * np.array([*ray, 1.0]))


def _at(share):
    def moved(T, k, middle, depth_m, view):
        return _looking(T[:3, :3], middle, share * transform(T, middle))

    return moved


# What is asked for first is easiest
TURNS = (
    Instruction("roll the camera by 90 degrees for some photographs", _rolled),
    Instruction("hold the board at 45 degrees to the camera, turned to each side", _aslant),
)
PLACES = (
    Instruction("bring the board into each corner of the image", _in_a_corner),
    Instruction("halve the distance in some photographs", _at(0.5)),
    Instruction("double the distance in some photographs", _at(2.0)),
)
EXPOSURES = (
    Instruction("expose some photographs for a quarter of the time", exposure=0.25),
    Instruction("expose some photographs for twice the time", exposure=2.0),
)
MORE = Instruction("take twice as many photographs")
