"""What was measured of a trial is kept and diagnosed again without its images."""

import functools
import json
import shutil

import numpy as np
import pytest

from gap.select.search import Search
from rig.errors import InputError
from trials import diagnose_trial
from trials.generate_trials import generate_trial
from trials.observe_trial import observe_trial, observed_cases
from trials.true_twin import rises, true_twin

FEW = ("lens_blur", "focal_length")


@pytest.fixture(scope="module")
def kept(tmp_path_factory):
    """Return (campaign's folder, what was kept of it): a tiny blurred campaign."""
    folder = tmp_path_factory.mktemp("trial")
    name, _ = generate_trial(folder / "c", folder / "t", "single", 0, "kept", "lens_blur", size="tiny")
    observe_trial(folder / "c" / name, folder / "kept" / name)
    return folder / "c" / name, folder / "kept" / name


@pytest.fixture
def few(monkeypatch):
    """Let a few effects compete: 29 would take minutes."""
    monkeypatch.setattr(diagnose_trial, "verdict", functools.partial(diagnose_trial.verdict, candidates=FEW))


def test_a_replay_says_what_the_diagnosis_said(kept, tmp_path, few):
    """Fails if something that a fit needs is not kept, or is kept in fewer digits: replayed rules would be other rules."""
    campaign, _ = kept
    copy = tmp_path / campaign.name
    shutil.copytree(campaign, copy)
    out = [str(tmp_path / f"{k}.json") for k in range(2)]
    diagnose_trial.main([str(copy), "--keep", str(tmp_path / "kept"), "--out", out[0]])
    shutil.rmtree(copy)
    diagnose_trial.main(["--replay", str(tmp_path / "kept" / campaign.name), "--out", out[1]])
    direct, again = (json.loads(open(path).read()) for path in out)
    for verdict in (*direct, *again):
        verdict.pop("seconds")
    assert direct == again and direct[0]["steps"][0]["effect"] == "lens_blur"


def test_what_is_kept_is_what_was_measured(kept):
    """Fails if an observation comes back changed."""
    from case_files import read_capture

    campaign, folder = kept
    (case,) = observed_cases(folder)
    for capture in case.captures[:2]:
        stored, variance = capture.observation, capture.noise_variance
        case.observe_real(capture, read_capture(campaign, f"images/{case.camera}/{capture.view.capture}.png"))
        assert variance == capture.noise_variance
        for name, value in vars(capture.observation).items():
            np.testing.assert_array_equal(getattr(stored, name), value)


def test_half_a_store_is_refused(kept, tmp_path):
    """Fails if a folder that lacks its observations, or is none, is diagnosed all the same."""
    _, folder = kept
    shutil.copytree(folder, tmp_path / "half")
    next((tmp_path / "half").glob("*/observations.npz")).unlink()
    with pytest.raises(InputError, match="observations.npz: no such file"):
        observed_cases(tmp_path / "half")
    with pytest.raises(InputError, match="no observations"):
        observed_cases(tmp_path / "nothing")
    with pytest.raises(InputError, match="images: no such folder"):
        observe_trial(tmp_path / "nothing", tmp_path / "out")
    assert not (tmp_path / "out").exists()


def test_what_the_twin_does_not_miss_does_not_count(kept):
    """Fails if an effect that the captures do not show counts as hidden, or one that they show does not."""
    (case,) = observed_cases(kept[1])
    found = true_twin(Search(case, FEW), ["focal_length", "lens_blur", "lens_dust"])
    assert found.counted == ["lens_blur"] and found.uncounted == ["focal_length"]
    assert {name for name, _ in found.effects} == set(FEW)
    assert found.gap < 1.5
    assert max(found.without["lens_blur"].values()) > 2 * found.gap


def test_one_group_is_enough_to_count():
    """Fails if a rise in one group drowns in the mean of all, or a rise of a hundredth counts."""
    groups = {"corners": 1.0, "noise": 0.7}
    assert rises(groups, {"corners": 0.9, "noise": 0.72}) and not rises(groups, {"corners": 1.01, "noise": 0.7})
