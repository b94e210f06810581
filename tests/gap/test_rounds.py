"""Rounds of many effects: when they go on, and what takes another's place at their end."""

import weakref
from dataclasses import replace
from types import SimpleNamespace

import pytest
from cases import case_of_several
from stand_in_twins import base_twin, standing_with, twin_with_gaps

from effects import library
from gap.select import exchange, joint_way
from gap.select.exchange import from_best_starts, with_best_starts
from gap.select.joint_way import all_at_once
from gap.select.linear_model import Proposal
from gap.select.outcome import Selection
from gap.select.search import Search


def as_it_is(search, base, twin, end, names=()):
    return twin, end


def found_in_rounds(monkeypatch, one_round, selected, first, told_again=as_it_is):
    """Return the Twin that rounds end with, from a first Proposal until sensor noise is in; nothing is fitted or taken out."""
    for name, stand_in in {
        "_round": one_round, "selected": selected, "linear_model": lambda *_: ([], None),
        "is_at_floor": lambda twin: "sensor_noise" in twin.names, "exchanges": lambda *_: {},
        "pruned": as_it_is, "_with_geometry_told_again": told_again,
    }.items():  # fmt: skip
        monkeypatch.setattr(joint_way, name, stand_in)
    selection = SimpleNamespace(search=SimpleNamespace(), is_spent=lambda: False, progress=None)
    return joint_way._found(selection, base_twin(), base_twin(), ["denoising", "sensor_noise", "sharpening"], first)[0]


@pytest.mark.parametrize(
    ("held", "rival", "loss", "is_taken"),
    [
        ("exposure", "veiling_glare", 900.0, True),
        ("exposure", "veiling_glare", 1100.0, False),
        ("tone_curve", "veiling_glare", 1100.0, True),
        ("tone_curve", "veiling_glare", 1200.0, False),
        ("veiling_glare", "tone_curve", 1100.0, False),
    ],
)
def test_another_takes_the_place_where_held_out_captures_lose_less(monkeypatch, held, rival, loss, is_taken):
    """Fails if what fits the fitted captures alone takes a name; if a curve, which makes up for what is missing besides, keeps
    that of a glare that fits as well and loses a little more held out, or takes it so.
    """
    effects = {n: (n, library.nulls_of(n)) for n in (held, rival)}
    end, other = (SimpleNamespace(state=SimpleNamespace(effects=[effects[n]])) for n in (held, rival))
    monkeypatch.setattr(joint_way, "exchanged", lambda *_: (other, rival, []))
    monkeypatch.setattr(joint_way, "standing", lambda search, base, end: standing_with(end.state.effects, loss))
    twin = standing_with([effects[held]], 1000.0)
    found, *_ = joint_way._with_exchanges(None, base_twin(), twin, end, {held: [rival]})
    assert found.names == [rival if is_taken else held]


@pytest.mark.parametrize(
    ("loss", "moves"), [(900.0, "principal_point"), (990.0, "rolling_shutter")], ids=["less", "as much"]
)
def test_corners_change_a_name_only_where_images_agree(monkeypatch, loss, moves):
    """Fails if corners that others move a little rename what moves points though no capture gains."""
    shutter, point = [(n, library.nulls_of(n)) for n in ("rolling_shutter", "principal_point")]
    monkeypatch.setattr(joint_way, "told_beside_the_rest", lambda *_: ([point], None))
    monkeypatch.setattr(joint_way, "short_fit", lambda *_: "end")
    monkeypatch.setattr(joint_way, "standing", lambda *_: standing_with([point], loss))
    twin = standing_with([shutter], 1000.0)
    found, _ = joint_way._with_geometry_told_again(
        None, base_twin(), twin, None, ["rolling_shutter", "principal_point"]
    )
    assert found.names == [moves]


