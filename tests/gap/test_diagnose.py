"""The verdict on campaigns made by an image formation that shares no code with the fit."""

from types import SimpleNamespace

import numpy as np
import pytest
from cases import case_of_several, generated_case

from diagnose_camera import ranked
from effects import library, pipeline
from gap.fit.residuals import LOST_PLATE, flatten
from gap.fit.score import overall_gap
from gap.fit.split import split_by_station
from gap.select.discrete import Discrete
from gap.select.exchange import one_of
from gap.select.naming import errors_to_exceed, is_significant
from gap.select.outcome import Selection, Step, outcome_of
from gap.select.search import Search
from gap.select.select_effects import _with_simpler, verdict
from gap.select.standing import verdict_of

CANDIDATES = ["radial_distortion", "focal_length", "lens_blur", "exposure", "marker_scale", "principal_point"]


def named(outcome):
    """Return the names of an outcome's steps."""
    return [step.effect for step in outcome.steps]


@pytest.fixture(scope="module")
def nothing_hidden(tmp_path_factory):
    return generated_case(tmp_path_factory.mktemp("none"), "none")[0]


def test_nothing_hidden_is_adequate(nothing_hidden):
    """A program that always names something, or that mistakes its own synthesis error for a gap, fails here."""
    _, _, _, outcome = verdict(nothing_hidden, candidates=CANDIDATES)
    assert named(outcome) == []
    assert outcome.verdict == "adequate"


def test_a_verdict_depends_on_its_arguments_alone(nothing_hidden):
    """Fails if something kept from other predictions, or the number of threads, changed a number: processes would not agree."""
    first = verdict(nothing_hidden, candidates=["lens_blur", "exposure"])[3]
    search = Search(nothing_hidden)
    search.try_effect(search.fitted([("vignetting", {"a2": 0.2, "a4": 0.0, "a6": 0.0})]), "sharpening")
    again = verdict(nothing_hidden, candidates=["lens_blur", "exposure"], threads=2)[3]
    assert first.twin.gap == again.twin.gap
    np.testing.assert_array_equal(first.twin.poses, again.twin.poses)


def test_stations_are_split_whole(nothing_hidden):
    """Trials of one station on both sides would let a fit see what it is scored on."""
    train, test = split_by_station(nothing_hidden)
    stations = [{nothing_hidden.captures[i].view.station for i in part} for part in (train, test)]
    assert stations[0] and stations[1] and not stations[0] & stations[1]


def test_held_out_plates_lie_where_some_were_fitted():
    """Stations that see the left half only, all fitted, would leave the right half to what a warp does where it saw nothing."""

    def capture(station, column_px):
        corners = column_px + np.array([[0.0, 0.0], [9.0, 0.0], [9.0, 9.0], [0.0, 9.0]])[None]
        seen = SimpleNamespace(corners=corners, measured=np.array([True]))
        return SimpleNamespace(view=SimpleNamespace(station=station), observation=seen)

    case = SimpleNamespace(captures=[capture(s, x) for s, x in (("a", 50), ("b", 800), ("c", 810), ("d", 60))])
    train, test = split_by_station(case)
    assert len(train) == len(test) == 2
    assert len({0, 3} & set(train)) == 1


@pytest.mark.parametrize("effect", sorted(library.available_effects()))
def test_a_candidate_at_its_null_draws_the_base(nothing_hidden, effect, monkeypatch):
    """Fails if an effect's own code, called at its null, draws with other samples than the base: it would win by its drawing.

    Levels are the same to the bit; where points or parts of light are placed anew, or one channel becomes three, to a
    hundredth of a deviation.
    """
    monkeypatch.setattr(pipeline, "reach_px", lambda chosen: 8)  # the same windows for both
    base = Search(nothing_hidden).solver.residuals(0, [], np.zeros(6))
    monkeypatch.setattr(pipeline, "acting", lambda name, p: library.nulls_of(name) | dict(p))
    same = Search(nothing_hidden).solver.residuals(0, [(effect, library.nulls_of(effect))], np.zeros(6))
    exact = library.affects(effect) == "intensity" and not hasattr(library.effect_named(effect), "MAKES_COLOUR")
    np.testing.assert_allclose(flatten(same), flatten(base), rtol=0, atol=0.0 if exact else 0.01)


