"""Blind trials: what is generated is diagnosed without the truth, and the verdicts are counted right."""

import json

import pandas as pd
import pytest

from tiny_campaign import write_campaign
from trials.summarise_trials import gap_ratio, steps_of, summarise_trials
from workflow_runs import copy_project, snakemake

CANDIDATES = "diagnose={candidates: [lens_blur]}"


def write_trial(
    folder,
    name,
    kind,
    hidden,
    named,
    verdict,
    gap=1.0,
    value=1.2,
    se=0.02,
    strength=1.0,
    counted=None,
    not_told=(),
):
    """Write a truth and a verdict; the hidden blur is 1.2 px times the strength; a name in ``named`` may be a group."""
    blur = {"sigma_px": 1.2 * strength}
    effects = [{"effect": e, "in_library": True, "parameters": blur, "library_parameters": blur} for e in hidden]
    (folder / "truths" / name).mkdir(parents=True)
    for part in ("verdicts", "true_twins"):
        (folder / part).mkdir(exist_ok=True)
    truth = {"campaign": name, "kind": kind, "strength": strength, "effects": effects}
    (folder / "truths" / name / "truth.json").write_text(json.dumps(truth))
    parameters = {"sigma_px": {"value": value, "se": se}}
    steps = [{"effect": e.split("|")[0], "one_of": e.split("|"), "parameters": parameters} for e in named]
    found = {"groups": {"corners": gap}, "floor": {"corners": 1.0}, "not_told": not_told}
    verdict = found | {"camera": "c", "verdict": verdict, "steps": steps, "gap": gap, "gap_as_configured": 3.0}
    (folder / "verdicts" / f"{name}.json").write_text(json.dumps([verdict]))
    if counted is not None:
        twin = {"gap": 1.0, "floor": {"corners": 1.0}, "counted": counted}
        (folder / "true_twins" / f"{name}.json").write_text(json.dumps({"c": twin}))


def summary_of(folder):
    """Return the summary of the trials written to a folder, by what."""
    summarise_trials(*(folder / name for name in ("verdicts", "truths", "true_twins", "out")))
    return pd.read_csv(folder / "out/summary.csv").set_index("what")


def test_verdicts_are_counted_as_the_aims_say(tmp_path):
    """Fails if a count forgives a second name, a wrong name or a missed interval: it would flatter the search."""
    write_trial(tmp_path, "a", "single", ["lens_blur"], ["lens_blur"], "explained")
    write_trial(tmp_path, "b", "single", ["lens_blur"], ["lens_blur", "exposure"], "explained", gap=1.2, value=1.3)
    write_trial(tmp_path, "c", "none", [], ["exposure"], "explained")
    write_trial(tmp_path, "d", "none", [], [], "adequate")
    summary = summary_of(tmp_path)
    assert summary.hits["single effects: the right one first"] == 2
    assert summary.hits["single effects: exactly the right set"] == 1
    assert summary.hits["nothing hidden: something named (false alarm)"] == 1
    assert summary.hits["held-out gap after forward selection at most 1.05 floors"] == 1
    assert summary.hits["stated 95 % intervals that hold the truth"] == 1
    assert summary.value["stated errors: median miss"] == pytest.approx(2.5)  # 0 and 5 standard errors
    # Wilson's interval of 1 in 2
    assert tuple(summary.loc["single effects: exactly the right set", ["low", "high"]]) == (9.5, 90.5)
    assert not summary.index.str.contains("whole|outside|two").any()
    confusion = pd.read_csv(tmp_path / "out/confusion.csv", index_col="hidden")
    assert confusion.loc["lens_blur", "lens_blur"] == 2 and confusion.loc["(nothing)", "exposure"] == 1
    assert (tmp_path / "out/confusion.png").stat().st_size > 1000


def test_the_smallest_strength_seen_is_told(tmp_path):
    """Fails if a strength that was not named, or had a name beside it, counts: users would be promised more than they see."""
    for k, (strength, named) in enumerate([(0.25, []), (0.5, ["lens_blur"]), (1.0, ["lens_blur", "exposure"])]):
        write_trial(tmp_path, f"p{k}", "power", ["lens_blur"], named, "explained", strength=strength)
    summary = summary_of(tmp_path)
    power = pd.read_csv(tmp_path / "out/power.csv").iloc[0]
    assert (power.smallest_seen, power.was) == (0.5, "sigma_px 0.6")
    assert (power["0.25"], power["0.5"], power["1.0"]) == (0, 1, 0)
    assert summary.number["single effects: the right one first"] == 1  # the one of strength 1


