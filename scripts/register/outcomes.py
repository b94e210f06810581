"""What registering one capture comes to: (status, n_markers, rms_px, T_cam_world, standard errors of the pose)."""

import numpy as np

from register.boards import MIN_POINTS
from register.registration import NO_PRIOR, ideal_lens, pose_from_markers, pose_from_plane, register_pose
from rig.geometry import project


def not_registered(nominal):
    """Return the outcome of a capture without a detectable marker: the nominal pose, where there is one."""
    return "no_markers", 0, np.nan, nominal, np.full(6, np.nan)


def register_markers(seen, K, nominal, sigma, lens=ideal_lens):
    """Return (status, n_markers, rms_px, T_cam_world, se) of one capture's Markers, behind a ``registration.lens_of``.

    A marker whose corners lie more than its own side from where the pose has them is a wrong id and is left out.
    """
    start = nominal
    if nominal is None and len(seen):
        start, sigma = pose_from_markers(seen.world, seen.pixels, K, seen.sides_m), NO_PRIOR
    if start is None or not len(seen):
        return not_registered(nominal)
    while len(seen):
        T, se, rms = register_pose(seen.world.reshape(-1, 3), seen.pixels.reshape(-1, 2), K, start, sigma, lens)
        off_px = np.nan_to_num(
            np.linalg.norm(lens(project(K, T, seen.world), T) - seen.pixels, axis=-1), nan=np.inf
        ).mean(1)
        side_px = np.linalg.norm(seen.pixels - np.roll(seen.pixels, 1, axis=1), axis=-1).max(1)
        wrong = off_px > side_px
        if not wrong.any():
            return "registered", len(seen), rms, T, se
        wrong &= off_px / side_px == (off_px / side_px).max()  # one at a time: it may have pulled the others off
        seen = seen.select(~wrong)
    return not_registered(nominal)


def register_board(points, K, nominal, sigma, lens=ideal_lens):
    """Return (status, n_markers, rms_px, T_cam_world, se) of one capture's BoardPoints; a chessboard's points count."""
    if len(points.image) < MIN_POINTS:
        return not_registered(nominal)
    start = nominal
    if nominal is None:
        start, sigma = pose_from_plane(points.board, points.image, K), NO_PRIOR
    T, se, rms = register_pose(points.board, points.image, K, start, sigma, lens)
    return "registered", points.markers or len(points.image), rms, T, se
