"""A scene of two plates and its frame of grey levels, drawn by gap.predict.synthesis."""

from types import SimpleNamespace

import numpy as np

from effects.base import Scene, View
from gap.predict.synthesis import Prints, coverages, shade
from markers.contract import marker_plate
from rig.geometry import camera_matrix, station_pose


def plate(**changes):
    values = dict(
        dictionary="DICT_5X5_1000", id=7, code_m=0.07, plate_m=0.1, x=0.0, y=0.6, z=0.0, rx=0.0, ry=0.0, rz=0.3
    )
    return marker_plate(SimpleNamespace(**(values | changes)))


def scene_and_view():
    scene = Scene((plate(), plate(id=8, x=0.15, y=0.8)), 0.8, 0.05, 0.35, 0.3)
    K = camera_matrix(600, 610, 319.5, 239.5)
    return scene, View(K, 640, 480, 12, station_pose(0.5, 35), "c", "a", "s")


def grey_image(scene, view, table, spread=None):
    """Return the frame's grey levels (H, W) of a scene."""
    m = view.margin
    linear = shade(scene, view, *coverages(Prints(scene.plates), view, spread=spread))
    return np.interp(linear, np.linspace(0, 1, len(table)), table)[m:-m, m:-m]
