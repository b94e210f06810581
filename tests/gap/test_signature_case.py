"""Photographs of a board against their twins: drawn three times finer, effects laid on by the trials' generator, own light."""

import sys
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from drawn_board import BOARD, K, board_case

sys.path.insert(0, str(Path(__file__).resolve().parents[1] / "bench"))

from diagnose_patches import LIKE_LIGHT, competing  # noqa: E402
from effects import library, pipeline  # noqa: E402
from gap.boards.photographs import expected_corners, spread_out  # noqa: E402
from gap.fit.residuals import GROUPS  # noqa: E402
from gap.observables import SIGNS, SIGNS_OF_GROUP  # noqa: E402
from gap.select.search import Search  # noqa: E402
from gap.select.select_effects import verdict  # noqa: E402
from gap.signatures.signature_case import OF_SLOPES  # noqa: E402
from retaken_board import POINTS, signatures_of  # noqa: E402
from rig.geometry import project  # noqa: E402
from rig.light import LIGHT, exposed, free_numbers  # noqa: E402

FEW = [
    "lens_blur",
    "motion_blur",
    "sensor_noise",
    "sharpening",
    "denoising",
    "jpeg_compression",
    "vignetting",
    "exposure",
]
NOISE = {"full_well_e": 3000.0, "read_noise_e": 12.0}  # of the generator
NOISE_OF_TWIN = {"gain_dn_per_e": 255 / 3000, "read_noise_e": 12.0}


def test_an_ideal_cameras_photographs_are_adequate():
    """Fails if what the twin leaves out of its drawing, a place or a light, passes for a camera's effect."""
    _, base, _, outcome = verdict(signatures_of({}), candidates=FEW)
    assert (outcome.steps, outcome.verdict) == ((), "adequate") and base.gap < 1


def test_noise_and_sharpening_are_named_and_measured():
    """Fails if one passes for the other, if a third is named beside them, or if sizes are not those that were laid on."""
    laid = {"sensor_noise": NOISE, "sharpening": {"amount": 0.7, "sigma_px": 0.85}}
    _, base, _, outcome = verdict(signatures_of(laid), candidates=FEW)
    assert sorted(step.effect for step in outcome.steps) == ["sensor_noise", "sharpening"]
    assert outcome.verdict == "explained" and outcome.twin.gap < 1 < base.gap
    found = dict(outcome.twin.effects)
    assert found["sharpening"]["amount"] == pytest.approx(0.7, rel=0.15)
    assert found["sensor_noise"]["gain_dn_per_e"] == pytest.approx(255 / 3000, rel=0.25)


def test_black_that_has_grown_in_print_is_named_and_measured():
    """Fails if the print is taken as it was told, or its growth is measured in pixels."""
    case = signatures_of({}, printed=[("ink_spread", {"spread_m": 0.0004})])
    names, _ = competing(case, [*FEW, "ink_spread"], set())
    _, _, _, outcome = verdict(case, candidates=names)
    ((name, found),) = outcome.twin.effects
    assert (name, outcome.verdict) == ("ink_spread", "explained")
    assert found["spread_m"] == pytest.approx(0.0004, rel=0.1)


def test_what_undoes_a_blur_is_fitted_without_a_predicted_gain(monkeypatch):
    """Fails if an effect is never looked at that a blur hides: here a sharpening's predicted gain is zero to first order."""
    predicted = Search.predicted_gain
    nothing = dict.fromkeys(GROUPS, 0.0)
    monkeypatch.setattr(Search, "predicted_gain", lambda s, t, n: nothing if n == "sharpening" else predicted(s, t, n))
    hidden = {"lens_blur": {"sigma_px": 1.2}, "sensor_noise": NOISE, "sharpening": {"amount": 1.5, "sigma_px": 1.5}}
    names = ["lens_blur", "sensor_noise", "sharpening", "vignetting"]
    _, _, _, outcome = verdict(signatures_of(hidden), candidates=names)
    assert sorted(step.effect for step in outcome.steps) == ["lens_blur", "sensor_noise", "sharpening"]


def test_what_each_photographs_own_light_does_as_well_does_not_compete():
    """Fails if exposure or colours are offered as effects of photographs whose light nobody declared, or a blur is not."""
    case = signatures_of({}, 6)
    names, why = competing(
        case, ["exposure", "colour_balance", "lens_blur", "fixed_pattern_noise", "marker_scale"], {"lens_blur"}
    )
    assert names == [] and {n for n, reason in why.items() if reason == LIKE_LIGHT} == {"exposure", "colour_balance"}
    assert competing(case, ["exposure", "lens_blur"], set())[0] == ["lens_blur"]


