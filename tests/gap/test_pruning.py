"""What goes from many effects that were fitted together, and what stays."""

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest
from cases import case_of_several
from stand_in_twins import StandingTwin, base_twin

from effects import library
from gap.select import pruning
from gap.select.exchange import short_fit, standing
from gap.select.search import SCALE_FROM_NEAR, SCALE_FROM_START, Search


@pytest.mark.parametrize(
    ("names", "asked", "left"),
    [
        (["focal_length", "exposure", "tone_curve"], [], ["focal_length", "exposure", "tone_curve"]),
        (
            ["jpeg_compression", "focal_length", "exposure", "tone_curve"],
            ["exposure", "tone_curve"],
            ["jpeg_compression", "focal_length", "tone_curve"],
        ),
    ],
    ids=["no codec", "codec"],
)
def test_beside_a_codec_all_photometry_is_taken_out_to_see(monkeypatch, names, asked, left):
    """Fails if an exposure beside the curve that holds it keeps its name for a codec's steps, or needless fits are made: without
    what is clearly needed none is fitted on.
    """
    tried, fitted = [], []

    def without(_, end, gone):
        tried.extend(gone)
        effects = [e for e in end.state.effects if e[0] not in gone]
        loss = 500.0 if gone == ["exposure"] else 700.0
        return SimpleNamespace(state=SimpleNamespace(effects=effects, poses=None), evidence=end.evidence, loss=loss)

    def fitted_on(_, effects, *__):
        fitted.append([n for n, _ in effects])
        return SimpleNamespace(state=SimpleNamespace(effects=effects, poses=None), evidence={}, loss=200.0)

    def standing(_, base, end):
        lost = 1e4 if "tone_curve" not in dict(end.state.effects) else 0.0
        return StandingTwin(tuple(end.state.effects), lost, {0: 1000.0 * len(end.state.effects)})

    monkeypatch.setattr(pruning, "descent_without", without)
    monkeypatch.setattr(pruning, "standing", standing)
    monkeypatch.setattr(pruning, "short_fit", fitted_on)
    monkeypatch.setattr(pruning, "is_as_good", lambda *_: False)
    monkeypatch.setattr(pruning, "_leaves_as_little", lambda a, b: a.left <= b.left)
    effects = tuple((n, {}) for n in names)
    end = SimpleNamespace(state=SimpleNamespace(effects=effects), evidence=dict.fromkeys(names, 1e5), loss=200.0)
    search = SimpleNamespace(is_fixed=lambda n: False, problem=SimpleNamespace(shows=lambda n: n == "jpeg_compression"))
    pruned, _ = pruning.pruned(search, base_twin(), StandingTwin(effects, 0.0, {}), end)
    assert (tried, pruned.names) == (asked, left)
    assert fitted == [[n for n in names if n != "exposure"]] * ("exposure" in asked)


@pytest.mark.parametrize(
    ("name", "fixed", "held_out", "goes"),
    [
        ("veiling_glare", None, 1000.0, True),
        ("veiling_glare", None, 1100.0, False),
        ("veiling_glare", "tone_curve", 1000.0, False),
        ("lens_blur", None, 1000.0, False),
    ],
    ids=["the curve does as well", "it does not", "the user wrote the curve", "no curve's kind"],
)
def test_behind_a_codec_a_curve_begins_anew_without_what_it_can_stand_for(monkeypatch, name, fixed, held_out, goes):
    """Fails if a glare that is not there keeps its name beside a JPEG, whose steps hold the curve that was fitted with it, or the
    curve loses its place in the camera or what the user wrote of it.
    """
    curve = library.nulls_of("tone_curve") | {"place": 1.0}
    effects = (("jpeg_compression", {}), ("tone_curve", curve | {"lift_at_50_pct_dn": 9.0}), (name, {}))
    begun = []

    def descent(effects, loss):
        return SimpleNamespace(state=SimpleNamespace(effects=effects, poses=None), evidence={}, loss=loss)

    def fitted(_, some, *__, rough=()):
        begun.append((some, rough))
        return descent(some, 200.0)

    monkeypatch.setattr(
        pruning, "descent_without", lambda _, end, gone: descent([e for e in effects if e[0] not in gone], 9e4)
    )
    monkeypatch.setattr(pruning, "standing", lambda _, base, end: StandingTwin(end.state.effects, 0.0, {0: held_out}))
    monkeypatch.setattr(pruning, "short_fit", fitted)
    monkeypatch.setattr(pruning, "_leaves_as_little", lambda *_: False)
    shows = SimpleNamespace(shows=lambda n: n == "jpeg_compression")
    search = SimpleNamespace(is_fixed=lambda n: n == fixed, problem=shows)
    kept, _ = pruning.pruned(search, base_twin(), StandingTwin(effects, 0.0, {0: 1000.0}), descent(effects, 200.0))
    assert (name not in kept.names) == goes
    anew = ([("jpeg_compression", {}), ("tone_curve", curve)], ["jpeg_compression"])
    assert begun[:1] == [anew] * (name == "veiling_glare" and not fixed)


