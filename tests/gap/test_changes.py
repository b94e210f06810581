"""What has changed between two sets of photographs of a board, drawn by OpenCV's camera, so that what was changed is known."""

import cv2
import numpy as np
import pytest

from effects.base import Scene, View
from gap.boards.board import board_case
from gap.changes import changes as module
from gap.changes.changes import changes
from gap.changes.joined import joined
from gap.changes.permutation import Moments, labellings, p_values
from register.registration import NO_PRIOR
from rig.geometry import camera_matrix, make_pose, perturb_pose

POINTS = np.array([[x, y, 0.0] for y in range(6) for x in range(8)]) * 0.03
FOCAL_PX, SIZE, NOISE_PX = 600.0, (640, 480), 0.1
RIGID = ["focal_length", "principal_point", "radial_distortion", "tangential_distortion"]
OUT_OF_PLACE = np.array([0.02, -0.02, 0.02, 0.002, 0.003, 0.01])  # of poses from which fits start, rad and m


def photographs(seed, number=6, focal_px=FOCAL_PX, k1=-0.1, points=POINTS, wrong=()):
    """Return the BoardCase of a camera with a focal length and k1, poses and noise drawn by a seed; ``wrong`` show nonsense."""
    rng, views, pixels = np.random.default_rng(seed), [], []
    K = camera_matrix(focal_px, focal_px, 319.5, 239.5)
    for k in range(number):
        tilt = rng.uniform(0.2, 0.6, 2) * rng.choice([-1, 1], 2)
        T = make_pose([np.pi + tilt[0], tilt[1], rng.uniform(-0.5, 0.5)], [-0.1, 0.07, rng.uniform(0.35, 0.5)])
        xy = cv2.projectPoints(points, cv2.Rodrigues(T[:3, :3])[0], T[:3, 3], K, np.array([k1, 0.0, 0, 0]))[0][:, 0]
        pixels.append(xy + NOISE_PX * rng.standard_normal(xy.shape) * (100 if k in wrong else 1))
        nominal = camera_matrix(FOCAL_PX, FOCAL_PX, 319.5, 239.5)
        views.append(View(nominal, *SIZE, 0, perturb_pose(T, OUT_OF_PLACE), "c", f"p{k}", f"p{k}"))
    scene = Scene((), 0.8, 0.05, 0.35, 0.3)
    return board_case("drawn", "c", scene, views, [0] * number, POINTS, np.array(pixels), NOISE_PX, False, NO_PRIOR)


def compared(before, after):
    """Return the Changes of which rigid effects alone may be: a free warp takes as long as all others."""
    return changes(before, after, candidates=RIGID)


def names(found):
    """Return the names of the changes."""
    return [c.effect for c in found.changes]


def values(found, effect, key):
    """Return (before, after, standard error of the difference) of a parameter."""
    before, after = (dict(e)[effect][key] for e in found.last.effects)
    return before, after, np.hypot(*(e[effect, key] for e in found.last.errors))


def test_nothing_is_named_where_nothing_has_changed():
    """Fails if other photographs by the same camera pass for another camera, or a second run says something else."""
    first, second = (compared(photographs(1), photographs(2)) for _ in range(2))
    assert first.verdict == "adequate" and not first.changes
    assert [(n, a.p, a.gain) for n, a in first.asked.items()] == [(n, a.p, a.gain) for n, a in second.asked.items()]


def test_another_lens_is_named_with_both_its_values():
    """Fails if the change gets another name, or is not told from how much to how much."""
    found = compared(photographs(1, k1=-0.1), photographs(2, k1=-0.2))
    assert names(found) == ["radial_distortion"] and found.verdict == "explained"
    before, after, error = values(found, "radial_distortion", "k1")
    assert abs(after - before + 0.1) < 4 * error and error < 0.1


def test_less_of_an_effect_is_a_change_too():
    """Fails if only what is added counts: here the distortion goes away."""
    found = compared(photographs(1, k1=-0.2), photographs(2, k1=0.0))
    assert names(found)[0] == "radial_distortion"