def test_where_rounds_would_end_corners_tell_once_more_and_they_go_on(monkeypatch):
    """Fails if rounds end where nothing more closes enough as a focal length is missing, which corners tell once it is known what
    else moves them; or if what was dropped for that is not asked for again.
    """
    beside, first = [], Proposal([("defocus", {})], {"defocus": []})
    noise = Proposal([("sensor_noise", {})], {"sensor_noise": []})

    def one_round(search, base, here, proposal):
        beside.append(here.names)
        if proposal.names == ["sensor_noise"] and "focal_length" not in here.names:
            return None, None, None, None
        return replace(here, effects=(*here.effects, *proposal.effects)), "end", {}, set()

    def told(search, base, twin, end, names):
        known = "focal_length" in twin.names
        return (twin if known else replace(twin, effects=(*twin.effects, ("focal_length", {})))), end

    found = found_in_rounds(monkeypatch, one_round, lambda *_, **__: noise, first, told)
    assert beside == [[], ["defocus"], ["defocus", "focal_length"]]
    assert found.names == ["defocus", "focal_length", "sensor_noise"]


def test_what_gave_way_to_a_rival_may_come_back(monkeypatch):
    """Fails if rounds end as soon as what is missing is an effect whose place a rival took: a noise, say, a sharpening's."""
    rounds, of = [], {"sensor_noise": "sharpening"}

    def one_round(search, base, here, proposal):
        rounds.append(proposal.names)
        kept = [(of.get(n, n) if len(rounds) == 1 else n, {}) for n in proposal.names]
        return replace(here, effects=(*here.effects, *kept)), "end", {}, set()

    noise = Proposal([("sensor_noise", {})], {"sensor_noise": []})
    found = found_in_rounds(monkeypatch, one_round, lambda *_, **__: noise, noise)
    assert found.names == ["sharpening", "sensor_noise"]


@pytest.mark.parametrize("closes", [True, False])
def test_noise_is_asked_for_once_where_rounds_end_without(monkeypatch, closes):
    """Fails if rounds end where noise is missing, whose predicted gain is small beside levels that scatter, or ask on for it."""
    asked, noise = [], Proposal([("sensor_noise", {})], {"sensor_noise": []})
    monkeypatch.setattr(joint_way, "missing_noise", lambda *_: (asked.append(1), noise)[1])
    monkeypatch.setattr(joint_way, "_is_nearly_closed", lambda *_: True)

    def one_round(search, base, here, proposal):
        if proposal.names == ["sharpening"] or not (closes or proposal.names == ["denoising"]):
            return None, None, None, None
        return replace(here, effects=(*here.effects, *proposal.effects)), "end", {}, set()

    sharpening, denoising = (Proposal([(n, {})], {n: []}) for n in ("sharpening", "denoising"))
    found = found_in_rounds(monkeypatch, one_round, lambda *_, **__: sharpening, denoising)
    assert found.names == ["denoising", "sensor_noise"][: 1 + closes] and asked == [1]


@pytest.mark.parametrize(("alone", "kept"), [(300.0, ["ink_spread"]), (9000.0, ["tone_curve", "ink_spread"])])
def test_a_first_round_that_is_stuck_gives_way_to_its_leader(monkeypatch, alone, kept):
    """Fails if four names that a fit got stuck with stay where one of them leaves less alone, or one is taken for many."""
    curve, ink = [(n, library.nulls_of(n)) for n in ("tone_curve", "ink_spread")]

    def descent(effects, loss):
        evidence = {"tone_curve": 100.0, "ink_spread": 5000.0}
        return SimpleNamespace(state=SimpleNamespace(effects=effects), loss=loss, evidence=evidence)

    monkeypatch.setattr(joint_way, "_fitted_in", lambda *_: (descent([curve, ink], 5600.0), {}))
    monkeypatch.setattr(exchange, "short_fit", lambda search, effects, *_: descent(effects, alone))
    monkeypatch.setattr(joint_way, "is_idle", lambda *_: False)
    monkeypatch.setattr(joint_way, "standing", lambda search, base, end: standing_with(end.state.effects, end.loss))
    monkeypatch.setattr(joint_way, "patches_of", lambda *_: [])
    monkeypatch.setattr(joint_way, "closes_enough", lambda *_: True)
    search = SimpleNamespace(problem=SimpleNamespace(shows=lambda name: False))
    proposal = Proposal([curve, ink], {"tone_curve": [], "ink_spread": []})
    there, *_ = joint_way._round(search, base_twin(), base_twin(), proposal)
    assert there.names == kept