@pytest.mark.parametrize(
    ("effect", "parameter", "library", "tolerance"),
    [
        ("focal_length", "ratio", "ratio", 3e-4),
        ("lens_blur", "sigma_px", "sigma_px", 0.02),
        ("exposure", "scale", "scale", 3e-3),
    ],
)
def test_a_single_hidden_effect_is_named_and_measured(tmp_path, effect, parameter, library, tolerance):
    """A search that names another effect, adds a second one, or biases the parameter fails here."""
    case, truth = generated_case(tmp_path, "single", effect)
    _, _, _, outcome = verdict(case, candidates=CANDIDATES)
    assert named(outcome) == [effect]
    hidden = truth["effects"][0]["library_parameters"][library]
    assert abs(dict(outcome.twin.effects)[effect][parameter] - hidden) < tolerance


@pytest.mark.parametrize(
    ("seed", "index", "hidden", "other"),
    [
        ("ecliptic", 10, ["sensor_noise", "tone_curve"], "fixed_pattern_noise"),
        ("nadir", 14, ["focal_length", "rolling_shutter"], "principal_point"),
    ],
)
def test_what_the_first_step_made_up_for_is_found_beside_it(tmp_path, seed, index, hidden, other):
    """A curve fitted alone takes up how noise moves clipped black, a sheared shutter how a lens is longer: what is tried
    beside it, it held, seems to do harm, or nothing.
    """
    case, truth = generated_case(tmp_path, "pair", seed=seed, index=index, size="standard")
    assert [e["effect"] for e in truth["effects"]] == hidden
    _, _, _, outcome = verdict(case, candidates=[*hidden, other])
    assert set(named(outcome)) == set(hidden)


def test_glare_has_the_largest_predicted_gain_beside_a_curve_that_took_it_up(tmp_path):
    """A curve fitted alone has taken up how glare lifts black: with that curve held its predicted gain would be next to none."""
    case, _ = generated_case(tmp_path, "pair", seed="meridian", index=11, size="standard")
    search = Search(case)
    twin = search.adopt(search.try_effect(search.fitted([]), "tone_curve"))
    gains = search.predicted_gains(twin, ["veiling_glare", "denoising", "sensor_noise", "specular_highlight"])
    assert max(gains, key=gains.get) == "veiling_glare"


def test_what_closes_a_small_part_of_an_effect_outside_the_library_gets_no_name(tmp_path):
    """Stuck pixels move the mean of flats: a curve and noise follow that, and are not what is missing."""
    case, _ = generated_case(tmp_path, "outside", seed="meridian", index=29, size="standard")
    _, _, _, outcome = verdict(case, candidates=["tone_curve", "sensor_noise"])
    assert (outcome.verdict, outcome.steps) == ("unexplained", ())


def test_a_gap_that_is_left_is_never_called_adequate():
    """A few wild captures make the jackknife's error large: that must not excuse the gap."""
    assert verdict_of([], SimpleNamespace(gap=4.0, gap_se=1.6)) == "unexplained"
    assert verdict_of([], SimpleNamespace(gap=1.0, gap_se=0.05)) == "adequate"


@pytest.mark.parametrize(
    ("sigma_px", "error", "there"),
    [(1.0, 0.01, True), (1.0, 0.5, False), (0.1, 0.001, False)],
    ids=["clear", "within three standard errors", "too small to matter"],
)
def test_an_effect_is_there_only_where_it_is_certain_and_large_enough(sigma_px, error, there):
    """Without the first bound chance gets names, without the second every synthesis that is off by a hair does."""
    assert is_significant("lens_blur", {"sigma_px": sigma_px}, {("lens_blur", "sigma_px"): error}) == there