def test_another_focus_is_a_change_though_the_focal_length_is_unknown():
    """Fails if the focal length, which is fitted to every twin where intrinsics are unknown, can then not be named."""
    found = compared(photographs(1), photographs(2, focal_px=1.04 * FOCAL_PX))
    assert names(found)[0] == "focal_length"
    before, after, error = values(found, "focal_length", "ratio")
    assert abs(after / before - 1.04) < 4 * error


def test_faults_of_the_print_are_taken_out():
    """Fails if the board's own shape, which both sets show, is left to scatter: what changes then drowns in it."""
    printed = POINTS + np.random.default_rng(3).normal(0, 0.0004, POINTS.shape)
    found = compared(photographs(1, points=printed), photographs(2, points=printed))
    assert not found.changes
    assert found.base.loss < 1.2 * sum(g["corners"].size for g in found.base.groups.values())


def test_a_photograph_with_wrong_corners_is_left_out():
    """Fails if one photograph that shows nonsense counts like the others."""
    found = compared(photographs(1, 8, wrong=(3,)), photographs(2, 8, k1=-0.2))
    assert len(found.captures_of(0)) == 7 and len(found.captures_of(1)) == 8
    assert names(found)[0] == "radial_distortion"


def test_both_sets_have_the_noise_of_the_first():
    """Fails if what another lens does to the estimate of noise makes the later photographs count for nothing."""
    after = photographs(2, k1=-0.2)
    after.noise_px = 30.0
    for capture in after.captures:
        capture.observation.information[:] /= 300**2
    assert names(compared(photographs(1), after))[:1] == ["radial_distortion"]


def test_too_few_photographs_are_refused():
    """Fails if p-values of four photographs, which cannot be small, are given out."""
    with pytest.raises(ValueError, match="4 usable captures before and 6 after; 5 of each are needed"):
        compared(photographs(1, 4), photographs(2))


def test_points_that_one_set_never_shows_are_no_obstacle():
    """Fails if two sets must have seen the very same points: measured points go with their own places."""
    before, after = photographs(1), photographs(2)
    some = np.arange(len(POINTS)) % 5 > 0
    after.points = after.points[some]
    for capture in after.captures:
        o = capture.observation
        for name in ("features", "information", "measured", "colour"):
            setattr(o, name, getattr(o, name)[some])
    problem, belongs = joined(before, after)
    assert len(problem.points) == len(POINTS) and belongs.sum() == 6
    seen = problem.captures[-1].observation
    assert np.array_equal(problem.points[seen.measured], POINTS[some][np.lexsort(POINTS[some].T[::-1])])


def test_labellings_are_all_there_are_or_drawn():
    """Fails if the given division is not the first, one comes twice, or 5 and 5 are not divided in all 252 ways."""
    few = labellings(np.repeat([0, 1], 5), np.random.default_rng(0))
    assert len(few) == len(np.unique(few, axis=0)) == 252 and few[0].tolist() == [0] * 5 + [1] * 5
    many = labellings(np.repeat([0, 1], 12), np.random.default_rng(0))
    assert len(many) == module.labellings(np.repeat([0, 1], 12), np.random.default_rng(0)).shape[0] == 1000
    assert (many.sum(1) == 12).all()


def test_chance_names_as_often_as_it_says():
    """Fails if p-values of scores that differ by chance alone are small more often than they claim."""
    rng, labels = np.random.default_rng(4), labellings(np.repeat([0, 1], 5), np.random.default_rng(0))
    p = []
    for _ in range(200):
        H = np.tile(np.diag([4.0, 1.0, 2.0]), (10, 1, 1))
        g = rng.standard_t(3, (10, 3)) * [2.0, 1.0, 1.4]
        made = Moments(H, g, np.zeros(0))
        evidence = [made.differences(np.array(mine), True, labels).evidence for mine in ([0], [1, 2])]
        p.append(p_values(np.array(evidence)).min())
    p = np.array(p)
    assert (p <= 0.05).mean() < 0.1 and 0.35 < np.mean(p <= 0.5) < 0.65
