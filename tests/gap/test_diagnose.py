"""The verdict on campaigns made by an image formation that shares no code with the fit."""

from types import SimpleNamespace

import numpy as np
import pytest
from cases import generated_case

from effects import library, pipeline
from gap.climb import climb, conclude, verdict_of
from gap.diagnose import Candidate, Diagnosis, is_there
from gap.fit import LOST_PLATE, Fitter, flatten
from gap.floors import overall_gap
from gap.split import split_by_station

CANDIDATES = ["radial_distortion", "focal_length", "lens_blur", "exposure", "marker_scale", "principal_point"]


def climbed(case, candidates=CANDIDATES):
    diagnosis = Diagnosis(case, candidates)
    diagnosis.set_base([])
    steps, _ = climb(diagnosis, [diagnosis.try_effect(e) for e in candidates])
    return diagnosis, steps


@pytest.fixture(scope="module")
def nothing_hidden(tmp_path_factory):
    return generated_case(tmp_path_factory.mktemp("none"), "none")[0]


def test_nothing_hidden_is_adequate(nothing_hidden):
    """A program that always names something, or that mistakes its own synthesis error for a gap, fails here."""
    diagnosis, steps = climbed(nothing_hidden)
    assert [s.effect for s in steps] == []
    assert verdict_of(steps, diagnosis.base_gap, diagnosis.base_gap_se) == "adequate"


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


@pytest.fixture(scope="module")
def base_residuals(nothing_hidden):
    """Return the whitened residuals of a capture of the ideal twin."""
    return flatten(Fitter(nothing_hidden).residuals_at(0, [], np.zeros(6)))


@pytest.mark.parametrize("effect", sorted(library.available_effects()))
def test_a_candidate_at_its_null_draws_the_base(nothing_hidden, base_residuals, effect, monkeypatch):
    """Fails if an effect's own code, called at its null, draws with other samples than the base: it would win by its drawing.

    Levels are the same to the bit; where points or parts of light are placed anew, or one channel becomes three, to a
    hundredth of a deviation.
    """
    monkeypatch.setattr(pipeline, "acting", lambda name, p: library.nulls_of(name) | dict(p))
    same = Fitter(nothing_hidden).residuals_at(0, [(effect, library.nulls_of(effect))], np.zeros(6))
    exact = library.affects(effect) == "intensity" and not hasattr(library.effect_named(effect), "MAKES_COLOUR")
    np.testing.assert_allclose(flatten(same), base_residuals, rtol=0, atol=0.0 if exact else 0.01)


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
    diagnosis, steps = climbed(case)
    assert [s.effect for s in steps] == [effect]
    hidden = truth["effects"][0]["library_parameters"][library]
    assert abs(dict(diagnosis.effects)[effect][parameter] - hidden) < tolerance


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
    _, steps = climbed(case, [*hidden, other])
    assert {s.effect for s in steps} == set(hidden)


def test_glare_promises_much_beside_a_curve_that_took_it_up(tmp_path):
    """A curve that was fitted alone has taken up how glare lifts black: a promise with that curve held would be next to none."""
    case, _ = generated_case(tmp_path, "pair", seed="meridian", index=11, size="standard")
    diagnosis = Diagnosis(case)
    diagnosis.set_base([])
    diagnosis.adopt(diagnosis.try_effect("tone_curve"))
    promises = diagnosis.promises(["veiling_glare", "denoising", "sensor_noise", "specular_highlight"])
    assert max(promises, key=promises.get) == "veiling_glare"


def test_what_closes_a_small_part_of_a_stranger_gets_no_name(tmp_path):
    """Stuck pixels move the mean of flats: a curve and noise follow that, and are not what is missing."""
    case, _ = generated_case(tmp_path, "outside", seed="meridian", index=29, size="standard")
    candidates = ["tone_curve", "sensor_noise"]
    diagnosis = Diagnosis(case, candidates)
    diagnosis.set_base([])
    found = conclude(diagnosis, [diagnosis.try_effect(e) for e in candidates])
    assert (found.verdict, found.steps) == ("unexplained", [])


def test_a_gap_that_is_left_is_never_called_adequate():
    """A few wild captures make the jackknife's error large: that must not excuse the gap."""
    assert verdict_of([], gap=4.0, gap_se=1.6) == "unexplained"
    assert verdict_of([], gap=1.0, gap_se=0.05) == "adequate"


@pytest.mark.parametrize(
    ("sigma_px", "error", "there"),
    [(1.0, 0.01, True), (1.0, 0.5, False), (0.1, 0.001, False)],
    ids=["clear", "within three standard errors", "too small to matter"],
)
def test_an_effect_is_there_only_where_it_is_certain_and_large_enough(sigma_px, error, there):
    """Without the first bound chance gets names, without the second every synthesis that is off by a hair does."""
    assert is_there("lens_blur", {"sigma_px": sigma_px}, {"sigma_px": error}) == there


def test_a_warp_is_there_though_none_of_its_waves_is_certain_by_itself():
    """Waves stand in for one another where plates are few: asked one by one, none is certain of a warp of many pixels."""
    waves = library.nulls_of("local_warp")
    uncertain = dict.fromkeys(waves, 0.3)
    assert is_there("local_warp", dict.fromkeys(waves, 0.2), uncertain)
    assert not is_there("local_warp", dict.fromkeys(waves, 0.01), uncertain)