@pytest.mark.parametrize(
    ("gains", "excess", "doubted"),
    [
        ((1500.0, 0.0, 0.0), 1550.0, False),
        ((300.0, 0.0, 0.0), 550.0, True),
        ((700.0, 0.0, 0.0), 1550.0, True),
        ((110.0, 80.0, 110.0), 550.0, False),
        ((110.0, 80.0, 110.0), 1550.0, False),
        ((110.0, 0.0, 110.0), 1550.0, True),
    ],
    ids=[
        "most of it",
        "little, of one station",
        "a part",
        "little, of all stations",
        "a part, of all stations",
        "of some",
    ],
)
def test_what_gains_most_on_captures_that_no_fit_saw_is_not_doubted(gains, excess, doubted):
    """Fails if the one station that tells leaves an effect uncertain where it is held out, if what it gains is certain where that
    is a part of the gap, or if what stations agree about is doubted for being little, as all is of a few photographs.
    """
    captures = [SimpleNamespace(view=SimpleNamespace(station=f"s{k}")) for k in range(3)]
    base = SimpleNamespace(losses={k: 2000.0 for k in range(3)}, excess={"corners": excess})
    losses = {k: 2000.0 - gain for k, gain in enumerate(gains)}
    twin = SimpleNamespace(losses=losses, cautious_errors={("rail_sag", "bow_m"): 0.1})
    assert bool(errors_to_exceed(SimpleNamespace(captures=captures), base, twin)) == doubted


def test_a_warp_is_there_though_none_of_its_waves_is_certain_by_itself():
    """Waves stand in for one another where plates are few: asked one by one, none is certain of a warp of many pixels."""
    waves = library.nulls_of("local_warp")
    uncertain = {("local_warp", wave): 0.3 for wave in waves}
    assert is_significant("local_warp", dict.fromkeys(waves, 0.2), uncertain)
    assert not is_significant("local_warp", dict.fromkeys(waves, 0.01), uncertain)


@pytest.mark.parametrize(
    ("others", "compared"),
    [([], 0), ([("exposure", {"scale": 2.0})], 0), ([("denoising", {"strength_dn": 9.0})], 2)],
    ids=["alone", "beside another stage", "beside what lies between two places"],
)
def test_places_are_compared_only_where_they_make_a_difference(others, compared):
    """Fails if each place cost predictions for the same image, or the better one were not taken."""
    tried = []

    def residuals(i, start, effects, pose):
        tried.append(dict(effects)["tone_curve"]["place"])
        return {"levels": np.array([3.0 - tried[-1]]), "pose": np.zeros(6)}

    discrete = Discrete(SimpleNamespace(residuals_towards=residuals), [0], lambda parameter: False)
    curve = library.nulls_of("tone_curve") | {"lift_at_50_pct_dn": 9.0, "place": 0.0}
    best = discrete.best_values("tone_curve", curve, others, ["place"], np.zeros((1, 6)))
    assert len(tried) == compared
    assert best == curve | ({"place": 1.0} if compared else {})


def test_strong_fringes_are_fitted_from_afar(tmp_path):
    """A robust loss that narrows before the fit has come near leaves colours where they were, and a false remainder."""
    case, truth = generated_case(tmp_path, "single", "lateral_chromatic_aberration", seed="far off", strength=2.0)
    search = Search(case)
    found = search.try_effect(search.fitted([]), "lateral_chromatic_aberration").parameters
    library = truth["effects"][0]["library_parameters"]
    for name in ("red", "blue"):
        assert found[f"{name}_ratio"] == pytest.approx(library[name], abs=2.5e-4)


def test_candidates_are_told_in_the_floors_of_the_verdict(nothing_hidden):
    """Bars in the first base's floors beside a line in the last one's would show that doing nothing helps."""
    search = Search(nothing_hidden)
    base = search.fitted([])
    candidate = search.null_candidate(base, "exposure")
    floors = {name: floor / 2 for name, floor in base.floors.items()}
    (told,) = ranked([candidate], floors)
    assert told["gap_after"] == pytest.approx(overall_gap(base.groups, floors))
    assert told["gap_after"] > 1.5 * base.gap


