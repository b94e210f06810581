"""Many effects at once, on campaigns made by an image formation that shares no code with the fit."""

import gc
import weakref
from dataclasses import replace
from types import SimpleNamespace

import pytest
from cases import case_of_several, generated_case
from stand_in_twins import base_twin, twin_with_gaps

from effects import library
from gap.fit.parameters import fitted_parameters
from gap.select import exchange, joint_way
from gap.select.exchange import short_fit
from gap.select.joint_way import all_at_once, first_proposal
from gap.select.linear_model import Proposal, proposed
from gap.select.naming import is_flexible
from gap.select.outcome import Selection
from gap.select.pruning import _is_clearly_more, descent_without
from gap.select.search import SCALE_FROM_NEAR, SCALE_FROM_START, Search

SIX = ["exposure", "focal_length", "lens_blur", "principal_point", "radial_distortion", "sensor_noise"]
OTHERS = ["defocus", "marker_scale", "tone_curve", "vignetting"]


def found_together(case, names):
    """Return (Outcome of adding what is proposed of some effects together, or None, sets in which that ended)."""
    search = Search(case)
    base, selection = search.fitted([]), Selection(search, 60_000, {})
    return all_at_once(selection, base, base, names, base.excess), selection.ended


@pytest.fixture(scope="module")
def six(tmp_path_factory):
    return found_together(case_of_several(tmp_path_factory.mktemp("six"), SIX, size="small"), [*SIX, *OTHERS])


def test_six_effects_at_once_come_back_exactly(six):
    """Fails if one of six hidden effects is missed, another one named beside them, or where that ended is not noted."""
    outcome, ended = six
    assert sorted(step.effect for step in outcome.steps) == SIX
    assert outcome.verdict == "explained" and ended == {frozenset(SIX)}


def test_each_step_adds_one_effect_with_the_last_twins_values(six):
    """Fails if a step shows more than its own effect, or other values than those that are told in the end."""
    outcome, _ = six
    assert [len(step.twin.names) for step in outcome.steps] == [1, 2, 3, 4, 5, 6]
    last = dict(outcome.twin.effects)
    assert all(p == last[name] for step in outcome.steps for name, p in step.twin.effects)


def test_an_effect_outside_the_library_gets_no_names(tmp_path):
    """Fails if several effects that together close a little of a lens flare are called its explanation."""
    case, truth = generated_case(tmp_path, "outside", seed="gorse", index=1, size="standard")
    assert [e["effect"] for e in truth["effects"]] == ["lens_flare"]
    names = ["tone_curve", "illumination_gradient", "specular_highlight", "vignetting"]
    assert found_together(case, names)[0] is None


def test_few_effects_are_looked_for_one_by_one(tmp_path):
    """Fails if a camera with one effect is taken for one with many."""
    case, _ = generated_case(tmp_path, "single", "lens_blur")
    assert found_together(case, ["lens_blur", "exposure", "vignetting", "focal_length"])[0] is None


OF_A_CODEC = ["colour_balance", "jpeg_compression", "lens_blur", "tone_curve"]


@pytest.fixture(scope="module")
def coded(tmp_path_factory):
    """A camera with a coarse codec and others."""
    return case_of_several(tmp_path_factory.mktemp("coded"), OF_A_CODEC, size="small")


def test_a_codec_beside_others_is_fitted_from_afar_to_the_floor(coded):
    """Fails if a fit sticks on a codec's steps, or how flat it left the ground counts to a tenth of a level: gap 3.7."""
    twin = Search(coded).fitted([(n, coded.starts_of(n)[0]) for n in OF_A_CODEC])
    assert twin.converged and twin.gap < 1.4


def test_a_codec_that_captures_show_is_proposed_first_and_what_mimics_it_is_not(coded):
    """Fails if a codec waits for others, has rivals though captures show it, or noise and mosaics are proposed for its steps."""
    search = Search(coded)
    first = proposed(search, search.fitted([]), [n for n in search.candidates if not is_flexible(n)])
    assert first.names[0] == "jpeg_compression" and first.rivals["jpeg_compression"] == []
    assert not {"bayer_demosaic", "fixed_pattern_noise", "sensor_noise", "denoising"} & set(first.names)
    assert {"colour_balance", "tone_curve"} <= set(first.names)


