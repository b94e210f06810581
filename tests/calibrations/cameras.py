"""Cameras that the tests of calibrations share."""

import numpy as np

from calibrations.lens import Calibration
from inputs.twin_sources import CameraTwin
from rig.geometry import camera_matrix

SIZE = (1280, 720)
LENSES = {
    ("opencv", 0): (),
    ("opencv", 4): (-0.21, 0.08, 0.001, -0.0007),
    ("opencv", 5): (-0.21, 0.08, 0.001, -0.0007, -0.013),
    ("opencv", 8): (0.31, 0.06, 0.001, -0.0007, 0.011, 0.52, 0.09, 0.017),
    ("opencv", 12): (0.31, 0.06, 0.001, -0.0007, 0.011, 0.52, 0.09, 0.017, 0.002, -0.001, 0.0015, 0.0004),
    ("opencv", 14): (-0.2, 0.06, 0.001, -0.0007, 0.011, 0.02, 0.01, 0.003, 0.002, -0.001, 0.0015, 0.0004, 0.01, -0.02),
    ("fisheye", 4): (-0.02, 0.008, 0.001, -0.0007),
    ("poly3", 1): (-0.03,),
    ("poly5", 2): (-0.03, 0.01),
    ("ptlens", 3): (0.01, -0.03, 0.02),
}


def camera(lens, count, aspect=1.004):
    """Return a Calibration off the middle of its frame."""
    return Calibration(*SIZE, 901.25, 901.25 * aspect, 633.2, 371.7, lens, LENSES[lens, count])


def rays(n=1000, reach=(0.6, 0.35), seed=1):
    """Return n directions (n, 2), x / z and y / z, over the frame of ``camera``."""
    return np.random.default_rng(seed).uniform(-1, 1, (n, 2)) * reach


def twin(effects, **changes):
    """Return a CameraTwin of a small camera with effects [(name, parameters)]."""
    given = {
        "campaign": "here", "camera": "cam", "K": camera_matrix(190.0, 191.0, 101.0, 68.0), "width": 200,
        "height": 140, "exposure": 1.25, "encoding": "srgb", "noise_dn": 0.7, "effects": effects, "source": "a test",
    }  # fmt: skip
    return CameraTwin(**given | changes)
