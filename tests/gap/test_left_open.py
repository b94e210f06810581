"""Rigs whose light, exposure, white balance or reflectances nobody declared: own numbers of each capture, and what they hide.

Captures by the generator of tests/bench, which shares no image formation with the effects under test.
"""

import sys
from pathlib import Path

import numpy as np
import pytest

ROOT = Path(__file__).parents[2]
sys.path[:0] = [str(ROOT / "scripts"), str(ROOT / "tests/bench")]

from effects import library  # noqa: E402
from gap.changes.joined import joined  # noqa: E402
from gap.problem import without_own  # noqa: E402
from gap.select.search import Search  # noqa: E402
from gap.select.select_effects import verdict  # noqa: E402
from generator import draw_effect, generate_campaign, nominal  # noqa: E402
from generator.left_open import own_effects, shared_effects  # noqa: E402
from rig.geometry import N_POSE  # noqa: E402
from trials.observe_trial import observe_trial, observed_cases  # noqa: E402

SEED = "left open"


@pytest.fixture(scope="module")
def made(tmp_path_factory):
    """Return a function of (what is open, names of effects) that makes the measured Case of such a campaign, once."""
    cases = {}

    def make(left_open, names=()):
        key = tuple(left_open), tuple(names)
        if key not in cases:
            folder = tmp_path_factory.mktemp("open")
            effects = [(n, draw_effect(n, 1.0, nominal.RIGS["small"].cameras[0], SEED)) for n in names]
            generate_campaign(folder / "c", folder / "truth", effects, SEED, "small", left_open=left_open)
            observe_trial(folder / "c", folder / "seen")
            cases[key] = observed_cases(folder / "seen")[0]
        return cases[key]

    return make


def test_each_capture_gets_its_own_exposure_and_white_balance(made):
    """Fails if a rig's `exposure: auto` is taken for 1, or one exposure is fitted to all captures."""
    case = made(["exposure", "white_balance"])
    search = Search(case)
    twin = search.fitted([])
    assert twin.gap < 1.1
    for i in search.train + search.test:
        true = own_effects(["exposure", "white_balance"], SEED, case.captures[i].view.capture)
        found = dict(case.seen_with([], twin.poses[i]))
        assert found["exposure"]["scale"] == pytest.approx(true["exposure"]["scale"], abs=0.02)
        assert found["colour_balance"]["red_gain"] == pytest.approx(true["colour_balance"]["red"], abs=0.02)
        assert found["colour_balance"]["blue_gain"] == pytest.approx(true["colour_balance"]["blue"], abs=0.02)


def test_what_is_open_is_not_blamed(made):
    """Fails if an effect competes that each capture has for itself, or that is fitted in every twin."""
    case = made(["exposure", "reflectance"])
    search = Search(case)
    assert "exposure" not in search.candidates
    assert [n for n, _ in case.nuisances] == ["ink_reflectance"]
    assert search.is_fixed("ink_reflectance")


def test_reflectances_that_nobody_knows_are_fitted_for_all(made):
    """Fails if unknown reflectances stay nominal, or the exposure, which white cannot be told from, is not fitted beside them."""
    case = made(["reflectance"])
    assert {n for n, _ in case.nuisances} == {"ink_reflectance", "exposure"}
    twin = Search(case).fitted(list(case.nuisances))
    effects, true = dict(twin.effects), shared_effects(["reflectance"], SEED)["ink_reflectance"]
    white = (0.8 + effects["ink_reflectance"]["white_change"]) * effects["exposure"]["scale"]
    black = (0.05 + effects["ink_reflectance"]["black_change"]) * effects["exposure"]["scale"]
    assert twin.gap < 1.1
    assert (white, black) == (pytest.approx(true["white"], rel=0.01), pytest.approx(true["black"], abs=0.004))


def test_a_lens_is_named_beside_an_open_exposure(made):
    """Fails if a fall-off is not told where each capture's exposure is free, or something else is named with it."""
    *_, outcome = verdict(made(["exposure", "reflectance"], ["vignetting"]))
    assert ([step.effect for step in outcome.steps], outcome.verdict) == (["vignetting"], "explained")
    assert outcome.twin.gap < 1.1


def test_derivatives_by_own_numbers_are_those_of_predictions(made):
    """Fails if a column of a capture's own number is another's, or of another size."""
    case = made(["light", "exposure", "white_balance"])
    solver = Search(case).solver
    pose = case.start_poses()[0]
    columns = solver.derivatives_of.by_pose(0, [], pose)
    assert columns.shape[1] == N_POSE + len(case.own)
    for k in range(N_POSE, len(pose)):
        step = 0.02 * np.eye(len(pose))[k]
        there, back = (solver.residuals(0, [], pose + s * step) for s in (1, -1))
        change = np.concatenate([(back[g] - there[g]).ravel() for g in ("levels", "colour")]) / 0.04
        at, parts = 0, {}
        for g, values in there.items():
            parts[g], at = columns[at : at + values.size, k], at + values.size
        told = np.concatenate([parts["levels"], parts["colour"]])
        assert np.linalg.norm(told - change) < 0.1 * max(np.linalg.norm(change), 1.0), case.own[k - N_POSE]


def test_corners_leave_own_numbers_alone(made):
    """Fails if a fit of corners alone, which say nothing of exposure, puts it back to its prior."""
    case = made(["exposure", "white_balance"])
    solver = Search(case).solver
    poses = case.start_poses()
    poses[:, N_POSE:] = 0.3
    _, fitted = solver.fit_geometry([], [], poses, solver.no_offsets(), [0, 1])
    assert (fitted[:, N_POSE:] == 0.3).all()
    assert (fitted[:2, :N_POSE] != 0).any()


def test_a_baseline_that_declared_more_is_open_too(made):
    """Fails if captures of a set that leaves its exposure open are compared at the other's declared one."""
    declared, left = made([]), made(["exposure", "reflectance"])
    for first, second in ((declared, left), (left, declared)):
        problem, _ = joined(first, second)
        assert problem.own == (("exposure", "scale"),)
        assert [n for n, _ in problem.nuisances] == ["ink_reflectance"]
        assert len(problem.sigma_pose) == N_POSE + 1


def test_a_campaign_that_declares_everything_has_no_own_numbers(made):
    """Fails if what a user declared is fitted all the same."""
    case = made([])
    assert (case.own, case.nuisances, len(case.sigma_pose)) == ((), (), N_POSE)
    assert library.own_where_open([]) == [] and library.shared_where_open([]) == []


def test_what_the_twin_file_gives_is_no_captures_own(made):
    """Fails if a value that the user wrote is fitted to each capture as the campaign leaves it open."""
    case = without_own(made(["light", "exposure", "white_balance"]), {"exposure": {"scale": 1.2}})
    assert {name for name, _ in case.own} == {"colour_balance", "illumination_gradient"}
    pose = case.start_poses()[0]
    assert len(pose) == N_POSE + 4
    assert ("exposure", {"scale": 1.2}) in case.seen_with([("exposure", {"scale": 1.2})], pose)
