"""Views and small images that the effects' tests share."""

import numpy as np

from effects import library
from effects.base import Scene, View
from inputs.tables import MARKERS
from markers.contract import marker_plate
from rig.geometry import camera_matrix, station_pose

WIDTH, HEIGHT, MARGIN = 200, 140, 40
# One setting of each effect, well off its null, that this small view can show
STRONG = {
    "radial_distortion": {"k1": -0.25, "k2": 0.1, "k3": 0.02},
    "tangential_distortion": {"p1": 0.01, "p2": -0.012},
    "focal_length": {"ratio": 1.05},
    "pixel_aspect": {"ratio": 1.04},
    "principal_point": {"dx_px": 3.3, "dy_px": -2.7},
    "lateral_chromatic_aberration": {"red_ratio": 1.01, "blue_ratio": 0.992},
    "rolling_shutter": {"skew_x": 0.04, "skew_y": -0.03, "pan_x": 0.02, "slide_m": 0.01},
    "local_warp": {"dx_0_3": 4.0, "dy_2_1": -5.0, "dx_5_2": 1.5},
}


def view(encoding="srgb", width=WIDTH, height=HEIGHT, margin=MARGIN, f=190.0, noise_dn=0.0):
    """Return a View looking 45 degrees down from 0.5 m."""
    K = camera_matrix(f, f, (width - 1) / 2 + 1.5, (height - 1) / 2 - 2.5)
    return View(K, width, height, margin, station_pose(0.5, 45), "cam", "cap", "sta", 1.0, encoding, noise_dn)


def scene():
    """Return a Scene of three markers along y."""
    import pandas as pd

    rows = [["DICT_5X5_1000", i, 0.07, 0.09, 0.01 * i, 0.4 + 0.3 * i, 0, 0, 0, 0] for i in range(3)]
    table = pd.DataFrame(rows, columns=list(MARKERS.columns))
    return Scene(tuple(marker_plate(m) for m in table.itertuples()), 0.8, 0.05, 0.3, 0.5)


def parameters(name, **values):
    """Return an effect's null parameters with some changed."""
    return library.nulls_of(name) | values


def noise_image(channels, v, seed=0, high=255.0):
    """Return a float32 image with margin of random levels, slightly beyond 0..high."""
    rng = np.random.default_rng(seed)
    shape = (v.height + 2 * v.margin, v.width + 2 * v.margin, channels)
    return rng.uniform(-0.02 * high, 1.02 * high, shape).astype(np.float32)
