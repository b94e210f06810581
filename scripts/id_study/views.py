"""The views that all ids go through, and what a marker looks like in one: the ideal twin's image and its declared noise."""

from types import SimpleNamespace

import numpy as np

from effects.base import Scene, View
from effects.encoding import srgb_encode
from gap.predict.synthesis import Prints, coverages, shade
from job import seed_of
from markers.contract import least_plate, marker_corners_world, marker_plate
from rig.geometry import camera_matrix, invert_pose, project

SIZE_PX, FOCAL_PX = 160, 800.0  # of the square frame
PRINT_M, PLATE_M = 0.07, 0.1  # sides of what is printed and of the plate, as on the paper's rig
SMALLEST_PX, LARGEST_PX = 14.0, 72.0  # side of the print, seen from straight above
STEEPEST_DEG = 70.0  # between the line of sight and the plate's normal
LEVELS = {"white": 0.8, "black": 0.05, "ground": 0.35, "background": 0.3}
NOISE_DN = 1.0
GOLDEN = 1.1673039782614187  # x^5 = x + 1: the most even steps in four dimensions (Roberts 2018)


def study_views(count):
    """Return effects.base.Views, evenly spread over size (by ratio), incidence, azimuth and roll: the first of one sequence.

    The plate lies at the world's origin, the camera looks at it.
    """
    steps = GOLDEN ** -np.arange(1.0, 5.0)
    shares = (0.5 + np.arange(count)[:, None] * steps) % 1
    return [_view(k, *share) for k, share in enumerate(shares)]


def _view(number, size, tilt, azimuth, roll):
    side_px = SMALLEST_PX * (LARGEST_PX / SMALLEST_PX) ** size
    tilt, azimuth, roll = np.radians(STEEPEST_DEG) * tilt, 2 * np.pi * azimuth, 2 * np.pi * roll
    distance = FOCAL_PX * PRINT_M / side_px
    back = np.array([np.sin(tilt) * np.cos(azimuth), np.sin(tilt) * np.sin(azimuth), np.cos(tilt)])
    right = np.array([-np.sin(azimuth), np.cos(azimuth), 0])
    down = np.cross(-back, right)
    T_world_cam = np.eye(4)
    T_world_cam[:3, :3] = np.stack([right, down, -back], axis=1) @ _about_z(roll)
    T_world_cam[:3, 3] = distance * back
    # the plate's place among the pixels differs from view to view
    centre = (SIZE_PX - 1) / 2 + np.array([number * 0.618 % 1, number * 0.382 % 1])
    K = camera_matrix(FOCAL_PX, FOCAL_PX, *centre)
    return View(K, SIZE_PX, SIZE_PX, 0, invert_pose(T_world_cam), "study", f"view{number:02d}", f"view{number:02d}")


def _about_z(angle):
    s, c = np.sin(angle), np.cos(angle)
    return np.array([[c, -s, 0], [s, c, 0], [0, 0, 1]])


def study_marker(family, number):
    """Return the row of the markers' table of an id in the study: as large a print as any other family's."""
    code_m = PRINT_M / least_plate(family, number)
    place = dict.fromkeys(("x", "y", "z", "rx", "ry", "rz"), 0.0)
    return SimpleNamespace(dictionary=family, id=number, code_m=code_m, plate_m=PLATE_M, **place)


def study_scene(family, number):
    """Return the effects.base.Scene of one marker."""
    return Scene((marker_plate(study_marker(family, number)),), **LEVELS)


def study_noise(view, seed):
    """Return a view's noise (H, W), grey levels: the same for all ids, so that only their codes differ."""
    rng = np.random.default_rng(seed_of("id_study", seed, view.capture))
    return rng.normal(0, NOISE_DN, (view.height, view.width))


def study_image(scene, view, noise):
    """Return the image (H, W) uint8 of a scene in a view."""
    radiance = shade(scene, view, *coverages(Prints(scene.plates), view))
    return np.clip(np.rint(255 * srgb_encode(radiance) + noise), 0, 255).astype(np.uint8)


def place_of(family, number, view):
    """Return (centre (2,), half the mean side) of a marker's square in a view, pixels."""
    marker = study_marker(family, number)
    corners = project(view.K, view.T_cam_world, marker_corners_world(marker))
    side = np.linalg.norm(corners - np.roll(corners, 1, axis=0), axis=1).mean()
    return project(view.K, view.T_cam_world, np.zeros(3)), side / 2
