"""Real photographs on which the generator lays an effect: what has changed is named, by its files as the workflow has them."""

import shutil
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest

import photograph_changes
from find_changes import amounts_seen, changes_record, not_compared
from photograph_changes import WhatChanged, by_one_finder, pixels_of, what_changed
from register.boards import MIN_POINTS
from register.finders import SECTORS, USUAL
from trials.diagnose_trial import photograph_sets
from trials.observe_trial import observe_trial
from trials.real_trials import generate_real_trial

RAW = Path(__file__).resolve().parents[2] / "data/raw"
CAMERA = "aruco6x6_gridboard"
NAMES = ["lens_blur", "sharpening", "radial_distortion", "focal_length", "principal_point"]


@pytest.fixture(scope="module")
def kept(tmp_path_factory):
    """Return the folder of what was measured in photographs by a real camera, on half of which a blur is laid."""
    folder = tmp_path_factory.mktemp("real")
    name = generate_real_trial(folder / "campaigns", folder / "truths", RAW, 0, "blurred", effect="lens_blur")
    observe_trial(folder / "campaigns" / name, folder / "kept")
    return folder / "kept"


@pytest.fixture(scope="module")
def blurred(kept):
    """Return the record of what has changed in them."""
    unseen = dict.fromkeys(NAMES, "by points")
    alone = [{"campaign": part, "camera": CAMERA, "not_looked_at": unseen} for part in ("baseline", "changed")]
    return changes_record(what_changed(photograph_sets(kept), CAMERA, candidates=NAMES), alone)


def test_another_blur_is_named_and_no_lens(blurred):
    """Fails if a blur, which moves corners as well, is taken for a lens, or is not told at all."""
    assert [s["effect"] for s in blurred["steps"]] == ["lens_blur"] and blurred["verdict"] == "explained"
    sigma = blurred["steps"][0]["parameters"]["sigma_px"]
    assert sigma["from"] == 0 and 0.6 < sigma["to"] < 1.8 and sigma["se"] < 0.2


def test_the_difference_goes_away_with_what_has_a_name(blurred):
    """Fails if a name is given and the sets differ as much with it as without."""
    (step,) = blurred["steps"]
    assert step["gap_before"] > 3 and step["gap_after"] < 1.3
    assert blurred["gap"] == pytest.approx(step["gap_after"]) and blurred["gap_as_configured"] == step["gap_before"]
    assert set(blurred["groups"]) == {"corners", "signature"}


def test_what_signatures_show_is_not_said_to_be_unseen(blurred):
    """Fails if the record names as not looked at what has just been looked at."""
    assert "lens_blur" not in blurred["not_looked_at"]


def test_what_could_have_changed_unseen_is_recorded(blurred):
    """Fails if what has changed is among it, what was compared is not, or a value stands where a difference should."""
    least = blurred["least_seen"]
    assert set(least) == set(NAMES) - {"lens_blur", *blurred["steps"][0].get("one_of", [])}
    assert set(blurred["not_told"]) <= set(least) and "sharpening" not in blurred["not_told"]
    assert 0 < least["sharpening"]["amount"] < 1 and set(least["sharpening"]) == {"amount"}
    amounts = amounts_seen({"focal_length": (0.5, {"ratio": 1.25}), "exposure": None})
    assert amounts == {"focal_length": {"ratio": 0.25}, "exposure": None}


def test_what_shows_too_few_points_for_a_pose_is_left_out(kept, tmp_path):
    """Fails if one such photograph, whose distance nobody knows, ends the comparison of all: points alone would be looked at."""
    folder = tmp_path / "kept"
    shutil.copytree(kept, folder)
    path = folder / "changed/observations.npz"
    with np.load(path) as stored:
        arrays = dict(stored)
    points = arrays["pixels"].shape[1]
    spread = np.linspace(0, points - 1, MIN_POINTS - 1).round().astype(int)  # enough for a map of all patches
    arrays["pixels"][0, ~np.isin(np.arange(points), spread)] = np.nan
    np.savez(path, **arrays)
    found = what_changed(photograph_sets(folder), CAMERA, candidates=["lens_blur", "defocus"])
    assert found.why_points_alone is None and len(found.photographs[1]) == len(arrays["pixels"]) - 1
    assert {found.signatures[0].effect, *found.signatures[0].one_of} == {"lens_blur", "defocus"}


@pytest.mark.parametrize(("seen", "finder", "again"), [(3, SECTORS, [1]), (2, USUAL, [1, 0])], ids=["all", "fewer"])
def test_sets_are_compared_by_one_finder(monkeypatch, seen, finder, again):
    """Fails if a set whose points another finder found seems to have changed, or if it is compared with fewer photographs."""
    usual, sectors, of_sectors = (measured_in(number, n) for number, n in ((USUAL, 3), (SECTORS, 3), (SECTORS, seen)))
    asked = []

    def found_again(of_set, camera, photographs, placed, effects, number):
        asked.append(of_set.number)
        return of_sectors if number == SECTORS else usual

    monkeypatch.setattr(photograph_changes, "found_again", found_again)
    sets = [SimpleNamespace(number=k, finder=finder) for k, finder in enumerate((SECTORS, USUAL))]
    problems, number = by_one_finder(sets, "camera", [sectors, usual], [[], []])
    assert number == finder and asked == again and {p.finder for p in problems} == {finder}
    same = [SimpleNamespace(finder=SECTORS)] * 2
    assert by_one_finder(same, "camera", [sectors, sectors], [[], []]) == ([sectors, sectors], SECTORS)


def measured_in(finder, number):
    """Return a problem by a finder: of three photographs so many show enough points."""
    captures = [
        SimpleNamespace(
            view=SimpleNamespace(capture=str(k)), observation=SimpleNamespace(measured=np.array([k < number]))
        )
        for k in range(3)
    ]
    return SimpleNamespace(finder=finder, captures=captures)


def test_grey_photographs_have_one_channel():
    """Fails if a grey photograph that is stored in colour is asked for what only colours show."""
    grey = np.repeat(np.arange(12.0).reshape(3, 4, 1), 3, axis=2)
    assert pixels_of(grey).shape == (3, 4, 1)
    assert pixels_of(grey + [0, 0, 1]).shape == (3, 4, 3)


@pytest.mark.parametrize(("channels", "silent"), [(3, {"lens_blur", "colour_balance"}), (1, {"lens_blur"})])
def test_what_photographs_without_colours_cannot_show_is_said(channels, silent):
    """Fails if an effect of colours, in grey photographs never compared, is neither looked at nor said not to be."""
    of_set = [SimpleNamespace(image=np.zeros((8, 8, channels)))]
    reasons = dict.fromkeys(("lens_blur", "colour_balance", "rail_sag"), "one set alone does not show it")
    what = WhatChanged(None, (), photographs=(of_set, of_set))
    assert reasons.keys() - not_compared(what, reasons).keys() == silent
