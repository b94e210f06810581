"""Moves of points told by corners alone, on campaigns made by an image formation that shares no code with the fit."""

from types import SimpleNamespace

import numpy as np
import pytest
from cases import case_of_several

from effects import library
from gap.select.geometry_first import _fewest, are_told_by_others, told_beside_the_rest, told_by_corners
from gap.select.linear_model import proposed
from gap.select.naming import is_flexible
from gap.select.search import Search
from gap.select.select_effects import verdict


def rigid(search):
    """Return the names of the effects that compete first."""
    return [n for n in search.candidates if not is_flexible(n)]


MOVING = ["focal_length", "principal_point", "radial_distortion"]
LENSES = [*MOVING, "tangential_distortion", "rolling_shutter"]


@pytest.fixture(scope="module")
def told(tmp_path_factory):
    """(Search, first twin, what corners tell) of a camera whose lens is another and soft, and whose levels are others."""
    case = case_of_several(tmp_path_factory.mktemp("moved"), [*MOVING, "lens_blur", "exposure"], size="standard")
    search = Search(case)
    base = search.fitted([])
    return search, base, told_by_corners(search, base, rigid(search))


TURNED = ("camera_pose_offset", {"turn_x_deg": 2.0, "turn_z_deg": 15.0})


@pytest.mark.parametrize(
    "name, values", [TURNED, ("radial_distortion", {"k1": -0.2}), ("rolling_shutter", {"skew_y": 0.05})]
)
def test_corners_follow_poses_as_differences_say(told, name, values):
    """Fails if a mount does not turn a pose's moves, a lens or shutter not stretch them, or if a capture's turn is forgotten."""
    problem, pose, h = told[0].problem, np.array([0.02, -0.03, 0.05, 0.01, 0.02, -0.02]), 1e-6
    capture, effects = problem.captures[0], [(name, library.nulls_of(name) | values)]
    on, back = (problem.corners_at(capture, effects, [pose + s * h * step for step in np.eye(6)]) for s in (1, -1))
    expected = (np.stack(on, axis=-1) - np.stack(back, axis=-1)) / (2 * h)
    slopes = problem.corners_by_pose(capture, effects, pose)
    np.testing.assert_allclose(slopes, expected, rtol=1e-4, atol=1e-4 * np.nanmax(np.abs(expected)))


def test_corners_tell_exactly_what_moved_them(told):
    """Fails if one of three large moves is missed, hides another, or is made up for by one that was not hidden."""
    search, base, (effects, poses, _) = told
    assert sorted(n for n, _ in effects) == MOVING
    none = search.solver.no_offsets()
    before, after = (
        np.median(np.concatenate([np.abs(search.solver.corner_residuals(i, e, p[i], none[i])) for i in search.train]))
        for e, p in (([], base.poses), (effects, poses))
    )
    assert after < 0.2 * before


def test_a_blur_is_proposed_by_the_start_that_is_like_it(told):
    """Fails if a blur is told by the change to its farthest start alone, which is none of a small one."""
    search, base, (effects, poses, _) = told
    names = [n for n in rigid(search) if n not in [*MOVING, "defocus"]]  # which at first is as like it
    near = search.scored(search.solver.approach(effects, [], poses, search.train, 1))
    found = dict(proposed(search, near, names).effects)
    assert list(found)[:2] == ["exposure", "lens_blur"]
    assert 0.8 < found["lens_blur"]["sigma_px"] < 1.3


def test_corners_tell_again_what_moved_them_beside_the_rest(told):
    """Fails if a move that stood for another stays once it is known what blur and levels do to corners, or they go as well."""
    search, _, (effects, poses, _) = told
    others = ["tangential_distortion", "focal_length", "rolling_shutter"]
    wrong = [(n, library.starts_of(n)[0]) for n in ("lens_blur", "exposure")]
    wrong += [(n, dict(effects).get(n, library.nulls_of(n))) for n in others]
    twin = search.scored(search.solver.approach(wrong, search.free(wrong), poses, search.train, 9))
    again, _ = told_beside_the_rest(search, twin, rigid(search))
    assert sorted(n for n, _ in again) == sorted([*MOVING, "lens_blur", "exposure"])


