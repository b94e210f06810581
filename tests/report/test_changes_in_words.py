"""What has changed is told in a sentence a change, from how much to how much."""

import json
from types import SimpleNamespace

import cv2
import numpy as np

from find_changes import signature_step
from reporting.sentences import verdict_words
from workflow_runs import PROJECT

STEP = {"effect": "focal_length", "parameters": {"ratio": {"from": 1.001, "to": 1.0402, "se": 0.0012, "value": 1.0402}}}
DIAGNOSIS = {"verdict": "explained", "baseline": "june", "captures": [7, 6], "steps": [STEP]}


def test_a_change_is_told_with_both_values():
    """Fails if a change is told as an effect that the twin lacks, or without what it was before."""
    said = verdict_words(DIAGNOSIS)
    assert said == "Since june focal length has changed: ratio from 1.001 to 1.0402 ± 0.0012."


def test_what_cannot_be_told_apart_is_said():
    """Fails if a group of names is told as one name."""
    step = STEP | {"one_of": ["focal_length", "principal_point"]}
    said = verdict_words(DIAGNOSIS | {"steps": [step]})
    assert "focal length (or principal point: these captures cannot tell) has changed" in said


def test_nothing_changed_is_said_with_how_many_captures_tell_it():
    """Fails if nothing changed reads as nothing missing."""
    said = verdict_words(DIAGNOSIS | {"verdict": "adequate", "steps": []})
    assert said == "Nothing that has a name has changed since june, as far as 7 captures then and 6 now tell."
    assert "no known effect explains" in verdict_words(DIAGNOSIS | {"verdict": "unexplained", "steps": []})


def test_what_another_lamp_would_do_as_well_is_said():
    """Fails if a photographer who moved a lamp reads that the camera has changed, and nothing else."""
    said = verdict_words(DIAGNOSIS | {"steps": [STEP | {"effect": "exposure", "like_light": True}]})
    assert "exposure (or the light is another) has changed" in said


def test_what_cells_show_is_counted_from_the_set_that_has_less_of_it():
    """Fails if a blur that was there before reads as none, or what is beyond the later captures as beyond the earlier."""
    found = {
        "effect": "lens_blur",
        "parameters": {"sigma_px": 1.2},
        "errors": {"sigma_px": 0.1},
        "one_of": (),
        "p": 0.01,
    }
    for less, told in (
        (False, "from 0 to 1.20 ± 0.10, beyond what the earlier"),
        (True, "from 1.2 to 0.00 ± 0.10, beyond what the later"),
    ):
        step = signature_step(SimpleNamespace(**found, less=less, like_light=False))
        said = verdict_words(DIAGNOSIS | {"steps": [step]})
        assert f"lens blur has changed: sigma_px {told} captures have of it." in said


def test_what_could_have_changed_unseen_is_said():
    """Fails if nothing changed reads as proof, where these captures would not have shown it."""
    said = verdict_words(DIAGNOSIS | {"verdict": "adequate", "steps": [], "not_told": ["focal_length", "exposure"]})
    assert said.endswith(
        "Of focal length and exposure even a clear change would most likely go unseen in these captures."
    )


def test_the_table_of_what_would_be_seen_names_each_amount(monkeypatch):
    """Fails if an effect that no amount shows reads as one that a small one does, or a verdict without baseline gets a table."""
    monkeypatch.syspath_prepend(PROJECT / "notebooks")
    import diagnosis_figures

    least = {"radial_distortion": {"k1": 0.0312, "k2": -0.2}, "exposure": None}
    table = diagnosis_figures.least_seen({"camera": "c", "least_seen": least})
    rows = [[cell.strip() for cell in line.strip("|").split("|")] for line in table.splitlines()[-2:]]
    assert rows == [["exposure", "more than was tried"], ["radial distortion", "k1 by 0.031, k2 by -0.2"]]
    assert diagnosis_figures.least_seen({"camera": "c"}) == ""


def test_the_front_picture_is_titled_by_what_it_shows(tmp_path, monkeypatch):
    """Fails if captures and their ladder, which are one campaign's, stand under the verdict on what has changed."""
    monkeypatch.syspath_prepend(PROJECT / "notebooks")
    import front_picture

    folder = tmp_path / "diagnosis/c"
    folder.mkdir(parents=True)
    for name in front_picture.EXAMPLES:
        cv2.imwrite(str(folder / f"example_{name}.png"), np.full((60, 60), 128, np.uint8))
    (folder / "ladder.csv").write_text("step,gap\n0,2.0\n1,1.1\n")
    of_changes = DIAGNOSIS | {"camera": "c", "verdict": "adequate", "steps": []}
    for alone, said in (
        ({}, "c by itself: adequate"),
        ({"steps": [{"effect": "lens_blur"}]}, "c by itself: + lens blur"),
    ):
        record = of_changes | {"alone": {"verdict": "adequate", "steps": []} | alone}
        (tmp_path / "diagnosis/c.json").write_text(json.dumps(record))
        ((_, diagnosis, _),) = front_picture.cameras_of(tmp_path)
        assert front_picture.headline(diagnosis) == said


def test_a_page_of_changes_asks_what_has_changed(monkeypatch):
    """Fails if a page on what has changed begins with what a twin lacks, or another page with a baseline that nobody gave."""
    monkeypatch.syspath_prepend(PROJECT / "notebooks")
    import diagnosis_figures

    assert diagnosis_figures.introduction([(DIAGNOSIS, None, None)]).startswith("# What has changed since june?")
    assert diagnosis_figures.introduction([({"camera": "c"}, None, None)]).startswith("# What does the twin lack")