@pytest.mark.parametrize(("closes", "there"), [((0.1, 0.9), "without the codec first"), ((0.0, 0.9), None)])
def test_a_round_that_a_codecs_steps_hold_is_fitted_without_the_codec_first(monkeypatch, closes, there):
    """Fails if what is right is lost as its fit stuck in a codec's steps, or what closes next to nothing is fitted twice."""
    codec, fall_off = [(n, library.nulls_of(n)) for n in ("jpeg_compression", "vignetting")]
    fits = []

    def fit(search, effects, poses, scale, iterations, rough=()):
        fits.append(rough)
        return SimpleNamespace(state=SimpleNamespace(effects=effects, poses=None), loss=100.0, evidence={})

    first = SimpleNamespace(state=SimpleNamespace(effects=[codec, fall_off], poses=None), loss=500.0, evidence={})
    monkeypatch.setattr(joint_way, "_fitted_in", lambda *_: (first, {}))
    monkeypatch.setattr(joint_way, "short_fit", fit)
    monkeypatch.setattr(joint_way, "is_idle", lambda *_: False)
    monkeypatch.setattr(joint_way, "standing", lambda search, base, end: standing_with(end.state.effects, end.loss))
    monkeypatch.setattr(joint_way, "patches_of", lambda *_: [])
    share_closed = {500.0: closes[0], 100.0: closes[1]}
    monkeypatch.setattr(joint_way, "closes_enough", lambda here, there, share: share_closed[there.losses[0]] > share)
    search = SimpleNamespace(problem=SimpleNamespace(shows=lambda name: name == "jpeg_compression"))
    here = standing_with([codec], 900.0)
    found, *_ = joint_way._round(search, base_twin(), here, Proposal([fall_off], {"vignetting": []}))
    assert (found and found.losses[0]) == (100.0 if there else None)
    assert fits == ([["jpeg_compression"]] if there else [])


def test_many_are_not_looked_for_where_they_ended_or_have_nothing_to_gain(monkeypatch):
    """Fails if a path that adds one effect and comes to where many at once ended pays for the same rounds again, or one that
    leaves less than three of them need for any.
    """
    asked = []
    monkeypatch.setattr(joint_way, "_together", lambda *given: asked.append(given[2].names))
    monkeypatch.setattr(joint_way, "is_at_floor", lambda _: False)
    problem = SimpleNamespace(is_board=False, shows=lambda _: False)
    selection = Selection(SimpleNamespace(problem=problem, cost=0), 10, {})
    selection.ended.add(frozenset(["defocus", "exposure"]))
    for names, left in ((["exposure", "defocus"], 900.0), (["exposure"], 900.0), (["vignetting"], 70.0)):
        all_at_once(selection, None, SimpleNamespace(names=names, excess={"levels": left}), ["sharpening"], {})
    assert asked == [["exposure"]]


@pytest.mark.parametrize(
    ("without_codec", "rounds"),
    [(["sharpening", "exposure", "jpeg_compression"], 1), (["sharpening", "bayer_demosaic", "jpeg_compression"], 2)],
    ids=["as with it", "other"],
)
def test_rounds_begin_once_from_a_set(monkeypatch, without_codec, rounds):
    """Fails if what is proposed without a codec pays for the rounds again that the same effects with it had, or is not tried."""
    begun = []
    monkeypatch.setattr(joint_way, "_with_fewer_plates", lambda search: SimpleNamespace(cost=0))
    monkeypatch.setattr(joint_way, "seen", lambda few, twin: twin)
    monkeypatch.setattr(joint_way, "is_at_floor", lambda _: False)
    monkeypatch.setattr(joint_way, "_found", lambda *given: begun.append(given[4].names) or (base_twin(), [], {}))
    with_it = ["jpeg_compression", "exposure", "sharpening"]
    for propose, names in (("first_proposal", with_it), ("proposal_without_codec", without_codec)):
        proposal = Proposal([(n, {}) for n in names])
        monkeypatch.setattr(joint_way, propose, lambda *_, first=proposal: (first, None, []))
    problem = SimpleNamespace(is_board=False, shows=lambda n: n == "jpeg_compression")
    selection = Selection(SimpleNamespace(problem=problem, cost=0, solver=SimpleNamespace(cost=0)), 10, {})
    twin = twin_with_gaps(levels=9.0)
    assert all_at_once(selection, twin, twin, with_it, {}) is None
    assert len(begun) == rounds