def test_what_a_lens_explains_is_no_warp(told):
    """Fails if corners that rigid moves bring into place are told by a warp, which can mimic them."""
    search, base, _ = told
    assert not are_told_by_others(search, base, rigid(search), ["local_warp"])


@pytest.mark.parametrize(
    ("by_lenses", "by_warp", "is_warp"),
    [(800, 50, True), (800, 300, False), (150, 1, False), (4000, 50, True), (4000, 300, False)],
    ids=["a warp", "nor a warp", "a lens of another form", "lenses that go astray", "nor a warp, lenses astray"],
)
def test_what_lenses_leave_open_is_a_warps_where_that_closes_it(monkeypatch, by_lenses, by_warp, is_warp):
    """Fails if a lens whose last form differs a little is taken for a warp, if a warp that leaves its gap open is sought first,
    or if a fit of all lenses that goes astray tells against it.
    """
    left = {(): 1000.0, ("radial_distortion",): by_lenses, ("local_warp",): by_warp}
    monkeypatch.setattr(
        "gap.select.geometry_first._told_with", lambda search, twin, names: (None, (None, left[tuple(names)], 0))
    )
    base = SimpleNamespace(excess={"corners": 1000.0})
    assert are_told_by_others(None, base, ["radial_distortion", "exposure"], ["local_warp"]) == is_warp


@pytest.fixture(scope="module")
def warped(tmp_path_factory):
    """The case of a camera behind a free warp, whose plates' ink is another."""
    return case_of_several(tmp_path_factory.mktemp("warped"), ["local_warp", "ink_reflectance"], size="standard")


def test_a_warp_is_sought_first_and_named_last(warped):
    """Fails if lenses and shutters, which help a little, are tried in its place one after the other, and many at once, until the
    budget is spent, if it hides what is missing beside it, or is named before that.
    """
    search, base, _, outcome = verdict(warped, candidates=["ink_reflectance", "local_warp", *LENSES], budget=1_000)
    assert are_told_by_others(search, base, rigid(search), ["local_warp"])
    assert outcome.verdict == "explained" and outcome.within_budget
    assert [step.effect for step in outcome.steps] == ["ink_reflectance", "local_warp"]
    assert outcome.steps[0].twin.names == ["ink_reflectance"]


def test_where_corners_are_in_place_they_tell_nothing(tmp_path):
    """Fails if the corners of a camera whose levels are off are fitted by lenses."""
    search = Search(case_of_several(tmp_path, ["exposure"]))
    base = search.fitted([])
    effects, poses, left = told_by_corners(search, base, rigid(search))
    assert effects == [] and poses is base.poses and left == rigid(search)


def test_what_no_lens_explains_is_not_told_by_corners(warped):
    """Fails if corners that nothing rigid brings into place are taken for lenses and shutters that help a little, or if images
    are asked for these as well.
    """
    search = Search(warped)
    base = search.fitted([])
    effects, _, left = told_by_corners(search, base, rigid(search))
    assert base.excess["corners"] > 1000 and effects == []
    assert left == [n for n in rigid(search) if not library.is_pure_geometry(n)]


WORTH = {"focal_length": 9_000.0, "principal_point": 3_000.0, "marker_scale": 60.0}


def cost_without(names):
    """A model of what taking effects out costs: a shutter stands in for most of the principal point."""
    worth = dict(WORTH, principal_point=700.0 if "rolling_shutter" not in names else 3_000.0)
    return sum(worth.get(name, 0.0) for name in names)


def test_the_fewest_are_kept_that_corners_cannot_do_without():
    """Fails if what is worth little gets into the first proposal, or what is worth much is left out."""
    assert _fewest([*WORTH, "rolling_shutter"], cost_without) == ["focal_length", "principal_point"]
    assert _fewest(["marker_scale", "rolling_shutter"], cost_without) == []