def test_a_search_that_comes_back_ends():
    """Fails if a set of effects that was had before were searched again: the same steps from other first ones took minutes."""
    selection = Selection(SimpleNamespace(cost=0), 10, {})
    assert selection.is_new(["lens_blur", "vignetting"])
    assert not selection.is_new(["vignetting", "lens_blur"])
    assert not selection.is_spent()


def test_a_jpeg_quality_is_found_across_its_leaps(tmp_path):
    """Quantisation changes discontinuously: a fit that creeps from a start far off stays at a wrong quality."""
    case, truth = generated_case(tmp_path, "single", "jpeg_compression", seed="leaps")
    search = Search(case)
    quality = truth["effects"][0]["library_parameters"]["quality"]
    found = search.try_effect(search.fitted([]), "jpeg_compression").parameters
    assert found["loss"] == pytest.approx(100 - quality, abs=1.0)


def test_a_glossy_lamp_is_seen_from_afar(tmp_path):
    """About its null, a highlight shows a slope only below the nominal lamp: one elsewhere would never be fitted."""
    case, _ = generated_case(tmp_path, "single", "specular_highlight", seed="far lamp 0")  # at x -0.5, y 3.1 m
    search = Search(case)
    base = search.fitted([])
    gains = search.predicted_gains(base, search.candidates)
    assert max(gains, key=gains.get) == "specular_highlight"
    assert search.try_effect(base, "specular_highlight").twin.gap < 0.6 * base.gap


@pytest.fixture(scope="module")
def motion_blurred(tmp_path_factory):
    """(Search, Twin) of a camera with motion blur that looks misaligned, the blur in the twin."""
    case, _ = generated_case(tmp_path_factory.mktemp("motion_blurred"), "single", "motion_blur")
    search = Search(case, CANDIDATES)
    return search, search.adopt(search.try_effect(search.fitted([]), "motion_blur"))


def test_held_out_captures_are_scored_at_their_poses_wherever_the_mount_turned_them(motion_blurred):
    """A candidate that turns the camera leaves held-out captures far off: scored before they came back, it would lose."""
    search, twin = motion_blurred
    mount = {
        "turn_x_deg": 0.1,
        "turn_y_deg": -1.2,
        "turn_z_deg": 0.1,
        "step_x_m": -0.004,
        "step_y_m": 0.0,
        "step_z_m": -0.013,
    }
    _, turned = search.solver.score([*twin.effects, ("camera_pose_offset", mount)], twin.poses, search.test)
    before, after = (sum(np.square(g[i]["corners"]).sum() for i in search.test) for g in (twin.groups, turned))
    assert after < 1.1 * before


def test_a_mount_is_known_as_well_as_the_poses_of_all_captures_tell(motion_blurred):
    """Mount and poses nearly cancel: derivatives that are led along from step to step would make its error any size."""
    search, twin = motion_blurred
    candidate = search.try_effect(twin, "camera_pose_offset")
    known = np.degrees(search.problem.sigma_pose[:3]) / np.sqrt(len(search.train))
    errors = np.array([candidate.twin.errors["camera_pose_offset", f"turn_{axis}_deg"] for axis in "xyz"])
    np.testing.assert_allclose(errors, known, rtol=0.4)


def test_what_the_user_fixed_stays_fixed_parameter_by_parameter(motion_blurred):
    """Fails if a number beside a `fit` in a twin file were refitted from the first adoption on."""
    search, _ = motion_blurred
    with_fixed = Search(search.problem, CANDIDATES, fixed={("vignetting", "a2")})
    twin = with_fixed.fitted([("vignetting", {"a2": 0.03, "a4": 0.0, "a6": 0.0})])
    assert dict(twin.effects)["vignetting"]["a2"] == 0.03
    assert dict(twin.effects)["vignetting"]["a4"] != 0.0
    adopted = with_fixed.adopt(with_fixed.try_effect(twin, "exposure"))
    assert dict(adopted.effects)["vignetting"]["a2"] == 0.03
    assert ("vignetting", "a2") not in adopted.errors
    assert with_fixed.is_fixed("vignetting") and not with_fixed.is_fixed("exposure")