def test_what_rounds_keep_goes_before_all_are_fitted(tmp_path, monkeypatch):
    """Fails if rounds' scenes, gigabytes where plates fill large frames, stay beside those of the fit of all that was found."""
    search, make = Search(case_of_several(tmp_path, ["exposure"], size="tiny")), joint_way._with_fewer_plates
    base, names, kept, seen = search.fitted([]), ["exposure", "vignetting", "lens_blur"], [], []

    def fewer(search):
        few = make(search)
        kept.append(weakref.ref(few.solver.predictor))
        return few

    def fitted(*_):
        seen.append(kept[0]())
        raise StopIteration

    found = replace(base, effects=(("exposure", {"scale": 1.1}),))
    stand_ins = {"_with_fewer_plates": fewer, "_found": lambda *_: (found, ["exposure"], {})}
    for name, stand_in in stand_ins.items():
        monkeypatch.setattr(joint_way, name, stand_in)
    monkeypatch.setattr(Search, "fitted", fitted)
    proposal = Proposal([(n, library.nulls_of(n)) for n in names])
    with pytest.raises(StopIteration):
        joint_way._together(
            Selection(search, 9999, {}), base, base, names, {}, (), lambda *_: (proposal, base.poses, [])
        )
    assert seen == [None]


@pytest.mark.parametrize(("fitted", "strength_dn"), [(["exposure"], 8.0), ([], 3.0)], ids=["later", "first"])
def test_a_later_round_begins_where_a_start_leaves_least(monkeypatch, fitted, strength_dn):
    """Fails if a filter begins as another where a start of its own leaves less, or a first round does not trust its guesses."""
    monkeypatch.setattr(exchange, "probes", lambda train: train)
    monkeypatch.setattr(exchange, "robust_scale_of", lambda groups: 1.0)
    monkeypatch.setattr(exchange, "total", lambda left, nu: left)
    off = SimpleNamespace(residuals_of=lambda effects, *_: abs(dict(effects)["denoising"]["strength_dn"] - 9.0))
    problem = SimpleNamespace(starts_of=library.starts_of)
    search = SimpleNamespace(solver=off, problem=problem, train=[0], free=lambda effects: effects)
    twin = SimpleNamespace(effects=[(name, {}) for name in fitted], poses=None)
    guess = Proposal([("denoising", library.nulls_of("denoising") | {"strength_dn": 3.0})])
    assert dict(with_best_starts(search, twin, guess))["denoising"]["strength_dn"] == strength_dn


@pytest.mark.parametrize(("focus_m", "found"), [(0.5, 0.9), (0.9, 0.9)], ids=["in a wrong minimum", "right"])
def test_what_is_in_a_wrong_local_minimum_begins_anew_from_its_starts(monkeypatch, focus_m, found):
    """Fails if a lens that is in focus nearer than all plates stays so where it leaves less in focus beyond them, if what is
    right begins anew, or if what moves points or has one start is fitted again.
    """
    fitted = []

    def descend(effects, free, *_):
        fitted.append(free)
        focus = dict(effects)["defocus"]["focus_m"]
        there = 0.9 if focus > 1 else focus  # from the farther start alone the way leads there
        effects = [(n, p | {"focus_m": there} if n == "defocus" else p) for n, p in effects]
        return SimpleNamespace(state=SimpleNamespace(effects=effects, poses="moved"), loss=100 + 1e4 * abs(there - 0.9))

    names = ["focal_length", "vignetting", "defocus"]
    effects = [(n, library.nulls_of(n)) for n in names[:2]] + [("defocus", {"focus_m": focus_m})]
    end = SimpleNamespace(state=SimpleNamespace(effects=effects, poses="here"), loss=100 + 1e4 * abs(focus_m - 0.9))
    problem = SimpleNamespace(starts_of=library.starts_of, shows=lambda _: False)
    solver = SimpleNamespace(descend=descend)
    search = SimpleNamespace(problem=problem, solver=solver, train=[0], free=lambda e: [(n, "focus_m") for n, _ in e])
    effects, poses = from_best_starts(search, end, names)
    assert [n for n, _ in effects] == names and dict(effects)["defocus"]["focus_m"] == found
    assert poses == ("here" if focus_m == found else "moved") and fitted == [[("defocus", "focus_m")]] * 2