@pytest.mark.parametrize("left", [1000.0, 1100.0], ids=["needless", "needed"])
def test_what_undoes_one_another_is_taken_out_together(monkeypatch, left):
    """Fails if a denoising and the sharpening after it keep their names as each alone would be missed, or a blur and its
    sharpening go that are there: both were named beside a JPEG that had neither.
    """
    names = ["denoising", "exposure", "sharpening"]
    effects = tuple((n, {}) for n in names)

    def descent(effects):
        state = SimpleNamespace(effects=effects, poses=None)
        return SimpleNamespace(state=state, evidence=dict.fromkeys(names, 5000.0), loss=1000.0)

    def without(_, end, gone):
        return descent([e for e in end.state.effects if e[0] not in gone])

    def standing(_, base, end):
        is_whole = len({"denoising", "sharpening"} & set(dict(end.state.effects))) != 1
        lost = (
            (1000.0 if len(end.state.effects) == 3 else left)
            if is_whole and "exposure" in dict(end.state.effects)
            else 5000.0
        )
        return StandingTwin(tuple(end.state.effects), 0.0, {0: lost})

    monkeypatch.setattr(pruning, "descent_without", without)
    monkeypatch.setattr(pruning, "standing", standing)
    monkeypatch.setattr(pruning, "short_fit", lambda _, effects, *__: descent(effects))
    monkeypatch.setattr(pruning, "_is_clearly_needed", lambda *_: False)
    search = SimpleNamespace(is_fixed=lambda n: False, problem=SimpleNamespace(shows=lambda n: False))
    kept, _ = pruning.pruned(search, base_twin(), StandingTwin(effects, 0.0, {0: 1000.0}), descent(effects))
    assert kept.names == (["exposure"] if left == 1000.0 else names)


def test_what_is_left_is_compared_in_one_twins_floors():
    """Fails if a twin whose own noise scatters more seems to leave less."""
    groups = {0: {"levels": np.full((1, 100), 2.0)}}
    ample, narrow = (replace(base_twin(), groups=groups, floors={"levels": floor}) for floor in (5.0, 1.0))
    assert sum(ample.excess.values()) == 0 < sum(narrow.excess.values())
    assert pruning._leaves_as_little(narrow, ample) and pruning._leaves_as_little(ample, narrow)


@pytest.mark.parametrize(("noise", "closes"), [(1.0, True), (9.0, False)], ids=["less", "more"])
def test_a_round_that_loses_more_closes_nothing(noise, closes):
    """Fails if effects are named that raise what the twin's own captures differ by, its floors, above what they spoil."""
    before, after = (
        replace(base_twin(), groups={0: {name: np.full((1, 100), off) for name, off in groups.items()}}, floors=floors)
        for groups, floors in (
            ({"levels": 3.0, "noise": 1.0}, {}),
            ({"levels": 1.0, "noise": noise}, {"noise": 20.0}),
        )
    )
    assert pruning.closes_enough(before, after) == closes


