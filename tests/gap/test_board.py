"""A board's points as a problem: drawn by exact maps, so that what was hidden in them is known."""

import io
import json
from dataclasses import replace
from types import SimpleNamespace

import cv2
import numpy as np
import pytest

from case_files import load_measured, without_lens
from effects import library, pipeline
from effects.base import Scene, View
from expand_tables import expand_tables
from gap.boards import whole_lens
from gap.boards.board import (
    USUAL_NOISE_PX,
    board_case,
    local_noise_px,
    scales_alone,
    seen_by_points,
    without_alternation,
    without_pixel_locking,
)
from gap.boards.needs import cannot_tell
from gap.boards.whole_lens import left_out_px, whole_lens_record, with_whole_lens
from gap.bounds import LITTLE
from gap.fit.derivatives import flat
from gap.select import candidates, naming, search, select_effects
from gap.select.select_effects import verdict
from register.finders import USUAL, save_points
from register.registration import NO_PRIOR
from rig.geometry import camera_matrix, make_pose, perturb_pose, project

NOISE_PX = 0.1
SIZE = (640, 480)
FOCAL_PX = 600.0
POINTS = np.array([[x, y, 0.0] for y in range(6) for x in range(9)]) * 0.025
INTRINSICS = {"fx": FOCAL_PX, "fy": FOCAL_PX, "cx": 319.5, "cy": 239.5}
CAMPAIGN = """schema: 1
name: c
origin: camera
target: {type: %s, columns: 9, rows: 6}
captures: captures.csv
cameras:
  c: {width: 640, height: 480, fx: 600, fy: 600, cx: 319.5, cy: 239.5}
encoding: srgb
"""
COMPETING = ["radial_distortion", "principal_point", "tangential_distortion", "rolling_shutter"]
OUT_OF_PLACE = np.array([0.05, -0.03, 0.02, 0.002, 0.003, 0.02])  # of poses from which fits start, rad and m


def photographs(effects=(), number=12, noise_px=NOISE_PX, bend_px=0.0, focal_px=FOCAL_PX):
    """Return (views, pixels (n, p, 2)) of the board by a camera of FOCAL_PX, views with ``focal_px``, poses out of place.

    ``bend_px`` is a smooth move of each photograph's own.
    """
    rng, views, pixels = np.random.default_rng(5), [], []
    for k in range(number):
        tilt = rng.uniform(-0.6, 0.6, 2)
        T = make_pose([np.pi + tilt[0], tilt[1], rng.uniform(-0.3, 0.3)], [-0.1, 0.06, rng.uniform(0.3, 0.45)])
        view = View(camera_matrix(FOCAL_PX, FOCAL_PX, 319.5, 239.5), *SIZE, 0, T, "c", f"p{k:02d}", f"p{k:02d}")
        xy = pipeline.map_points(project(view.K, T, POINTS), view, list(effects))
        u, v = ((xy - xy.mean(0)) / xy.std()).T
        own = rng.standard_normal((2, 3)) @ np.stack([u * u, u * v, v * v])
        xy = xy + bend_px * own.T + noise_px * rng.standard_normal(xy.shape)
        xy[(xy < 0).any(1) | (xy > np.array(SIZE) - 1).any(1)] = np.nan
        K = camera_matrix(focal_px, focal_px, 319.5, 239.5)
        views.append(View(K, *SIZE, 0, perturb_pose(T, OUT_OF_PLACE), "c", view.capture, view.station))
        pixels.append(xy)
    return views, np.array(pixels)


def problem_of(views, pixels, knows_intrinsics=False):
    """Return the BoardCase of photographs with free poses."""
    scene = Scene((), 0.8, 0.05, 0.3, 0.3)
    trials, noise_px = [0] * len(views), local_noise_px(POINTS, pixels)
    return board_case("c", "c", scene, views, trials, POINTS, pixels, noise_px, knows_intrinsics, NO_PRIOR)


def test_a_lens_is_named_and_measured_with_the_focal_length_that_nobody_knew():
    """Fails if the focal length stays where it began, is named, or if poses or a wrong focal length take up the lens."""
    hidden = {"k1": -0.2, "k2": 0.05, "k3": 0.0}
    problem = problem_of(*photographs([("radial_distortion", hidden)], focal_px=1.05 * FOCAL_PX))
    _, base, _, outcome = verdict(problem, candidates=COMPETING)
    assert outcome.verdict == "explained" and [s.effect for s in outcome.steps] == ["radial_distortion"]
    (name, focal), (_, lens) = outcome.twin.effects
    assert base.names == [name] and scales_alone(name)
    assert abs(next(iter(focal.values())) * 1.05 - 1) < 0.005
    assert abs(lens["k1"] + 0.2) < max(4 * outcome.twin.errors["radial_distortion", "k1"], 0.01)
    assert outcome.twin.gap == pytest.approx(1.0, abs=0.15)