def test_what_corners_tell_goes_in_first(monkeypatch):
    """Fails if others are proposed beside corners that are out of place, or rounds start from poses that are."""
    moved, asked = [("focal_length", {"ratio": 1.02})], []

    def proposed(_, twin, names):
        asked.append((twin.names, twin.poses, names))
        return Proposal([("lens_blur", library.nulls_of("lens_blur"))], {"lens_blur": []})

    monkeypatch.setattr(joint_way, "told_by_corners", lambda *given: (moved, "moved poses", given[2]))
    monkeypatch.setattr(joint_way, "proposed", proposed)
    monkeypatch.setattr(joint_way, "seen", lambda _, twin: twin)
    first, poses, left = first_proposal(None, base_twin(), ["lens_blur", "defocus"])
    assert first.names == ["focal_length", "lens_blur"] and poses == "moved poses" and left == ["lens_blur", "defocus"]
    assert first.rivals == {"focal_length": [], "lens_blur": []}
    assert asked == [(["focal_length"], "moved poses", ["lens_blur", "defocus"])]


def test_what_a_codec_hides_is_proposed_as_if_there_were_none(monkeypatch):
    """Fails if a codec keeps others from being proposed, or is not fitted with them."""
    asked = []
    monkeypatch.setattr(
        joint_way,
        "first_proposal",
        lambda _, twin, names: (asked.append(names), (Proposal([("exposure", {})], {"exposure": []}), 0, names))[1],
    )
    problem = SimpleNamespace(shows=lambda n: n == "jpeg_compression", starts_of=lambda n: [{"loss": 45.0}])
    search = SimpleNamespace(problem=problem)
    first, *_ = joint_way.proposal_without_codec(search, base_twin(), ["exposure", "jpeg_compression"])
    assert asked == [["exposure"]] and first.effects == [("jpeg_compression", {"loss": 45.0}), ("exposure", {})]


@pytest.mark.parametrize(
    ("shows", "verdicts", "ways"),
    [
        (True, ["explained", "explained"], 1),
        (True, ["unexplained", "explained"], 2),
        (True, ["unexplained", "unexplained"], 2),
        (False, ["unexplained", "explained"], 1),
    ],
)
def test_the_other_proposal_is_tried_where_a_codec_is_shown_and_the_first_explains_nothing(
    monkeypatch, shows, verdicts, ways
):
    """Fails if mimics of a codec compete where it explains the camera, or mosaic and codec together stay unexplained."""
    found = [SimpleNamespace(verdict=v) for v in verdicts]
    left = list(found)
    monkeypatch.setattr(joint_way, "_together", lambda *_: left.pop(0))
    monkeypatch.setattr(joint_way, "is_at_floor", lambda _: False)
    problem = SimpleNamespace(is_board=False, shows=lambda n: shows)
    selection = SimpleNamespace(search=SimpleNamespace(problem=problem), is_spent=lambda: False, ended=set())
    outcome = all_at_once(selection, None, twin_with_gaps(levels=9.0), ["jpeg_compression"], {})
    assert len(found) - len(left) == ways
    assert outcome is found[1 if ways == 2 and verdicts[1] == "explained" else 0]


def test_what_captures_show_stays_as_they_show_it():
    """Fails if whole numbers that captures show are compared beside wrong twins, or fitted."""
    problem = SimpleNamespace(shows=lambda n: {"loss": 45.0} if n == "jpeg_compression" else {})
    names = ["jpeg_compression", "lens_blur"]
    search = SimpleNamespace(problem=problem, fixed={("lens_blur", "sigma_px")})
    given = [f for f in fitted_parameters([(n, library.nulls_of(n)) for n in names]) if Search.is_given(search, f)]
    assert given == [("jpeg_compression", "loss"), ("lens_blur", "sigma_px")]