@pytest.mark.parametrize(
    ("left", "patch"),
    [({"levels": 1.0}, False), ({"levels": 900.0, "corners": 1e5}, True), ({"corners": 900.0}, False)],
    ids=["nothing is left", "hardly anything of much", "most of its own group"],
)
def test_a_patch_brings_little_of_what_stays_open(left, patch):
    """Fails if an effect keeps its name that closes a small part of a gap, or loses it for another group's gap."""
    twin = SimpleNamespace(
        excess=dict.fromkeys(["levels", "corners", "edges", "noise", "field", "colour", "pose"], 0.0) | left
    )
    groups = {"corners": np.zeros((1, 2)), "levels": np.zeros((1, 2))}
    state = SimpleNamespace(effects=[("exposure", {"scale": 1.1})])
    end = SimpleNamespace(
        state=state,
        free=[("exposure", "scale")],
        groups={0: groups},
        derivatives={0: (np.array([[0.0], [0.0], [1.0], [1.0]]), None)},
        evidence={"exposure": 100.0},
    )
    search = SimpleNamespace(test=[1], problem=SimpleNamespace(shows=lambda name: {}))
    assert pruning._is_patch(search, twin, end, "exposure") == patch


@pytest.mark.parametrize(("added", "patches"), [(["exposure"], []), (["exposure", "defocus"], ["exposure", "defocus"])])
def test_what_came_alone_is_no_patch_before_the_round_is_asked_what_it_closes(monkeypatch, added, patches):
    """Fails if second order keeps out the one effect of a round that halves the gap, as it did a focal length."""
    monkeypatch.setattr(pruning, "_is_patch", lambda *_: True)
    assert pruning.patches_of(None, None, None, added) == patches


def test_what_a_curve_makes_up_for_from_afar_goes(tmp_path):
    """Fails if an exposure and a print that a curve was fitted to undo stay, as old derivatives do not lead it back so far."""
    case = case_of_several(tmp_path, ["lens_blur", "tone_curve"], size="small")
    search, hidden = Search(case), [(n, case.starts_of(n)[0]) for n in ("lens_blur", "tone_curve")]
    needless = [("exposure", {"scale": 1.08}), ("ink_reflectance", {"white_change": -0.03, "black_change": 0.02})]
    poses, own = case.start_poses(), search.free(hidden)
    end = short_fit(search, [*needless, *hidden], poses, SCALE_FROM_START, 12, own)
    end = short_fit(search, end.state.effects, end.state.poses, SCALE_FROM_NEAR, 1)
    base = search.fitted([])
    kept, _ = pruning.pruned(search, base, standing(search, base, end), end)
    assert kept.names == ["lens_blur", "tone_curve"]


@pytest.mark.parametrize(
    ("led_to", "fitted_to", "left"),
    [(5600.0, 900.0, 5600.0), (18000.0, 8000.0, 8000.0), (18000.0, 19000.0, 18000.0)],
    ids=["as told", "astray", "astray and not mended"],
)
def test_what_leads_others_astray_is_left_out_of_a_fit(monkeypatch, led_to, fitted_to, left):
    """Fails if a round is judged by where old derivatives lead the others when a patch goes, far from what they tell themselves,
    or is fitted once more though they lead there.
    """
    rail, ink = (("rail_sag", {"slope_m": 0.01}), ("exposure", {"scale": 1.1}))
    end = SimpleNamespace(
        state=SimpleNamespace(effects=[rail, ink], poses=None), evidence={"rail_sag": 800.0}, loss=5000.0
    )
    monkeypatch.setattr(pruning, "descent_without", lambda *_: SimpleNamespace(loss=led_to))
    monkeypatch.setattr(pruning, "short_fit", lambda _, effects, *__: SimpleNamespace(loss=fitted_to, effects=effects))
    rest = pruning.refitted_without(None, end, ["rail_sag"])
    assert rest.loss == left and getattr(rest, "effects", [ink]) == [ink]
