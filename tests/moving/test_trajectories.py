"""Trajectories are smooth and seeded, and the truth of a rolling shutter holds row by row."""

from types import SimpleNamespace

import numpy as np
import pytest

from moving.trajectories import look_at, make_trajectory, pose_of, project_rolling, row_delay
from rig.geometry import camera_matrix, project

K = camera_matrix(550, 550, 319.5, 179.5)
ROWS = 360
POINTS = np.array([[x, 0.0, z] for x in (-0.3, 0.0, 0.3) for z in (0.1, 0.3, 0.5)])
VIEW = {"camera_m": [0.0, -1.1, 0.4], "look_at_m": [0.0, 0.0, 0.3]}
MOTIONS = {
    "at_rest": {},
    "hand_held_sway": {"sway_m": 0.01, "turn_deg": 1.0, "fastest_hz": 2.0},
    "pan": {"pan_deg": 40.0},
    "head_turn": {"turn_deg": 25.0, "turn_s": 0.4, "start_s": 0.3, "stay_s": 0.3, "neck_m": 0.1},
    "approach": {"way_m": 0.6},
}


def trajectory(kind, *names):
    return make_trajectory(SimpleNamespace(kind=kind, **VIEW, **MOTIONS[kind]), 2.0, *names)


@pytest.mark.parametrize("kind", MOTIONS)
def test_a_corner_is_seen_in_the_row_in_which_the_camera_stands_where_it_shows_it(kind):
    """Otherwise the truth of a rolling shutter is that of another time than the row's."""
    move = trajectory(kind, "a")
    xy = project_rolling(K, move, 0.45, POINTS, ROWS, 0.02)
    for point, seen in zip(POINTS, xy, strict=True):
        at = move(0.45 + float(row_delay(seen[1], ROWS, 0.02)))
        np.testing.assert_allclose(project(K, at, point), seen, atol=1e-6)


@pytest.mark.parametrize("kind", MOTIONS)
def test_a_global_shutter_is_a_plain_projection(kind):
    move = trajectory(kind, "a")
    np.testing.assert_allclose(
        project_rolling(K, move, 0.45, POINTS, ROWS, 0.0), project(K, move(0.45), POINTS), atol=1e-7
    )


def test_a_pan_to_the_left_leans_what_a_rolling_shutter_shows():
    """Otherwise the sign of the read-out is wrong: rows below are read later, when things have gone on to the right."""
    move = trajectory("pan")
    rolling, still = (project_rolling(K, move, 1.0, POINTS, ROWS, s) for s in (0.02, 0.0))
    below = still[:, 1] > ROWS / 2
    shift = rolling[:, 0] - still[:, 0]
    assert (shift[below] > 0.3).all()
    assert shift[~below].mean() < shift[below].mean()


@pytest.mark.parametrize("kind", MOTIONS)
def test_motion_is_smooth(kind):
    """Otherwise straight lines between the poses of an exposure are not the motion: steps, jumps, corners."""
    move, step = trajectory(kind, "a"), 1e-4
    poses = np.array([move(t) for t in np.arange(0, 2, step)])
    acceleration = np.abs(np.diff(poses, n=2, axis=0)).max() / step**2
    assert acceleration < 60  # a head's turn of 25 degrees in 0.4 s needs 16 rad a second squared, 1.1 m off the origin


def test_random_motion_comes_from_names_alone_and_has_the_spread_that_was_asked_for():
    same, again, other = (trajectory("hand_held_sway", *names) for names in (("a", 1), ("a", 1), ("a", 2)))
    np.testing.assert_array_equal(same(0.7), again(0.7))
    assert np.abs(same(0.7) - other(0.7)).max() > 1e-4
    start = look_at(VIEW["camera_m"], VIEW["look_at_m"])
    moved = np.array([(same(t) @ np.linalg.inv(start))[:3, 3] for t in np.linspace(0, 500, 4000)])
    np.testing.assert_allclose(moved.std(axis=0), 0.01, rtol=0.15)


def test_the_camera_looks_where_it_is_told_to_and_turns_as_it_says():
    T = look_at([1.0, -1.0, 0.5], [0.2, 0.1, 0.3])
    np.testing.assert_allclose(project(K, T, np.array([0.2, 0.1, 0.3])), [319.5, 179.5], atol=1e-9)
    # to the left and up: what was ahead is to the right and below
    ahead = project(K, pose_of(np.zeros(3), 0.1, 0.1, 0.0), np.array([0.0, 1.0, 0.0]))
    assert ahead[0] > 319.5 and ahead[1] > 179.5