def descent(loss, name):
    return SimpleNamespace(
        loss=loss, state=SimpleNamespace(effects=[("exposure", {"scale": 1.1}), (name, {})], poses=None)
    )


@pytest.mark.parametrize(
    ("loss_px", "kept", "as_good"),
    [
        (500.0, "defocus", []),
        (990.0, "defocus", ["lens_blur"]),
        (1010.0, "lens_blur", ["defocus"]),
        (2000.0, "lens_blur", []),
    ],
)
def test_the_name_is_that_of_what_leaves_least(monkeypatch, loss_px, kept, as_good):
    """Fails if a rival that leaves less does not take the name, or what leaves as little is not told."""
    losses = {"defocus": loss_px, "lens_blur": 1000.0}
    for fit in ("fitted_alone", "short_fit"):
        monkeypatch.setattr(exchange, fit, lambda _, effects, *__: descent(losses[effects[-1][0]], effects[-1][0]))
    search = SimpleNamespace(problem=SimpleNamespace(starts_of=library.starts_of))
    end, name, others = exchange.exchanged(search, descent(1000.0, "lens_blur"), "lens_blur", ["defocus"])
    assert (end.state.effects[-1][0], name) == (kept, kept)
    assert [n for n, _ in others] == as_good


@pytest.mark.parametrize(("loss", "whole"), [(1900.0, 1), (2100.0, 0)], ids=["near", "far"])
def test_a_rival_is_fitted_with_everything_from_its_best_start(monkeypatch, loss, whole):
    """Fails if time is spent on fits of everything from each start, or from one that leaves far more by itself."""
    fits = []

    def fitted(_, effects, *given):
        fits.append(given[-1] if given[-1] == ["defocus"] else None)
        (name, p), best = effects[-1], library.starts_of("defocus")[1]
        return descent(loss if p == best else 5000.0, name)

    monkeypatch.setattr(exchange, "fitted_alone", fitted)
    monkeypatch.setattr(exchange, "short_fit", fitted)
    search = SimpleNamespace(problem=SimpleNamespace(starts_of=library.starts_of))
    _, name, _ = exchange.exchanged(search, descent(1000.0, "lens_blur"), "lens_blur", ["defocus"])
    assert name == "lens_blur" and fits == [["defocus"], ["defocus"], *[None] * whole]


@pytest.mark.parametrize(
    ("held", "rival", "loss", "kept"),
    [
        ("exposure", "tone_curve", 900.0, "exposure"),
        ("exposure", "tone_curve", 800.0, "tone_curve"),
        ("denoising", "tone_curve", 900.0, "tone_curve"),
        ("principal_point", "rolling_shutter", 900.0, "rolling_shutter"),
    ],
    ids=["a form that saves little", "much", "a form's place", "moves of points"],
)
def test_a_form_takes_a_simple_effects_place_only_where_it_saves_much(monkeypatch, held, rival, loss, kept):
    """Fails if a curve takes the name of an exposure because it also fits a little of what is missing besides."""
    losses = {held: 1000.0, rival: loss}
    for fit in ("fitted_alone", "short_fit"):
        monkeypatch.setattr(exchange, fit, lambda _, effects, *__: descent(losses[effects[-1][0]], effects[-1][0]))
    search = SimpleNamespace(problem=SimpleNamespace(starts_of=library.starts_of))
    _, name, others = exchange.exchanged(search, descent(1000.0, held), held, [rival])
    assert name == kept and not others


