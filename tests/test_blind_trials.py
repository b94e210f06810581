"""Blind trials: what is laid down is diagnosed without the truth, and the envelopes are counted right."""

import json

import pandas as pd
import pytest

from open_envelopes import open_envelopes
from tiny_campaign import lay_down
from workflow_runs import copy_project, snakemake

CANDIDATES = "diagnose={candidates: [lens_blur]}"


def lay_trial(folder, name, kind, hidden, named, verdict, gap=1.0, value=1.2, se=0.02, strength=1.0):
    """Write an envelope and a verdict; the hidden blur is 1.2 px times the strength."""
    blur = {"sigma_px": 1.2 * strength}
    effects = [{"effect": e, "in_library": True, "parameters": blur, "library_parameters": blur} for e in hidden]
    (folder / "envelopes" / name).mkdir(parents=True)
    (folder / "verdicts").mkdir(exist_ok=True)
    truth = {"campaign": name, "kind": kind, "strength": strength, "effects": effects}
    (folder / "envelopes" / name / "truth.json").write_text(json.dumps(truth))
    steps = [{"effect": e, "parameters": {"sigma_px": {"value": value, "se": se}}} for e in named]
    verdict = {"camera": "c", "verdict": verdict, "steps": steps, "gap": gap, "gap_as_configured": 3.0}
    (folder / "verdicts" / f"{name}.json").write_text(json.dumps([verdict]))


def test_envelopes_are_counted_as_the_aims_say(tmp_path):
    """A count that forgives a second name, a wrong name or a missed interval would flatter the search."""
    lay_trial(tmp_path, "a", "single", ["lens_blur"], ["lens_blur"], "explained")
    lay_trial(tmp_path, "b", "single", ["lens_blur"], ["lens_blur", "exposure"], "explained", gap=1.2, value=1.3)
    lay_trial(tmp_path, "c", "none", [], ["exposure"], "explained")
    lay_trial(tmp_path, "d", "none", [], [], "adequate")
    open_envelopes(tmp_path / "verdicts", tmp_path / "envelopes", tmp_path / "out")
    summary = pd.read_csv(tmp_path / "out/summary.csv").set_index("what")
    assert summary.hits["single effects: the right one first"] == 2
    assert summary.hits["single effects: exactly the right set"] == 1
    assert summary.hits["nothing hidden: something named (false alarm)"] == 1
    assert summary.hits["held-out gap after the climb at most 1.05 floors"] == 1
    assert summary.hits["stated 95 % intervals that hold the truth"] == 1
    confusion = pd.read_csv(tmp_path / "out/confusion.csv", index_col="hidden")
    assert confusion.loc["lens_blur", "lens_blur"] == 2 and confusion.loc["(nothing)", "exposure"] == 1
    assert (tmp_path / "out/confusion.png").stat().st_size > 1000


def test_the_smallest_strength_seen_is_told(tmp_path):
    """A strength that was not named, or a name beside it, would promise users more than their rig can see."""
    for k, (strength, named) in enumerate([(0.25, []), (0.5, ["lens_blur"]), (1.0, ["lens_blur", "exposure"])]):
        lay_trial(tmp_path, f"p{k}", "power", ["lens_blur"], named, "explained", strength=strength)
    open_envelopes(tmp_path / "verdicts", tmp_path / "envelopes", tmp_path / "out")
    power = pd.read_csv(tmp_path / "out/power.csv").iloc[0]
    assert (power.smallest_seen, power.was) == (0.5, "sigma_px 0.6")
    assert (power["0.25"], power["0.5"], power["1.0"]) == (0, 1, 0)
    summary = pd.read_csv(tmp_path / "out/summary.csv").set_index("what")
    assert summary.trials["single effects: the right one first"] == 1  # the one of strength 1


@pytest.mark.parametrize("kind", ["single"])
def test_a_blind_trial_runs_from_the_command_line(tmp_path, kind):
    """A diagnosis that reads the envelope, or a rule that loses it, would make the trials worthless."""
    project = copy_project(tmp_path / "project")
    trials = f"blind_trials={{single: 0, pair: 0, none: 0, outside: 0, {kind}: 1, size: tiny}}"
    status, said = snakemake(
        project, "--cores", 2, "blind_trials", "--config", trials, CANDIDATES, f"campaign={lay_down(tmp_path / 'c')}"
    )
    assert status == 0, said[-3000:]
    trials = pd.read_csv(project / "results/blind_trials/trials.csv", keep_default_na=False)
    assert list(trials.kind) == [kind] and trials.verdict[0] in ("adequate", "explained", "unexplained")
    assert not list((project / "results/blind_trials/campaigns").glob("*/images"))
