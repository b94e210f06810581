"""The poses of the study, evenly spread over six degrees of freedom, and what a marker looks like in one."""

import numpy as np
import pandas as pd
from scipy.stats import qmc

from effects.base import View
from effects.encoding import srgb_encode
from gap.predict.synthesis import Prints, coverages, shade
from id_study.views import LEVELS, NOISE_DN, PLATE_M, study_marker, study_scene
from job import seed_of
from markers.contract import marker_corners_world
from rig.geometry import camera_matrix, make_pose, project

WIDTH_PX, HEIGHT_PX = 640, 480
FOCAL_PX = 554.0  # 60 degrees across
K = camera_matrix(FOCAL_PX, FOCAL_PX, (WIDTH_PX - 1) / 2, (HEIGHT_PX - 1) / 2)
REACH_M = PLATE_M / np.sqrt(2)  # from a plate's middle to its corners
PLACES = ["distance_m", "azimuth_deg", "obliqueness_deg", "roll_deg", "x_px", "y_px"]


def pose_table(count, nearest_m, farthest_m, steepest_deg, seed):
    """Return a table of the poses p0000, p0001...: ``pose`` and PLACES; a longer study begins with those of a shorter one.

    Halton's sequence, scrambled by the seed's name: even in the ratio of distances, in obliqueness (between the line of
    sight and the marker's normal), azimuth (of the camera about the normal, from the marker's x), roll (about the line of
    sight) and in the part of the frame in which the whole plate is seen from a distance.
    """
    rng = np.random.default_rng(seed_of("poses_study", seed, "poses"))
    shares = qmc.Halton(len(PLACES), rng=rng).random(count)
    distance = nearest_m * (farthest_m / nearest_m) ** shares[:, 0]
    place = K[:2, 2] + (2 * shares[:, 4:] - 1) * half_region(distance)
    table = pd.DataFrame(
        {
            "distance_m": distance,
            "azimuth_deg": 360 * shares[:, 1],
            "obliqueness_deg": steepest_deg * shares[:, 2],
            "roll_deg": 360 * shares[:, 3],
            "x_px": place[:, 0],
            "y_px": place[:, 1],
        }
    )
    table.insert(0, "pose", [f"p{k:04d}" for k in range(count)])
    return table


def half_region(distance_m):
    """Return (..., 2) half the sides, pixels, of the part of the frame where a plate's middle may be: the ball about the
    plate is wholly seen from distances (...) of at least 0.3 m, whatever its turn.
    """
    half = np.array([WIDTH_PX, HEIGHT_PX]) / (2 * FOCAL_PX)
    # the ball is as far from a side's plane as its middle; at the frame's corner that takes most of it
    taken = np.sqrt(1 + half**2) * np.sqrt(1 + (half**2).sum()) / half
    return FOCAL_PX * half * (1 - REACH_M / np.asarray(distance_m)[..., None] * taken)


def pose_of(row):
    """Return ``T_cam_marker`` (4 x 4) of a row of pose_table."""
    a, o = np.radians([row.azimuth_deg, row.obliqueness_deg])
    towards = np.array([np.sin(o) * np.cos(a), np.sin(o) * np.sin(a), np.cos(o)])  # from the marker to the camera
    right = np.array([-np.sin(a), np.cos(a), 0])
    looking = np.stack([right, np.cross(-towards, right), -towards])
    ray = np.array([*((np.array([row.x_px, row.y_px]) - K[:2, 2]) / FOCAL_PX), 1])
    ray /= np.linalg.norm(ray)
    roll = make_pose([0, 0, np.radians(row.roll_deg)], np.zeros(3))[:3, :3]
    T = np.eye(4)
    T[:3, :3] = _least_turn(ray) @ roll @ looking
    T[:3, 3] = row.distance_m * ray
    return T


def _least_turn(ray):
    """Return the rotation (3, 3) by the least angle that takes the optical axis to a unit vector (3,)."""
    axis = np.cross([0, 0, 1], ray)
    sine = np.linalg.norm(axis)
    return make_pose(axis / sine * np.arctan2(sine, ray[2]) if sine else axis, np.zeros(3))[:3, :3]


def view_of(row):
    """Return the effects.base.View of a row of pose_table; the marker lies at the world's origin."""
    return View(K, WIDTH_PX, HEIGHT_PX, 0, pose_of(row), "study", row.pose, row.pose)


def true_corners(family, number, row):
    """Return the corners (4, 2), pixels, of a marker's square in a pose."""
    return project(K, pose_of(row), marker_corners_world(study_marker(family, number)))


def scene_of(family, number):
    """Return the effects.base.Scene of one marker before an even grey, without a horizon."""
    return study_scene(family, number).with_(background=LEVELS["ground"])


def expected_levels(scene, view):
    """Return the grey levels (H, W) float32 of a scene in a view, without noise."""
    radiance = shade(scene, view, *coverages(Prints(scene.plates), view))
    levels = np.full(radiance.shape, 255 * srgb_encode(np.float64(scene.ground)), np.float32)
    seen = radiance != scene.ground
    levels[seen] = 255 * srgb_encode(radiance[seen])
    return levels


def study_noise(draw, seed):
    """Return a draw's noise (H, W) float32, grey levels: the same for all poses and families."""
    rng = np.random.default_rng(seed_of("poses_study", seed, draw))
    return np.float32(NOISE_DN) * rng.standard_normal((HEIGHT_PX, WIDTH_PX), np.float32)


def digitised(levels, noise):
    """Return the image (H, W) uint8 of grey levels and their noise."""
    return np.clip(np.rint(levels + noise), 0, 255).astype(np.uint8)