def test_of_many_starts_those_are_fitted_that_leave_least(monkeypatch):
    """Fails if a highlight is fitted from all places of its lamp, or from the first ones whatever they leave."""
    monkeypatch.setattr(exchange, "probes", lambda train: train)
    monkeypatch.setattr(exchange, "total", lambda left, nu: left)
    off = SimpleNamespace(residuals_of=lambda effects, *_: abs(dict(effects)["specular_highlight"]["y_m"] - 2.3))
    search = SimpleNamespace(solver=off, problem=SimpleNamespace(starts_of=library.starts_of), train=[0])
    end = SimpleNamespace(state=SimpleNamespace(effects=[("specular_highlight", {})], poses=None))
    nearest = exchange._nearest_starts(search, end, "specular_highlight")
    assert len(nearest) == 2 and {start["y_m"] for start in nearest} == {2.2}


@pytest.mark.parametrize(("is_idle", "kept"), [(True, ["denoising"]), (False, ["denoising", "sensor_noise"])])
def test_what_came_along_for_nothing_goes_before_the_others_are_judged(monkeypatch, is_idle, kept):
    """Fails if a filter that only a noise needed, which is not there, stays when that goes, or noise that is there goes."""
    both = [(n, library.nulls_of(n)) for n in ("denoising", "sensor_noise")]

    def fitted(search, here, proposal):
        return SimpleNamespace(state=SimpleNamespace(effects=proposal.effects), loss=100.0, evidence={}), {}

    monkeypatch.setattr(joint_way, "_fitted_in", fitted)
    monkeypatch.setattr(joint_way, "or_leader_alone", lambda search, here, proposal, end, _: end)
    monkeypatch.setattr(joint_way, "is_idle", lambda search, effects, name, _: is_idle and name == "sensor_noise")
    monkeypatch.setattr(joint_way, "descent_without", lambda *_: pytest.fail("the noise went alone"))
    monkeypatch.setattr(joint_way, "standing", lambda search, base, end: standing_with(end.state.effects, end.loss))
    monkeypatch.setattr(joint_way, "patches_of", lambda *_: [])
    monkeypatch.setattr(joint_way, "closes_enough", lambda *_: True)
    search = SimpleNamespace(problem=SimpleNamespace(shows=lambda name: False))
    rivals = {"denoising": [], "sensor_noise": ["fixed_pattern_noise"]}
    proposal = Proposal(both, rivals, ("sensor_noise",), Proposal(both[:1], rivals))
    there, *_ = joint_way._round(search, base_twin(), base_twin(), proposal)
    assert there.names == kept


@pytest.mark.parametrize("closes", [True, False])
def test_what_a_round_fits_further_stays_though_nothing_new_does(monkeypatch, closes):
    """Fails if a fit that was not at its end is thrown away with the idle effect beside which it went on, or one that was is
    taken for a round's.
    """
    here = standing_with([("defocus", library.nulls_of("defocus"))], 1000.0)
    new = ("motion_blur", library.nulls_of("motion_blur"))
    end = SimpleNamespace(state=SimpleNamespace(effects=[*here.effects, new]), loss=100.0, evidence={})
    rest = SimpleNamespace(state=SimpleNamespace(effects=list(here.effects)), loss=100.0, evidence={})
    monkeypatch.setattr(joint_way, "_fitted_in", lambda *_: (end, {}))
    monkeypatch.setattr(joint_way, "is_idle", lambda *_: True)
    monkeypatch.setattr(joint_way, "descent_without", lambda *_: rest)
    monkeypatch.setattr(joint_way, "standing", lambda search, base, end: standing_with(end.state.effects, end.loss))
    monkeypatch.setattr(joint_way, "closes_enough", lambda *_: closes)
    there, at, _, went = joint_way._round(None, base_twin(), here, Proposal([new], {"motion_blur": []}))
    assert (there and there.names, at, went) == ((["defocus"], rest, {"motion_blur"}) if closes else (None,) * 3)