def test_whole_cameras_are_counted_by_what_counts(tmp_path):
    """Fails if what no twin could feel is asked for, a group of four names something, or a second guess is no wrong name."""
    hidden = ["lens_blur", "vignetting", "sharpening", "tone_curve"]
    named = ["vignetting", "defocus|lens_blur", "exposure", "tone_curve|exposure|veiling_glare|ink_reflectance"]
    counted = ["lens_blur", "vignetting", "tone_curve"]
    write_trial(tmp_path, "w", "whole", hidden, named, "explained", gap=1.04, counted=counted)
    twice = ["lens_blur", "defocus|lens_blur"]
    write_trial(tmp_path, "v", "whole", hidden, twice, "unexplained", gap=1.3, counted=["lens_blur"])
    summary = summary_of(tmp_path)
    hits = {what: (row.hits, row.number) for what, row in summary.iterrows() if what.startswith("whole")}
    near = summary.loc["held-out gap over that of the twin with the true names, fitted: at most 1.05"]
    assert (near.hits, near.number) == (1, 2)
    assert hits == {
        "whole cameras: explained": (1, 2),
        "whole cameras: hidden effects named, alone or in a group of at most three": (3, 4),
        "whole cameras: names in groups": (3, 6),
        "whole cameras: wrong names": (2, 6),
    }
    assert (tmp_path / "out/confusion.png").stat().st_size > 1000  # nothing belongs in it


def test_of_changes_that_are_missed_those_said_to_go_unseen_are_counted(tmp_path):
    """Fails if a change that has a name counts among them, or another that would go unseen stands for what was missed."""
    write_trial(tmp_path, "a", "real", ["vignetting"], [], "adequate", not_told=["exposure", "vignetting"])
    write_trial(tmp_path, "b", "real", ["lens_blur"], [], "adequate", not_told=["exposure"])
    write_trial(tmp_path, "c", "real", ["lens_blur"], ["lens_blur"], "explained", not_told=["lens_blur"])
    summary = summary_of(tmp_path)
    row = summary.loc["changes on photographs without a name: said to go unseen even if clear"]
    assert (row.hits, row.number) == (1, 2)
    assert summary.hits["what has changed on photographs: the right effect first"] == 1


def test_steps_are_dealt_to_the_effects_that_count():
    """Fails if steps are taken greedily: the group would take the name that stands alone, and its own would be missed."""
    steps = [{"effect": "a", "one_of": ["a", "b"]}, {"effect": "a"}, {"effect": "c"}]
    assert steps_of(["a", "b"], ["b"], steps) == {"a": ["a"], "b": ["a", "b"]}
    assert steps_of(["a", "b"], ["b"], steps[:1]) == {"b": ["a", "b"]}
    assert steps_of([], [], steps) == {} and steps_of(["a"], ["a"], []) == {}


def test_gaps_are_compared_in_the_same_floors():
    """Fails if a verdict's wider floors make its gap look small."""
    twin = {"gap": 1.0, "floor": {"corners": 0.5, "levels": 1.0}}
    verdict = {"gap": 0.5, "groups": {"corners": 0.5, "levels": 1.0}, "floor": {"corners": 1.0}}
    assert gap_ratio(verdict, twin) == pytest.approx(1.0)
    assert gap_ratio({"gap": None}, twin) == float("inf")


def test_only_whole_cameras_get_a_twin_with_the_true_effects(tmp_path):
    """Fails if the summary does not wait for what says which effects count, or other trials pay for it."""
    project, campaign = copy_project(tmp_path / "project"), write_campaign(tmp_path / "c")
    trials = "blind_trials={single: 2, pair: 0, none: 0, outside: 0, whole: 1, size: tiny}"
    status, said = snakemake(project, "-n", "blind_trials", "--config", trials, f"campaign={campaign}")
    assert status == 0, said[-3000:]
    counts = dict(line.split() for line in said.split("Job stats:")[1].splitlines()[3:] if len(line.split()) == 2)
    assert (counts["diagnose_trial"], counts["fit_true_twin"]) == ("3", "1")


def test_real_photographs_are_for_real_trials_alone(tmp_path):
    """Fails if other trials of the same run are given the photographs, which their generator refuses."""
    project, campaign = copy_project(tmp_path / "project"), write_campaign(tmp_path / "c")
    trials = "blind_trials={single: 0, pair: 0, none: 1, outside: 0, power: 0, whole: 0, real: 1, photographs: boards}"
    status, said = snakemake(project, "-n", "-p", "blind_trials", "--config", trials, f"campaign={campaign}")
    assert status == 0, said[-3000:]
    given = {
        line.split("--kind ")[1].split()[0]: "--photographs boards" in line
        for line in said.splitlines()
        if "--kind " in line
    }
    assert given == {"none": False, "real": True}


@pytest.mark.parametrize("kind", ["single"])
def test_a_blind_trial_runs_from_the_command_line(tmp_path, kind):
    """Fails if the diagnosis reads the truth, or a rule loses it: the trials would be worthless."""
    project = copy_project(tmp_path / "project")
    trials = f"blind_trials={{single: 0, pair: 0, none: 0, outside: 0, {kind}: 1, size: tiny}}"
    status, said = snakemake(
        project,
        "--cores",
        2,
        "blind_trials",
        "--config",
        trials,
        CANDIDATES,
        f"campaign={write_campaign(tmp_path / 'c')}",
    )
    assert status == 0, said[-3000:]
    trials = pd.read_csv(project / "results/blind_trials/trials.csv", keep_default_na=False)
    assert list(trials.kind) == [kind] and trials.verdict[0] in ("adequate", "explained", "unexplained")
    assert not list((project / "results/blind_trials/campaigns").glob("*/images"))