@pytest.mark.parametrize("bend_px", [0.0, 0.2])
def test_what_differs_from_photograph_to_photograph_is_no_effect(bend_px):
    """Fails if a lens is blamed for noise, or for what is smooth and new in each photograph."""
    _, _, _, outcome = verdict(problem_of(*photographs(bend_px=bend_px)), candidates=COMPETING)
    assert outcome.steps == ()
    assert outcome.verdict == ("unexplained" if outcome.twin.gap > 2.3 else "adequate")


def test_a_step_that_closes_a_fifth_of_the_gap_and_leaves_it_open_gets_no_name(monkeypatch):
    """Fails if boards, whose floor is known to a factor of two, keep the names of patches, however certain they are."""
    for module in (search, select_effects):
        monkeypatch.setattr(module, "is_significant", lambda *_: True)
    effects = [("rolling_shutter", library.nulls_of("rolling_shutter") | {"skew_x": 0.0025})]
    problem = problem_of(*photographs(effects, bend_px=0.12))
    _, _, _, outcome = verdict(problem, candidates=["rolling_shutter"])
    assert (outcome.steps, outcome.verdict) == ((), "adequate") and outcome.twin.gap > 1.3
    monkeypatch.setattr(select_effects, "CLOSED", 0.5)
    as_patches = lambda _, twin, candidate: naming.is_missing(candidate, twin.excess, LITTLE)  # noqa: E731
    for module in (candidates, select_effects):
        monkeypatch.setattr(module, "is_missing_from", as_patches)
    _, _, _, patched = verdict(problem, candidates=["rolling_shutter"])
    assert [s.effect for s in patched.steps] == ["rolling_shutter"] and 0.6 < patched.share_left < 0.9


@pytest.mark.parametrize("knows_intrinsics", [True, False])
def test_where_none_may_compete_none_is_named(knows_intrinsics):
    """Fails if all effects compete where a user wants none that points show, or what cannot be told raises where nothing is
    fitted.
    """
    lens = [("radial_distortion", {"k1": -0.2, "k2": 0.0, "k3": 0.0})]
    search, _, first, outcome = verdict(problem_of(*photographs(lens), knows_intrinsics), candidates=[])
    assert (first, outcome.steps, outcome.verdict) == ([], (), "unexplained")
    assert cannot_tell(search, outcome.twin, []) == ([], {}, [])


def test_what_lies_within_the_floor_has_no_name(monkeypatch):
    """Fails if names are looked for in a gap that is the floor, which no repeats tell."""
    for module in (search, select_effects):
        monkeypatch.setattr(module, "is_significant", lambda *_: True)
    weak = [("radial_distortion", {"k1": -0.02, "k2": 0.0, "k3": 0.0})]
    _, base, first, outcome = verdict(problem_of(*photographs(weak)), candidates=["radial_distortion"])
    assert first[0].gain > 0 and base.gap < 1.1
    assert (outcome.steps, outcome.verdict) == ((), "adequate")


def test_the_whole_lens_holds_what_is_too_small_for_a_name():
    """Fails if a weak lens without a name is missing from the whole lens, or points beyond their noise are its outliers."""
    weak = [("radial_distortion", {"k1": -0.016, "k2": 0.0, "k3": 0.0})]
    search, _, _, outcome = verdict(problem_of(*photographs(weak, bend_px=0.08)), candidates=COMPETING)
    assert outcome.steps == ()
    whole, found = with_whole_lens(search, outcome.twin), whole_lens_record(search, outcome.twin)
    fitted = {e["effect"]: e["parameters"] for e in found["effects"]}
    assert found["too_small_for_a_name"] == COMPETING[:3] and "rolling_shutter" not in fitted
    k1 = fitted["radial_distortion"]["k1"]
    assert abs(k1["value"] + 0.016) < 4 * k1["se"] and k1["se"] < 0.02
    assert found["left_out_px"] < 0.99 * found["left_out_px_of_named"]
    assert outcome.twin.gap > 1.1
    by_noise = search.fitted(whole.effects, whole.poses).loss
    assert whole.loss == pytest.approx(by_noise / (2 * outcome.twin.gap) ** 2, rel=0.3)


def test_a_further_fit_that_leaves_more_is_no_whole_lens(monkeypatch):
    """Fails if a fit that went astray takes the place of the one before it, which had not come to rest."""
    search, base, _, _ = verdict(problem_of(*photographs()), candidates=COMPETING[:1])
    better = replace(with_whole_lens(search, base), converged=False)
    worse = replace(better, loss=better.loss + 100, converged=True)
    fits = iter([better, worse, worse])
    monkeypatch.setattr(type(search), "fitted", lambda *_: next(fits))
    assert with_whole_lens(search, base) is better


