"""What a verdict, a ladder and a twin's file are made of, from values whose answers are known."""

import io
import time
from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest
from drawn import scene_and_view

from case_files import OBSERVED, load_observations, save_observations
from gap.explain import next_station
from gap.explain.ladder import interval, summary
from gap.fit.residuals import RHO_NOISE, rho
from gap.measure.capture import Codes, Observation
from gap.problem import Capture, Case, encoding_table
from gap.select.outcome import confused_with
from inputs.twins import load_twin
from rig.geometry import station_pose

# -- candidates that cannot be told apart ------------------------------------------------------------------------------

STATIONS = ["a", "a", "b", "b", "c", "c", "d", "d"]  # of eight held-out captures
PROBLEM = SimpleNamespace(captures=[SimpleNamespace(view=SimpleNamespace(station=s)) for s in STATIONS])


def candidate(effect, behind=(0, 0, 0, 0), gain=1000.0):
    """Return a candidate whose loss is larger than the best one's by ``behind`` at each of four stations."""
    losses = {2 * k + trial: 100.0 + b / 2 for k, b in enumerate(behind) for trial in (0, 1)}
    return SimpleNamespace(effect=effect, gain=gain, twin=SimpleNamespace(losses=losses))


@pytest.mark.parametrize(
    ("other", "of_best", "confused"),
    [
        (candidate("equal"), 1000, True),
        (candidate("far worse at every station", (100, 100, 100, 100)), 1000, False),
        (candidate("worse by less than a gain counts", (6, 6, 6, 6)), 1000, True),
        (candidate("worse by more than that", (7, 7, 7, 7)), 1000, False),
        (candidate("worse within the stations' scatter", (150, -50, 150, -50)), 2000, True),
        (candidate("worse by a fifth of the best gain", (150, -50, 150, -50)), 500, False),
        (candidate("equal, of no gain", gain=24.0), 1000, False),
        (candidate("best"), 1000, False),
    ],
    ids=lambda value: getattr(value, "effect", None),
)
def test_candidates_are_confused_where_stations_do_not_tell_them_apart(other, of_best, confused):
    """Fails if the sign is lost, captures count in stations' place, scatter has no limit, or the best confuses itself."""
    best = candidate("best", gain=of_best)
    assert confused_with(PROBLEM, best, [best, other]) == ([other.effect] if confused else [])


# -- where to capture next ---------------------------------------------------------------------------------------------


def small_case(sigma_pose=np.inf):
    """Return a Case with one view of two plates, nothing measured."""
    scene, view = scene_and_view()
    view = view.__class__(**(view.__dict__ | {"encoding": "linear"}))
    codes = Codes.of(scene.plates, [scene.white, scene.black, scene.ground], encoding_table("linear", 1.0))
    return Case("c", "cam", scene, codes, [Capture(view, 0)], np.full(6, sigma_pose))


def nearness(case, height_m, tilt_deg, a, b):
    """Return a difference that is largest at 0.8 m and 45 degrees."""
    return 7.126 - abs(height_m - 0.8) - abs(tilt_deg - 45) / 100


def test_the_station_of_the_largest_difference_is_suggested_that_was_not_photographed(monkeypatch):
    """Fails if the first or the last station wins, the pose is not that of the station that is named, or the same one is
    suggested again and again."""
    monkeypatch.setattr(next_station, "_difference", nearness)
    case = small_case()
    assert next_station.suggested_station(case, [], []) == {"height_m": 0.8, "tilt_deg": 45.0, "difference": 7.13}
    near = station_pose(0.805, 45.5)  # as a tripod stands
    taken = replace(case.captures[0], view=replace(case.captures[0].view, T_cam_world=near))
    found = next_station.suggested_station(replace(case, captures=[taken]), [], [])
    assert (found["height_m"], found["tilt_deg"]) == (0.8, 30.0)


def test_a_station_that_would_be_fitted_is_suggested_only_where_no_other_tells(monkeypatch):
    """Fails if the largest difference wins though it would teach the twins and not be held against them."""
    scores = {(0.8, 45.0): 900.0, (0.5, 30.0): 300.0}
    monkeypatch.setattr(next_station, "_difference", lambda case, h, t, a, b: scores.get((h, t), 1.0))
    for held_out, best in (((0.5, 30.0), (0.5, 30.0)), ((0.5, 15.0), (0.8, 45.0))):
        monkeypatch.setattr(next_station, "_is_held_out", lambda case, h, t, twin, known=held_out: (h, t) == known)
        found = next_station.suggested_station(small_case(), [], [])
        assert (found["height_m"], found["tilt_deg"]) == best


def test_what_a_pose_could_move_does_not_tell_twins_apart():
    """Fails if the pose is not fitted, or beyond its prior: a shift of the image then counts always, or never."""
    shifted = [("principal_point", {"dx_px": 0.5, "dy_px": 0.0})]
    held, free = (next_station._difference(small_case(sigma), 0.5, 35, [], shifted) for sigma in (1e-9, np.inf))
    assert held > 50
    assert free < 0.1 * held


def test_levels_and_edges_tell_twins_apart_and_noise_does_not():
    """Fails if only points are compared, or if a twin differs from its own photograph by the noise that it has."""
    darker, blurred = [("exposure", {"scale": 0.9})], [("lens_blur", {"sigma_px": 1.0, "softness": 0.0})]
    same, by_levels, by_edges = (
        next_station._difference(small_case(1e-9), 0.5, 35, [], other) for other in ([], darker, blurred)
    )
    assert same < 0.05 * min(by_levels, by_edges)


