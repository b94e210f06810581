"""Photographs taken by hand: what each one's motion does to its rows hides no change, and passes for none."""

import sys
from dataclasses import replace
from pathlib import Path

import cv2
import numpy as np
import pytest

sys.path.insert(0, str(Path(__file__).parent))
import test_board
from test_board import problem_of
from test_changes import FOCAL_PX, NOISE_PX, POINTS, SIZE, compared, names, photographs

from gap.boards.needs import Told
from gap.boards.readout_motion import with_motion
from gap.select.search import Search
from gap.select.select_effects import verdict
from rig.geometry import camera_matrix, make_pose, perturb_pose, transform

TURN_RAD = 0.01  # standard deviation, from the first row to the last: 6 px


def by_hand(problem, seed, turn_rad=TURN_RAD, cx_px=319.5, p1=0.0):
    """Return a BoardCase of ``photographs`` as a camera sees them that turns evenly while it reads rows, points exact."""
    rng, captures = np.random.default_rng([seed, 7]), []
    K, lens = camera_matrix(FOCAL_PX, FOCAL_PX, cx_px, 239.5), np.array([0.0, 0.0, p1, 0.0])
    for capture in problem.captures:
        T, turn = capture.view.T_cam_world, rng.normal(0, turn_rad, 3)
        xy = np.zeros((len(POINTS), 2))
        when = np.zeros(len(POINTS))
        for _ in range(8):  # a point's row says when it is read, and that where it lies
            for k, t in enumerate(when):
                moved = make_pose(t * turn, np.zeros(3)) @ T
                turned, _ = cv2.Rodrigues(moved[:3, :3])
                xy[k] = cv2.projectPoints(POINTS[k], turned, moved[:3, 3], K, lens)[0].ravel()
            when = (xy[:, 1] + 0.5) / SIZE[1] - 0.5
        features = xy + NOISE_PX * rng.standard_normal(xy.shape)
        captures.append(replace(capture, observation=replace(capture.observation, features=features)))
    return replace(problem, captures=captures)


def test_a_change_is_named_though_a_hand_moves_each_photograph():
    """Fails if what rows show of each photograph's own motion is left to scatter: another lens then drowns in it."""
    before, after = photographs(3, 10, k1=0.0), photographs(4, 10, k1=0.0)
    found = compared(by_hand(before, 3), by_hand(after, 4, p1=0.01))
    assert names(found)[:1] == ["tangential_distortion"]


def test_hands_that_move_are_no_change():
    """Fails if photographs that move while they are read pass for another camera than others that do."""
    found = compared(by_hand(photographs(1, 7, k1=0.0), 1), by_hand(photographs(2, 7, k1=0.0), 2))
    assert not found.changes


def equations(turn_rad, seed=0, number=8):
    """Return (BoardCase, equations of its captures by one parameter): residuals of points in units of their noise."""
    problem, rng, out = photographs(seed, number, k1=0.0), np.random.default_rng(seed), {}
    for i, capture in enumerate(problem.captures):
        T, K = capture.view.T_cam_world, capture.view.K

        def seen(T, K=K):
            xyz = transform(T, POINTS) @ K.T
            return xyz[:, :2] / xyz[:, 2:]

        step = 1e-6 * np.eye(6)
        Jp = np.stack([(seen(perturb_pose(T, s)) - seen(T)).ravel() / 1e-6 / NOISE_PX for s in step], axis=1)
        when = np.repeat((capture.observation.features[:, 1] + 0.5) / SIZE[1] - 0.5, 2)
        y = when * (Jp[:, :3] @ rng.normal(0, turn_rad, 3)) + rng.standard_normal(len(Jp))
        prior = np.zeros((6, 6))  # poses are free
        out[i] = np.append(y, np.zeros(6)), np.ones((len(y) + 6, 1)), np.vstack([Jp, prior])
    return problem, out


@pytest.mark.parametrize("turn_rad", [0.001, 0.01])
def test_photographs_say_how_much_they_move(turn_rad):
    """Fails if the prior is that of another motion: too narrow it explains nothing, too wide it explains all."""
    problem, made = equations(turn_rad)
    moved = with_motion(problem, made, 1e6)
    turns = np.concatenate([Jp[:-12, 6] / Jp[:-12, 0] for _, _, Jp in moved.values()])
    rows = np.concatenate([capture.observation.features[:, 1] for capture in problem.captures])
    sigma_rad = turns / np.repeat((rows + 0.5) / SIZE[1] - 0.5, 2)
    assert np.ptp(sigma_rad) < 1e-9
    assert 0.4 * turn_rad < sigma_rad[0] < 1.2 * turn_rad  # turns alone were drawn, half of what is free
    for y, Jt, Jp in moved.values():
        assert len(y) == len(Jt) == len(Jp) == 2 * len(POINTS) + 12
        assert np.array_equal(Jp[-6:], np.eye(6, 12, 6)) and not y[-6:].any() and not Jt[-6:].any()