@pytest.mark.parametrize(
    ("others", "compared"),
    [([], 0), ([("exposure", {"scale": 2.0})], 0), ([("denoising", {"strength_dn": 9.0})], 2)],
    ids=["alone", "beside another stage", "beside what lies between two places"],
)
def test_places_are_compared_only_where_they_make_a_difference(others, compared):
    """Fails if each place cost predictions for the same image, or the better one were not taken."""
    tried = []

    def residuals_at(i, effects, pose):
        tried.append(dict(effects)["tone_curve"]["place"])
        return {"levels": np.array([3.0 - tried[-1]]), "pose": np.zeros(6)}

    diagnosis = object.__new__(Diagnosis)
    diagnosis.train, diagnosis.fitter = [0], SimpleNamespace(residuals_at=residuals_at)
    curve = library.nulls_of("tone_curve") | {"lift_at_50_pct_dn": 9.0, "place": 0.0}
    best = diagnosis.best_leap("tone_curve", curve, others, ["place"], np.zeros((1, 6)))
    assert len(tried) == compared
    assert best == curve | ({"place": 1.0} if compared else {})


def test_strong_fringes_are_fitted_from_afar(tmp_path):
    """A robust loss that narrows before the fit has come near leaves colours where they were, and a false remainder."""
    case, truth = generated_case(tmp_path, "single", "lateral_chromatic_aberration", seed="far off", strength=2.0)
    diagnosis = Diagnosis(case)
    diagnosis.set_base([])
    found = diagnosis.try_effect("lateral_chromatic_aberration").parameters
    library = truth["effects"][0]["library_parameters"]
    for name in ("red", "blue"):
        assert found[f"{name}_ratio"] == pytest.approx(library[name], abs=2.5e-4)


def test_candidates_are_told_in_the_floors_of_the_verdict(nothing_hidden):
    """Bars in the first base's floors beside a line in the last one's would show that doing nothing helps."""
    diagnosis = Diagnosis(nothing_hidden)
    diagnosis.set_base([])
    floors = {name: floor / 2 for name, floor in diagnosis.floors.items()}
    candidate = diagnosis.null_candidate("exposure")
    assert candidate.gap == pytest.approx(diagnosis.base_gap)
    assert candidate.gap_in(floors) == pytest.approx(overall_gap(diagnosis.base_groups, floors))
    again = Candidate.from_record(candidate.as_record())
    assert again.gap_in(floors) == pytest.approx(candidate.gap_in(floors))


def test_a_jpeg_quality_is_found_across_its_leaps(tmp_path):
    """Quantisation changes by leaps: a fit that creeps from a start far off stays at a wrong quality."""
    case, truth = generated_case(tmp_path, "single", "jpeg_compression", seed="leaps")
    diagnosis = Diagnosis(case)
    diagnosis.set_base([])
    quality = truth["effects"][0]["library_parameters"]["quality"]
    found = diagnosis.try_effect("jpeg_compression").parameters
    assert found["loss"] == pytest.approx(100 - quality, abs=1.0)


def test_a_glossy_lamp_is_seen_from_afar(tmp_path):
    """About its null, a highlight shows a slope only below the nominal lamp: one elsewhere would never be fitted."""
    case, _ = generated_case(tmp_path, "single", "specular_highlight", seed="far lamp 0")  # at x -0.5, y 3.1 m
    diagnosis = Diagnosis(case)
    diagnosis.set_base([])
    promises = diagnosis.promises()
    assert max(promises, key=promises.get) == "specular_highlight"
    assert diagnosis.try_effect("specular_highlight").gap < 0.6 * diagnosis.base_gap


@pytest.fixture(scope="module")
def smeared(tmp_path_factory):
    """A diagnosis of a camera that was smeared and looks askew, its smear in the base."""
    case, truth = generated_case(tmp_path_factory.mktemp("smeared"), "single", "motion_blur")
    diagnosis = Diagnosis(case, CANDIDATES)
    diagnosis.set_base([])
    diagnosis.adopt(diagnosis.try_effect("motion_blur"))
    return diagnosis


def test_held_out_captures_are_scored_at_their_poses_wherever_the_mount_turned_them(smeared):
    """A candidate that turns the camera leaves held-out captures far off: scored before they came back, it would lose."""
    mount = {
        "turn_x_deg": 0.1,
        "turn_y_deg": -1.2,
        "turn_z_deg": 0.1,
        "step_x_m": -0.004,
        "step_y_m": 0.0,
        "step_z_m": -0.013,
    }
    effects = smeared.effects + [("camera_pose_offset", mount)]
    _, turned = smeared.fitter.score(effects, smeared.poses, smeared.test)
    before, after = (
        sum(np.square(groups[i]["corners"]).sum() for i in smeared.test) for groups in (smeared.base_groups, turned)
    )
    assert after < 1.1 * before


def test_a_mount_is_known_as_well_as_the_poses_of_all_captures_tell(smeared):
    """Mount and poses nearly cancel: derivatives that are led along from step to step would make its error any size."""
    candidate = smeared.try_effect("camera_pose_offset")
    known = np.degrees(smeared.case.sigma_pose[:3]) / np.sqrt(len(smeared.train))
    errors = np.array([candidate.errors[f"turn_{axis}_deg"] for axis in "xyz"])
    np.testing.assert_allclose(errors, known, rtol=0.4)


@pytest.mark.parametrize(("lost", "hides"), [(2, False), (3, True)])
def test_a_twin_that_hides_plates_is_told(lost, hides):
    """A lost plate costs less than one that is far off: a glare over all plates would come out best."""
    diagnosis = object.__new__(Diagnosis)
    diagnosis.base_groups = {0: {"corners": np.full((40, 8), 30.0)}}
    corners = np.zeros((40, 8))
    corners[:lost] = LOST_PLATE
    assert diagnosis._hides_plates({0: {"corners": corners}}) == hides