def test_small_terms_that_are_noise_are_left_away(monkeypatch):
    """Fails if a lens fitted to few photographs is told, and exported, though left-out ones lie farther off with it."""
    search, base, _, _ = verdict(problem_of(*photographs()), candidates=COMPETING)
    wrong = [(n, p | {"k1": 0.3}) for n, p in with_whole_lens(search, base).effects if n == "radial_distortion"]
    bad = replace(base, effects=(*base.effects, *wrong))
    monkeypatch.setattr(whole_lens, "with_whole_lens", lambda *_: bad)
    found = whole_lens_record(search, base)
    assert found["left_out_px"] > found["left_out_px_of_named"] and found["too_small_for_a_name"] == []
    assert [e["effect"] for e in found["effects"]] == base.names


def test_left_out_points_lie_off_by_their_noise():
    """Fails if poses of left-out photographs are not fitted, one coordinate is forgotten, or fitted photographs count."""
    search, base, _, _ = verdict(problem_of(*photographs(number=16)), candidates=COMPETING)
    points = np.isfinite(np.array([search.problem.captures[i].observation.features for i in search.test])).all(-1).sum()
    freedom = 1 - 6 * len(search.test) / (2 * points)
    assert left_out_px(search, base) == pytest.approx(NOISE_PX * np.sqrt(2 * freedom), rel=0.08)


def test_known_intrinsics_are_not_fitted():
    """Fails if a focal length that the campaign gives is free all the same: it may then be missing, and has a name."""
    problem = problem_of(*photographs(focal_px=1.1 * FOCAL_PX), knows_intrinsics=True)
    assert problem.nuisances == ()
    scaling = [n for n in seen_by_points(library.available_effects()) if scales_alone(n)]
    _, _, _, outcome = verdict(problem, candidates=[*COMPETING, *scaling])
    assert [s.effect for s in outcome.steps] == scaling


@pytest.mark.parametrize("calibrated", [False, True])
def test_the_floor_is_the_noise_whatever_the_lens(calibrated, tmp_path):
    """Fails if a wide lens's own bend counts as noise, or degrees of freedom are forgotten."""
    lens = {"k1": -0.5, "k2": 1.5, "p1": 0.0, "p2": 0.0, "k3": -2.0}
    hidden = [("radial_distortion", {k: lens[k] for k in ("k1", "k2", "k3")})] if calibrated else []
    fit = {"parameters": INTRINSICS | lens}
    (tmp_path / "r.json").write_text(json.dumps({"calibrations": {"5": fit} if calibrated else {}}))
    _, pixels = photographs(hidden, number=60)
    found = local_noise_px(POINTS, without_lens(pixels, tmp_path / "r.json"))
    assert found == pytest.approx(NOISE_PX, rel=0.06)


def test_one_row_of_a_wide_board_tells_nothing_of_noise():
    """Fails if a photograph that shows one line of points alone ends all with OpenCV's error, or changes what others tell."""
    points = np.array([[x, y, 0.0] for y in range(4) for x in range(24)]) * 0.02
    seen = points[:, :2] * 5000 + 0.1 * np.random.default_rng(7).standard_normal((len(points), 2))
    one_row = np.where(np.arange(len(points))[:, None] < 24, seen, np.nan)
    assert local_noise_px(points, np.stack([seen, one_row])) == local_noise_px(points, seen[None])
    assert local_noise_px(points, one_row[None]) == USUAL_NOISE_PX


SIGN = np.where(np.indices((6, 9)).sum(0).ravel() % 2, 1, -1)[:, None]
ALTERNATING = SIGN * [0.4, -0.3]  # pixels


def test_what_corners_alternate_by_is_taken_out_of_each_photograph():
    """Fails if what a finder makes of blur stays, a wrong corner says how much that is, or a lens or paper goes along."""
    _, pixels = photographs([("radial_distortion", {"k1": -0.2, "k2": 0.05, "k3": 0.0})], number=20, bend_px=1.0)
    moved = pixels + ALTERNATING * np.linspace(-1, 1, len(pixels))[:, None, None]
    cleaned = without_alternation(POINTS, moved, 0.025)
    assert np.nanmax(np.abs(cleaned - pixels)) < 0.1 < 0.4 < np.nanmax(np.abs(moved - pixels))
    noise_px, with_it = local_noise_px(POINTS, pixels), local_noise_px(POINTS, moved)
    assert local_noise_px(POINTS, cleaned, 1) == pytest.approx(noise_px, rel=0.05) and with_it > 1.7 * noise_px
    assert local_noise_px(POINTS, cleaned, 1) > local_noise_px(POINTS, cleaned)  # fewer degrees of freedom
    moved[np.arange(len(moved)), np.isfinite(moved).all(2).argmax(1)] += 30.0
    off = np.sort(np.abs(without_alternation(POINTS, moved, 0.025) - pixels), axis=None)
    assert off[np.isfinite(off)][: -2 * len(moved)].max() < 0.3