@pytest.mark.parametrize(("lost", "hides"), [(6, False), (7, True)])
def test_a_twin_that_hides_plates_is_told(lost, hides):
    """A lost plate costs less than one that is far off: a glare over all plates would come out best."""
    base = SimpleNamespace(groups={0: {"corners": np.full((40, 8), 30.0)}})
    corners = np.zeros((40, 8))
    corners[:lost] = LOST_PLATE
    search = object.__new__(Search)
    assert search._hides_plates(base, SimpleNamespace(groups={0: {"corners": corners}})) == hides


@pytest.mark.parametrize(
    ("hidden", "simpler"),
    [
        (["exposure"], ["exposure"]),
        (["tone_curve"], []),
        (["exposure", "veiling_glare"], ["exposure", "veiling_glare"]),
    ],
    ids=["exposure", "curve", "two"],
)
def test_a_curve_gives_way_to_what_it_only_mimics(tmp_path, hidden, simpler):
    """Fails if a curve keeps the name of an exposure, alone or with a glare, or a real curve loses its own to several others; or
    if a short fit does not tell which may do as well: others would be fitted whole for nothing, or none at all.
    """
    case = case_of_several(tmp_path, hidden)
    search = Search(case)
    base = search.fitted([])
    twin = search.fitted([("tone_curve", library.nulls_of("tone_curve"))])
    others = ["exposure", "veiling_glare", "ink_reflectance", "colour_balance"]
    found = Step("tone_curve", twin, (search.null_candidate(base, "exposure"),), ("ink_reflectance",), "levels")
    first = [search.null_candidate(base, name) for name in others]
    best = outcome_of(case, [found], [], twin, base.excess)
    instead = _with_simpler(Selection(search, 60_000, {}), base, first, best, base.excess)
    assert named(instead) == (simpler or ["tone_curve"])
    assert instead.twin.names == named(instead)
    alone = search.may_do_as_well(twin, [("exposure", library.nulls_of("exposure"))])
    assert alone == (simpler == ["exposure"])
    of_the_curve = ("ink_reflectance",)  # doubles that are not another effect's
    assert instead.steps[0].confused_with == (() if simpler else of_the_curve)


@pytest.mark.parametrize(
    ("hidden", "other", "one_of_both"),
    [("fixed_pattern_noise", "sensor_noise", True), ("sensor_noise", "fixed_pattern_noise", False)],
)
def test_what_does_as_well_in_a_rigs_last_twin_stands_for_the_name(tmp_path, hidden, other, one_of_both):
    """Fails if an effect that is not fitted in the other's place, or costs what a name does, would stand for it: a pattern is
    noise within one image, noise that repeats in no image is no pattern.
    """
    search = Search(case_of_several(tmp_path, [hidden]))
    start = {name: search.problem.starts_of(name)[0] for name in (hidden, other)}
    twin = search.fitted([(hidden, start[hidden])])
    assert one_of(search, twin, hidden, [(other, start[other])]) == ((hidden, other) if one_of_both else ())


def test_what_moves_points_far_is_told_together(tmp_path):
    """Fails if moves that hide one another are tried one by one only, or if a needless one keeps its name."""
    hidden = ["focal_length", "principal_point", "radial_distortion"]
    case = case_of_several(tmp_path, hidden)
    _, _, _, found = verdict(case, candidates=[*hidden, "marker_scale", "lens_blur"])
    assert sorted(named(found)) == hidden
    assert found.verdict == "explained"
    assert [len(step.twin.names) for step in found.steps] == [1, 2, 3]