@pytest.mark.parametrize(("scale", "asked"), [(1.2, ["exposure"]), (1.0001, [])], ids=["acts", "is idle"])
def test_rivals_of_what_is_idle_are_not_fitted(monkeypatch, scale, asked):
    """Fails if time is spent on other names of what is worth none, or an effect that acts is not compared with its rivals."""
    effects, compared = [("exposure", {"scale": scale})], []
    end = SimpleNamespace(state=SimpleNamespace(effects=effects, poses=None), evidence={"exposure": 1e4})
    exchanged = lambda _, end, name, rivals: (compared.append(name), (end, name, []))[1]  # noqa: E731
    monkeypatch.setattr(joint_way, "short_fit", lambda *_: end)
    monkeypatch.setattr(joint_way, "exchanged", exchanged)
    discrete = SimpleNamespace(compared_once_more=lambda e, *_: e, with_choices=lambda _, state: state.effects)
    search = SimpleNamespace(
        free=lambda effects: [],
        discrete=discrete,
        is_fixed=lambda name: False,
        problem=SimpleNamespace(shows=lambda name: {}, starts_of=lambda name: [{}]),
    )
    joint_way._fitted_in(search, base_twin(), Proposal(effects, {"exposure": ["vignetting"]}))
    assert compared == asked


@pytest.mark.parametrize("has_codec", [True, False])
def test_a_later_round_is_fitted_beside_the_codec_that_the_twin_has(monkeypatch, has_codec):
    """Fails if what is new beside a codec is fitted without it first, and so in its place: losses then rise."""
    codec, new = ("jpeg_compression", {"loss": 45.0}), ("denoising", {"strength_dn": 8.0})
    twin = replace(base_twin(), effects=(codec,)) if has_codec else base_twin()
    proposal, rough = Proposal([new] if has_codec else [codec, new], {"denoising": [], "jpeg_compression": []}), []

    def descended(_, effects, poses, scale, iterations=0, moving=None, without=()):
        rough.append(list(without))
        return SimpleNamespace(state=SimpleNamespace(effects=effects, poses=poses), evidence={})

    monkeypatch.setattr(joint_way, "short_fit", descended)
    discrete = SimpleNamespace(compared_once_more=lambda e, *_: e, with_choices=lambda _, state: state.effects)
    problem = SimpleNamespace(shows=lambda n: n == "jpeg_compression", starts_of=lambda n: [{}])
    search = SimpleNamespace(free=lambda _: [], discrete=discrete, problem=problem)
    joint_way._fitted_in(search, twin, proposal)
    assert rough == [[] if has_codec else ["jpeg_compression"]]


def test_what_others_leave_with_old_derivatives_is_what_a_fit_leaves(coded):
    """Fails if the steps without new derivatives go astray, or tell less than a fit: an effect would stay or go for that."""
    search = Search(coded)
    effects = [(n, coded.starts_of(n)[0]) for n in OF_A_CODEC]
    end = short_fit(search, effects, search.problem.start_poses(), SCALE_FROM_START, 9, rough=["jpeg_compression"])
    for name in ("colour_balance", "lens_blur"):
        rest = [e for e in end.state.effects if e[0] != name]
        quick = descent_without(search, end, [name])
        full = short_fit(search, rest, end.state.poses, SCALE_FROM_NEAR, 9).loss
        assert 0.95 * (full - end.loss) < quick.loss - end.loss < 1.3 * (full - end.loss)
        assert _is_clearly_more(quick.loss, end)
        assert [n for n, _ in quick.state.effects] == [n for n, _ in rest]


def test_a_search_of_fewer_plates_goes_when_it_is_done(coded):
    """Fails if a search refers to itself: gigabytes of windows then wait for the collector of cycles."""
    gc.disable()
    try:
        gone = weakref.ref(joint_way._with_fewer_plates(Search(coded)))
        assert gone() is None
    finally:
        gc.enable()


def test_rounds_end_at_the_floors_of_the_verdict():
    """Fails if rounds go on to floors of repeats alone where the twin's own noise scatters more."""
    solver = SimpleNamespace(score=lambda effects, poses, captures: (poses, {i: {} for i in captures}))
    search = SimpleNamespace(
        solver=solver, test=[0], train=[1], floors_at=lambda effects, poses, groups: {"noise": len(groups)}
    )
    assert exchange.seen(search, base_twin()).floors == {"noise": 2}