def test_a_difference_counts_that_shows_whichever_twin_is_true(monkeypatch):
    """Fails if one of two twins is taken for the truth: what only the other one's photograph would show is then promised."""
    monkeypatch.setattr(next_station, "_photograph", lambda case, height_m, tilt_deg, truth: truth)
    monkeypatch.setattr(next_station, "_loss", lambda case, truth, rival: 3.0 if truth == "a" else 1.0)
    ab, ba = (next_station._difference(None, 0.5, 35, *twins) for twins in ("ab", "ba"))
    assert ab == ba == 1.0


def test_where_no_plate_is_seen_nothing_differs():
    """Fails if a station that looks past the rig ends the suggestion with an error, blurred in several ways."""
    blurred = [("defocus", {"blur_px_per_dioptre": 1.0, "focus_m": 0.7, "softness": 1.0})]
    assert next_station._difference(small_case(), 1.6, -60, [], blurred) == 0.0


# -- the ladder's errors -----------------------------------------------------------------------------------------------

PARTS = {
    4: {
        "corners": np.array([1.0, 1.0, 1.0]), "intensity": 4.0, "available": 10, "disagree": 5,
        "distance": np.array([1.0, 2.0]), "rotation": np.array([]), "groups": {"field": np.full(5, 2.0)},
    },
    7: {
        "corners": np.array([9.0]), "intensity": 16.0, "available": 90, "disagree": 5,
        "distance": np.array([6.0]), "rotation": np.array([]), "groups": {"field": np.full(5, 2.0)},
    },
}  # fmt: skip
EXPECTED = {
    "corner_rmse_px": np.sqrt(12 / 4),
    "intensity_rmse_dn": np.sqrt(10),
    "detection_disagreement_pct": 10.0,
    "delta_distance_cm": 3.0,
    "delta_rotation_deg": np.nan,
    "gap": np.sqrt(rho(2.0) / RHO_NOISE) / 0.5,
}


@pytest.mark.parametrize("measure", EXPECTED)
def test_a_measure_sums_up_captures(measure):
    """Fails if captures count alike whatever they show, squares are not rooted, or nothing compared is no error."""
    assert summary(PARTS, measure, {"field": 0.5}) == pytest.approx(EXPECTED[measure], nan_ok=True)


def test_the_interval_of_two_captures_ends_at_each_ones_own_error():
    """Fails if captures are drawn without replacement, or fewer than there are: a quarter of draws has one capture twice."""
    low, high = interval(PARTS, "intensity_rmse_dn", {}, "seed")
    assert (low, high) == (2.0, 4.0)
    assert np.isnan(interval(PARTS, "delta_rotation_deg", {}, "seed")).all()


# -- files -------------------------------------------------------------------------------------------------------------


def observed_case(filled):
    """Return a case of two captures, with observations where filled."""

    def observation(k):
        values = {name: np.random.default_rng([k, n]).normal(size=(3, 2)) for n, name in enumerate(OBSERVED)}
        values["noise"][0] = np.nan
        return Observation(**values | {"measured": np.array([True, False, k == 1]), "regions": np.arange(8) + k})

    return SimpleNamespace(
        captures=[
            SimpleNamespace(
                observation=observation(k) if filled else None,
                noise_variance=0.1 + k if filled else 1.0,
                starts={"jpeg_compression": {"loss": 30.0 + k}} if filled else {},
            )
            for k in range(2)
        ]
    )


def test_observations_come_back_bit_for_bit_and_as_the_same_bytes(tmp_path, monkeypatch):
    """Fails if an array is left out, rounded or given to another capture, or the file holds the time of its writing."""
    files = []
    for now in (1.0e9, 1.5e9):
        monkeypatch.setattr(time, "time", lambda now=now: now)
        file = io.BytesIO()
        save_observations(file, observed_case(filled=True))
        files.append(file.getvalue())
    assert files[0] == files[1]
    (tmp_path / "o.npz").write_bytes(files[0])
    case = observed_case(filled=False)
    load_observations(tmp_path / "o.npz", case)
    for loaded, saved in zip(case.captures, observed_case(filled=True).captures, strict=True):
        assert loaded.noise_variance == saved.noise_variance
        for name, wanted in vars(saved.observation).items():
            found = getattr(loaded.observation, name)
            assert found.dtype == wanted.dtype and found.tobytes() == wanted.tobytes(), name


def test_fit_beside_numbers_frees_one_parameter_and_holds_the_others(tmp_path):
    """Fails if a free parameter acts on images before its fit, by its start or by 0 where its null is another value."""
    path = tmp_path / "cam.yaml"
    path.write_text(
        "effects:\n"
        "  - {effect: exposure, parameters: {scale: fit}}\n"
        "  - {effect: lens_blur, parameters: {sigma_px: fit, softness: 0.3}}\n"
    )
    twin = load_twin(path)
    assert twin.effects == [("lens_blur", {"sigma_px": 0.0, "softness": 0.3}), ("exposure", {"scale": 1.0})]
    assert twin.starts == [("lens_blur", {"sigma_px": 0.7, "softness": 0.3}), ("exposure", {"scale": 1.0})]
    assert twin.free == [("exposure", "scale"), ("lens_blur", "sigma_px")]
