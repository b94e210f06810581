"""Photographs of a board, drawn here by the twin's own image formation with a light, a blur and poses of their own."""

import numpy as np
import pytest
from drawn_board import K, board_case, light_of, photograph

from effects import library, pipeline
from gap.photographs import LIKE_LIGHT, competing, expected_corners, roughness, spread_out
from gap.search import Search
from rig.geometry import project

HIDDEN = [("lens_blur", library.nulls_of("lens_blur") | {"sigma_px": 1.0})]


@pytest.fixture(scope="module")
def photographs():
    """The measured case of eight photographs, each with its light, all with the same blur."""
    case = board_case(8)
    for k, capture in enumerate(case.captures):
        corners = project(K, capture.view.T_cam_world, case.corners)
        starts = corners + np.random.default_rng(k).normal(0, 0.3, corners.shape)
        case.observe_photograph(capture, photograph(case, k, HIDDEN), starts)
    return case


def test_light_of_each_photograph_is_found(photographs):
    """Fails if gain, slope, colour or stray light of a photograph go to one another, or stay at the first guess."""
    search = Search(photographs, [])
    poses, groups = search.solver.score(HIDDEN, photographs.start_poses(), search.test)
    for i in search.test:
        seen = photographs.corners[photographs.captures[i].observation.measured].mean(axis=1)
        x, y = seen[None, :, 0], seen[None, :, 1]
        found, truth = (photographs.lit(np.full((*x.shape, 1), 0.9), p, x, y) for p in (poses[i, 6:], light_of(i)))
        np.testing.assert_allclose(found, truth, rtol=0.05)
        assert np.median(np.abs(found / truth - 1)) < 0.02
        np.testing.assert_allclose(poses[i, 12:], light_of(i)[6:], atol=0.01)
    assert np.median(np.abs(np.concatenate([g["levels"][:, :2].ravel() for g in groups.values()]))) < 1


def test_a_change_of_light_is_no_effect(photographs):
    """Fails if what each photograph's own light does as well is offered as an effect, or what it can't do is not."""
    search = Search(photographs, ["exposure", "colour_balance", "lens_blur", "sharpening", "fixed_pattern_noise"])
    base = search.fitted([])
    names, why = competing(search, base, search.candidates)
    assert names == ["lens_blur", "sharpening"]
    assert {n for n, reason in why.items() if reason == LIKE_LIGHT} == {"exposure", "colour_balance"}


def test_a_blur_is_seen_under_any_light(photographs):
    """Fails if edges of patches under their own light tell nothing of blur: it is gained most, and its size found."""
    search = Search(photographs, ["lens_blur", "sharpening", "sensor_noise"])
    base = search.fitted([])
    found = search.try_effect(base, "lens_blur")
    assert found.parameters["sigma_px"] == pytest.approx(1.0, abs=0.1)
    assert found.gain > 0.5 * sum(base.losses.values())


def test_patches_are_expected_where_the_points_say(photographs):
    """Fails if a lens or a slanting view leads patches away from where a board's points are."""
    points = np.array([[(i + 1) * 0.03, (6 - j) * 0.03, 0] for j in range(6) for i in range(8)])
    view = photographs.captures[0].view
    bent = [("radial_distortion", library.nulls_of("radial_distortion") | {"k1": -0.2})]
    pixels = pipeline.map_points(project(K, view.T_cam_world, points), view, bent)
    truth = pipeline.map_points(project(K, view.T_cam_world, photographs.corners).reshape(-1, 2), view, bent)
    off = expected_corners(points, pixels, photographs.patches).reshape(-1, 2) - truth
    assert np.abs(off).max() < 0.5
    assert np.isnan(expected_corners(points, np.full_like(pixels, np.nan), photographs.patches)).all()


def test_roughness_is_what_neighbours_differ_by():
    """Fails if what is smooth over a photograph, or a fault of the print, is taken for roughness."""
    rng = np.random.default_rng(3)
    places = np.stack(np.meshgrid(np.arange(6.0), np.arange(5.0)), -1).reshape(-1, 2)
    print_faults, seen = rng.normal(0, 5, (30, 3)), {}
    for i in range(8):
        x, y = (places / 5).T
        smooth = np.outer(3 + 10 * x - 7 * y + 4 * x * y, [1, 2, 3])
        seen[i] = np.arange(30), smooth + print_faults + rng.normal(0, 0.7, (30, 3))
    assert roughness(places, seen, with_cells=True) == pytest.approx(0.7, rel=0.15)
    assert roughness(places, seen, with_cells=False) > 2
    assert roughness(places, {0: (np.arange(4), np.zeros((4, 3)))}, with_cells=True) is None


def test_patches_that_are_looked_at_are_spread_over_the_board():
    """Fails if a photograph is judged by one end of the board."""
    places = np.stack([*np.meshgrid(np.arange(10.0), np.arange(10.0)), np.zeros((10, 10))], -1).reshape(-1, 3)
    chosen = places[spread_out(places, np.arange(100), 5)]
    assert np.ptp(chosen, axis=0)[:2].tolist() == [9, 9]
    assert spread_out(places, np.arange(3), 5).tolist() == [0, 1, 2]