LEANING_PX = 0.05


def test_what_a_finder_leans_to_the_grid_of_pixels_is_taken_out():
    """Fails if points keep a finder's bias between pixels, or points without one get one; if a wrong corner says how large it is,
    or if where a point lies between pixels is asked of places that no finder saw, a lens's distortion taken out.
    """
    straight, bent = (
        photographs(hidden, number=20, noise_px=0.03)[1]
        for hidden in ([], [("radial_distortion", {"k1": -0.2, "k2": 0.05, "k3": 0.0})])
    )
    leaning = LEANING_PX * np.sin(2 * np.pi * bent)
    wrong = np.zeros_like(bent)
    wrong[np.arange(5), np.isfinite(bent[:5]).all(2).argmax(1)] = 40.0
    for bias in (leaning, 0 * leaning):
        cleaned = without_pixel_locking(POINTS, bent + bias + wrong, straight + bias + wrong)
        assert np.nanmax(np.abs(cleaned - wrong - bent)[np.nan_to_num(wrong) == 0]) < 0.3 * LEANING_PX


@pytest.mark.parametrize(
    "board", ["chessboard, square_m: 0.025", "aruco_grid, dictionary: DICT_4X4_100, marker_m: 0.02, gap_m: 0.01"]
)
def test_only_corners_of_squares_alternate(board, tmp_path):
    """Fails if a checkerboard's corners keep what they alternate by when its files are read, or a marker's lose it."""
    views, pixels = photographs(noise_px=0.02)
    rows = ["capture,camera,image"]
    for view in views:
        cv2.imwrite(str(tmp_path / f"{view.capture}.png"), np.zeros((SIZE[1], SIZE[0]), np.uint8))
        rows.append(f"{view.capture},c,{view.capture}.png")
    (tmp_path / "captures.csv").write_text("\n".join(rows) + "\n")
    (tmp_path / "campaign.yaml").write_text(CAMPAIGN % board)
    expand_tables(tmp_path, None, "c", tmp_path / "expand")
    (tmp_path / "r.json").write_text(json.dumps(INTRINSICS | {"calibrations": {}, "inverted": False}))
    found = [SimpleNamespace(board=POINTS, image=xy) for xy in pixels + ALTERNATING]
    with open(tmp_path / "o.npz", "wb") as file:
        save_points(file, found, USUAL)
    case = load_measured(tmp_path / "expand", tmp_path / "r.json", "c", tmp_path / "o.npz")
    is_grid, seen = board.startswith("aruco_grid"), np.array([c.observation.features for c in case.captures])
    assert (case.noise_px > 0.1) == is_grid
    assert case.noise_px == pytest.approx(local_noise_px(case.points, seen, 0 if is_grid else 1), rel=1e-6)


def test_points_have_the_derivatives_of_their_maps():
    """Fails if a board's points move otherwise with parameters or poses than their derivatives say."""
    problem = problem_of(*photographs(number=2))
    effects = [("radial_distortion", {"k1": -0.1, "k2": 0.0, "k3": 0.0})]
    predict, pose, h = problem.predictor().predict, np.zeros(6), 1e-4
    moved = [
        predict(0, [(n, p | {"k1": p["k1"] + s * h}) for n, p in effects], pose).features for s in (1, -1)
    ]  # fmt: skip
    by_k1 = problem.corners_by_parameters(problem.captures[0], effects, pose, [("radial_distortion", "k1")], [1e-5])
    np.testing.assert_allclose(flat(by_k1), (moved[0] - moved[1]) / (2 * h), rtol=1e-4, atol=1e-4)
    assert problem.predictor().shown(0, [], pose).change(effects).features == pytest.approx(
        predict(0, effects, pose).features - predict(0, [], pose).features, nan_ok=True
    )


def test_points_of_photographs_come_back_where_they_were_seen(tmp_path):
    """Fails if points are taken for others where a photograph shows only some of the board."""
    seen = [[0, 3, 7], [7, 8, 20, 3]]
    found = [
        SimpleNamespace(board=POINTS[k], image=100.0 * n + np.array(k)[:, None] + [0.0, 0.5])
        for n, k in enumerate(seen)
    ]
    file = io.BytesIO()
    save_points(file, found, USUAL)
    file.seek(0)
    stored = np.load(file)
    for n, k in enumerate(seen):
        at = {tuple(p.round(6)): xy for p, xy in zip(stored["points"], stored["pixels"][n], strict=True)}
        assert len(at) == 5 and np.isfinite(stored["pixels"][n]).all(1).sum() == len(k)
        for i in k:
            assert at[tuple(POINTS[i].round(6))] == pytest.approx([100.0 * n + i, 100.0 * n + i + 0.5])