@pytest.mark.parametrize(
    ("declared", "may"),
    [("exposure", ["colour_balance"]), ("white_balance", ["exposure"]), ("exposure white_balance", [])],
)
def test_what_is_declared_competes(declared, may):
    """Fails if light is taken to make up for an exposure or for colours that the campaign declares, or no longer for others."""
    open_ones = {"light", "exposure", "white_balance"} - set(declared.split())
    case = replace(signatures_of({}, 6), free=free_numbers(open_ones))
    assert [n for n in ("exposure", "colour_balance") if case.is_like_light(n)] == may


def test_every_sign_belongs_to_one_group():
    """Fails if a new sign is in no residual, or counts twice; how sharp a photograph is no ideal twin says as finely."""
    grouped = [name for names in SIGNS_OF_GROUP.values() for name in names]
    assert sorted(["fine_x", "fine_y", "fine_turn", *grouped]) == sorted(SIGNS)


def test_the_same_effects_give_the_same_signature():
    """Fails if noise is drawn anew at each look, so that a fit chases its own dice, or changes with what else is laid on."""
    case, noise = signatures_of({}, 6), [("sensor_noise", library.starts_of("sensor_noise")[0])]
    first = case.signature(0, noise)
    np.testing.assert_array_equal(first, case.signature(0, noise))
    blurred = case.signature(0, [("lens_blur", library.nulls_of("lens_blur") | {"sigma_px": 1e-3}), *noise])
    np.testing.assert_allclose(blurred, first, atol=0.05)


def test_a_signature_does_not_depend_on_what_was_laid_on_before():
    """Fails if steps of image formation are kept that other parameters, another print or an expected image would not share."""
    laid = [
        [("sensor_noise", {"gain_dn_per_e": 0.1}), ("sharpening", {"amount": 0.7, "radius_px": 1.0})],
        [("sensor_noise", {"gain_dn_per_e": 0.1}), ("sharpening", {"amount": 0.2, "radius_px": 1.0})],
        [("sensor_noise", {"gain_dn_per_e": 0.2}), ("sharpening", {"amount": 0.2, "radius_px": 1.0})],
        [("sensor_noise", {"gain_dn_per_e": 0.2}), ("ink_spread", {"spread_m": 0.0004})],
        [("sensor_noise", {"gain_dn_per_e": 0.2})],
    ]
    laid = [[(name, library.nulls_of(name) | p) for name, p in effects] for effects in laid]
    case = signatures_of({}, 6)
    for effects in laid:
        case.twins[0].levels(effects)
        np.testing.assert_array_equal(case.signature(0, effects), signatures_of({}, 6).signature(0, effects))


def test_patches_are_expected_where_the_points_say():
    """Fails if a lens or a slanting view leads patches away from where a board's points are."""
    case = board_case(1)
    view = case.captures[0].view
    bent = [("radial_distortion", library.nulls_of("radial_distortion") | {"k1": -0.2})]
    pixels = pipeline.map_points(project(K, view.T_cam_world, POINTS), view, bent)
    truth = pipeline.map_points(project(K, view.T_cam_world, case.corners).reshape(-1, 2), view, bent)
    off = expected_corners(POINTS, pixels, case.patches).reshape(-1, 2) - truth
    assert np.abs(off).max() < 0.5
    assert np.isnan(expected_corners(POINTS, np.full_like(pixels, np.nan), case.patches)).all()
    assert BOARD.columns * BOARD.rows == len(POINTS)


def test_patches_that_are_looked_at_are_spread_over_the_board():
    """Fails if a photograph is judged by one end of the board."""
    places = np.stack([*np.meshgrid(np.arange(10.0), np.arange(10.0)), np.zeros((10, 10))], -1).reshape(-1, 3)
    chosen = places[spread_out(places, np.arange(100), 5)]
    assert np.ptp(chosen, axis=0)[:2].tolist() == [9, 9]
    assert spread_out(places, np.arange(3), 5).tolist() == [0, 1, 2]


@pytest.mark.parametrize("free", [OF_SLOPES, np.zeros(len(LIGHT), bool)], ids=["open", "declared"])
def test_another_light_is_not_blamed_on_the_camera(free):
    """Fails if what a photograph's own light, that nobody declared, makes up for stays among what a twin must explain, or a
    declared light is taken out of it.
    """
    case, noise = replace(signatures_of({"sensor_noise": NOISE}, 4), free=free), [("sensor_noise", NOISE_OF_TWIN)]
    dimmer = replace(case, twins=[replace(twin, light=exposed(twin.light, 0.8)) for twin in case.twins])
    dimmer.floors = case.floors

    def left(problem, group):
        return problem.solver().residuals(0, noise, None)[group]

    blamed = {group: np.linalg.norm(left(dimmer, group) - left(case, group)) for group in ("levels", "noise", "colour")}
    if free.any():
        assert (
            np.count_nonzero(left(case, "levels")) == 1 and max(blamed.values()) < 1
        )  # whether white falls off outwards
    else:
        assert (
            np.count_nonzero(left(case, "levels")) == 3 and blamed["levels"] > 2
        )  # -0.22 in logarithms, a floor is 0.1
