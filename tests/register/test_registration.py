"""Poses of captures: the prior, wrong ids, unknown poses, the warp between real and twin."""

import numpy as np
import pandas as pd
import pytest

from effects.base import View
from markers.contract import marker_corners_world
from register.boards import BoardPoints
from register.finders import Markers
from register.outcomes import register_board, register_markers
from register.registration import NO_PRIOR, ideal_lens, lens_of, pose_from_markers, prior_of, register_pose
from rig.geometry import camera_matrix, perturb_pose, project, station_pose

K = camera_matrix(600, 600, 399.5, 299.5)
NOMINAL = station_pose(0.5, 35)
DELTA = np.array([0.004, -0.003, 0.002, 0.003, -0.002, 0.004])
TRUE = perturb_pose(NOMINAL, DELTA)
SIGMA = np.array([np.radians(0.3)] * 3 + [0.004] * 3)


def seen(T, places, noise_px=0.1, seed=1):
    """Return the Markers that a perfect camera at T sees, with noise."""
    rows = pd.DataFrame(
        [
            {"dictionary": "DICT_5X5_1000", "id": k, "code_m": 0.07, "plate_m": 0.1, "x": x, "y": y, "z": 0.0}
            | {"rx": 0.0, "ry": 0.0, "rz": 0.3 * k}
            for k, (x, y) in enumerate(places)
        ]
    )
    world = np.array([marker_corners_world(m) for m in rows.itertuples()])
    noise = np.random.default_rng(seed).normal(0, noise_px, (*world.shape[:2], 2))
    return Markers(world, project(K, T, world) + noise, rows.code_m.to_numpy())


PLACES = [(x, y) for x in (-0.2, 0, 0.2) for y in (0.5, 0.8, 1.1)]


def off(T, other):
    """Return how far the optical centres of two poses lie apart, metres."""
    return np.linalg.norm(T[:3, :3].T @ T[:3, 3] - other[:3, :3].T @ other[:3, 3])


def test_many_markers_overrule_the_prior():
    """The registered pose would be the nominal one whatever the photograph shows."""
    status, n, rms, T, se = register_markers(seen(TRUE, PLACES), K, NOMINAL, SIGMA)
    assert (status, n) == ("registered", 9)
    assert off(T, TRUE) < 0.001 < off(NOMINAL, TRUE)
    assert rms < 0.3
    assert np.all(se > 0) and np.all(se < SIGMA)


def test_a_pose_is_found_behind_the_twins_lens():
    """Fails if a lens that a twin has got is left out of its photographs' poses: its board would lie elsewhere than theirs."""
    view = View(K, 800, 600, 0, np.eye(4), "c", "", "")
    bent = [("radial_distortion", {"k1": -0.25, "k2": 0.0, "k3": 0.0}), ("focal_length", {"ratio": 1.15})]
    lens, ideal = lens_of(view, bent), seen(TRUE, PLACES)
    markers = Markers(ideal.world, lens(ideal.pixels, TRUE), ideal.sides_m)
    points = BoardPoints(markers.world.reshape(-1, 3), markers.pixels.reshape(-1, 2), 9)
    for register, of in ((register_markers, markers), (register_board, points)):
        behind, without = (register(of, K, NOMINAL, NO_PRIOR, *given) for given in ((lens,), ()))
        assert behind[1] == 9 and behind[2] < 0.3 < 3 < without[2]
        assert off(behind[3], TRUE) < 0.001 < 0.01 < off(without[3], TRUE)
    assert lens_of(view, [("lens_blur", {"sigma_px": 1.0, "softness": 1.0})]) is ideal_lens


def test_the_prior_pulls_a_weak_capture():
    """One small far marker would throw the pose far beyond what the station's tolerance allows."""
    weak = seen(TRUE, [(0.1, 2.5)], noise_px=0.5)
    points, pixels = weak.world.reshape(-1, 3), weak.pixels.reshape(-1, 2)
    with_prior, se, _ = register_pose(points, pixels, K, NOMINAL, SIGMA)
    without, _, _ = register_pose(points, pixels, K, NOMINAL, NO_PRIOR)
    assert off(with_prior, TRUE) < 3 * 0.004 * np.sqrt(3) < off(without, TRUE)
    assert np.all(se <= SIGMA * 1.001)


def test_a_tolerance_of_zero_keeps_the_station():
    """An exactly known station would be moved."""
    _, _, _, T, _ = register_markers(seen(TRUE, PLACES), K, NOMINAL, prior_of({"position_m": 0, "angle_deg": 0}))
    assert np.abs(T - NOMINAL).max() < 1e-6


@pytest.mark.parametrize("nominal", [NOMINAL, None])
def test_wrong_ids_do_not_move_the_pose(nominal):
    """A false id would drag the whole capture."""
    markers = seen(TRUE, PLACES)
    markers.pixels[4] += [200, -120]
    markers.pixels[7] = markers.pixels[7, [2, 3, 0, 1]] + [-90, 60]
    status, n, rms, T, _ = register_markers(markers, K, nominal, SIGMA)
    assert (status, n) == ("registered", 7)
    assert rms < 0.3 and off(T, TRUE) < 0.002


def test_unknown_pose_is_found_from_one_marker():
    """Hand-held captures would need a nominal pose."""
    one = seen(TRUE, [(0.05, 0.5)], noise_px=0.02)
    T = pose_from_markers(one.world, one.pixels, K, one.sides_m)
    assert off(T, TRUE) < 0.02
    assert register_markers(one, K, None, SIGMA)[0] == "registered"


def test_no_marker_is_a_result():
    """A capture without a marker would crash, or lose its nominal pose."""
    nothing = Markers(np.zeros((0, 4, 3)), np.zeros((0, 4, 2)), np.zeros(0))
    status, n, rms, T, se = register_markers(nothing, K, NOMINAL, SIGMA)
    assert (status, n) == ("no_markers", 0) and np.isnan(rms) and np.isnan(se).all()
    assert T is NOMINAL
    assert register_markers(nothing, K, None, SIGMA)[3] is None


def test_standard_errors_are_those_of_repeats():
    """Stated uncertainties would be unrelated to how the pose scatters."""
    rng = np.random.default_rng(3)
    world = seen(TRUE, PLACES, 0).world.reshape(-1, 3)
    clean = project(K, TRUE, world)
    poses, ses = [], []
    for _ in range(30):
        T, se, _ = register_pose(world, clean + rng.normal(0, 0.8, clean.shape), K, TRUE, NO_PRIOR)
        poses.append((T @ np.linalg.inv(TRUE))[:3, 3])
        ses.append(se[3:])
    ratio = np.std(poses, axis=0) / np.mean(ses, axis=0)
    assert np.all((ratio > 0.65) & (ratio < 1.5)), ratio