def test_still_photographs_hardly_move():
    """Fails if noise passes for motion: what is free for nothing costs power."""
    problem, made = equations(0.0)
    moved = with_motion(problem, made, 1e6)
    assert moved is None or max(np.abs(Jp[:96, 6]).max() for _, _, Jp in moved.values()) < 2e-4 * FOCAL_PX / NOISE_PX


def diagnosed(problem):
    """Return (Search, Outcome) of a BoardCase, three effects of the lens competing."""
    search, _, _, outcome = verdict(
        problem, candidates=["radial_distortion", "tangential_distortion", "principal_point"]
    )
    return search, outcome


@pytest.mark.parametrize(("p1", "named"), [(0.0, []), (0.01, ["tangential_distortion"])])
def test_a_lens_is_named_though_a_hand_moves_each_photograph(p1, named):
    """Fails if motion that is another in each photograph leaves the twin unexplained, hides a lens or is taken for one; or if
    photographs are said to move far less or more than they do.
    """
    search, outcome = diagnosed(by_hand(photographs(3, 16, k1=0.0), 3, turn_rad=0.03, p1=p1))
    assert outcome.verdict == ("explained" if named else "adequate")
    assert [step.effect for step in outcome.steps] == named
    assert outcome.twin.gap < 1.15 < 3 < search.problem.gap_at_rest
    assert 0.4 < search.problem.sigma_pose[6] / 0.03 < 1.2  # turns alone were drawn, half of what is free


@pytest.mark.parametrize("bend_px", [0.0, 0.8])
def test_what_a_hand_does_not_explain_is_none_of_its_doing(bend_px):
    """Fails if photographs at rest are said to move, or if another smooth move of each, as of paper, passes for that."""
    search, outcome = diagnosed(problem_of(*test_board.photographs(bend_px=bend_px)))
    assert outcome.verdict == ("unexplained" if bend_px else "adequate")
    assert search.problem.gap_at_rest is None and outcome.twin.poses.shape[1] == 6


def test_how_far_photographs_move_is_known():
    """Fails if what photographs show of an effect is counted as if each could move by any amount: they would tell too little."""
    search, outcome = diagnosed(by_hand(photographs(3, 16, k1=0.0), 3, p1=0.01))
    sigma_pose = search.problem.sigma_pose
    any_motion = replace(search.problem, sigma_pose=np.append(sigma_pose[:6], np.full(6, 10.0)))
    known, free = (
        Told(Search(problem, search.candidates), outcome.twin, ["rolling_shutter", "radial_distortion"])
        for problem in (search.problem, any_motion)
    )
    assert known.seen("rolling_shutter") > 2 * free.seen("rolling_shutter")
    assert known.seen("radial_distortion") > 1.1 * free.seen("radial_distortion")


def test_points_move_with_their_rows():
    """Fails if points move otherwise than a camera that turns evenly shows them, rows by rows, or than derivatives say."""
    still = photographs(2, 1, k1=-0.1)
    exact = by_hand(still, 1)
    turn = np.random.default_rng([1, 7]).normal(0, TURN_RAD, 3)
    moving = replace(still, sigma_pose=np.append(still.sigma_pose, np.ones(6)))
    (capture,), pose = exact.captures, np.concatenate([np.zeros(6), turn, np.zeros(3)])
    shown = moving.corners_of(capture, [], pose)[:, 0]
    off = shown - capture.observation.features
    assert (
        np.sqrt((off**2).mean()) < 1.3 * NOISE_PX < np.abs(shown - still.corners_of(capture, [], pose[:6])[:, 0]).max()
    )
    found = moving.corners_by_pose(capture, [], pose)
    steps = 1e-5 * np.eye(12)
    by_steps = [
        (moving.corners_of(capture, [], pose + s) - moving.corners_of(capture, [], pose - s)) / 2e-5 for s in steps
    ]
    assert np.allclose(found, np.stack(by_steps, axis=-1), atol=0.03 * np.abs(found).max())
