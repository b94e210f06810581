"""What captures cannot tell is said with what a photographer can do about it."""

import pytest

from reporting.sentences import verdict_words
from rig.words import with_error
from workflow_runs import PROJECT

STEP = {
    "effect": "pixel_aspect", "parameters": {"ratio": {"value": 1.006, "se": 0.001}}, "gap_before": 1.7, "gap_after": 0.95,
    "confused_with": ["rolling_shutter", "print_stretch"], "one_of": ["pixel_aspect", "rolling_shutter"],
}  # fmt: skip
ROLL = "roll the camera by 90 degrees for some photographs"
NEEDS = [{"effect": n, "text": f"to tell {n.replace('_', ' ')}: {ROLL}"} for n in ("print_stretch", "board_bend")]


def test_names_that_cannot_be_told_apart_and_what_would_tell_them():
    """Fails if a name is told as certain that is one of two, or each effect repeats what to do."""
    said = verdict_words({"verdict": "explained", "steps": [STEP], "needs": NEEDS})
    assert "pixel aspect (ratio 1.0060 ± 0.0010) (or rolling shutter: these captures cannot tell)" in said
    assert f"To tell print stretch and board bend: {ROLL}." in said
    assert "cannot tell it apart" not in said
    assert said.count(ROLL) == 1


HIDDEN = {"verdict": "adequate", "steps": [], "not_told": ["print_stretch", "board_bend"]}


def test_what_cannot_be_told_is_said_with_what_would_or_that_nothing_would():
    """Fails if what no instruction shows is passed over, one that does is denied, or nothing is said where all is told."""
    said = verdict_words(HIDDEN | {"needs": NEEDS[:1]})
    assert "These photographs would not show print stretch and board bend at a size worth naming." in said
    assert f"To tell print stretch: {ROLL}. None of the instructions that were tried would tell board bend." in said
    assert "None of" not in verdict_words(HIDDEN | {"needs": NEEDS})
    assert verdict_words(HIDDEN | {"not_told": [], "needs": []}).endswith("down to the floor.")


def test_names_that_no_instruction_tells_apart_are_said():
    """Fails if a reader waits for photographs that would tell two names apart, or is told so of names that some would."""
    need = {"effect": "rolling_shutter", "text": f"to tell rolling shutter from pixel aspect: {ROLL}"}
    diagnosis = {"verdict": "explained", "steps": [STEP], "needs": []}
    assert "tried would tell rolling shutter from pixel aspect." in verdict_words(diagnosis)
    assert "None of" not in verdict_words(diagnosis | {"needs": [need]})


def test_what_tells_an_effect_from_another_is_not_said_twice():
    """Fails if a reader is asked to tell a name, and the same name from another, by one instruction in one breath."""
    closer, hidden = "halve the distance in some photographs", {"not_told": ["defocus", "sharpening"]}
    step = STEP | {"effect": "lens_blur", "one_of": ["lens_blur", "defocus"], "confused_with": ["defocus"]}
    whats = {"defocus": "defocus", "sharpening": "sharpening", "lens_blur": "defocus from lens blur"}
    needs = [{"effect": n, "text": f"to tell {what}: {closer}"} for n, what in whats.items()]
    said = verdict_words({"verdict": "explained", "steps": [step], "needs": needs} | hidden)
    assert f"To tell sharpening and defocus from lens blur: {closer}." in said and "None of" not in said


def test_the_page_of_the_diagnosis_says_it_too(monkeypatch):
    """Fails if the diagnosis's own page leaves out what the report's first page says of further photographs."""
    monkeypatch.syspath_prepend(PROJECT / "notebooks")
    import diagnosis_figures

    said = diagnosis_figures.words(HIDDEN | {"camera": "phone", "gap": 1.0, "where": [], "needs": NEEDS[:1]})
    assert "would not show print stretch" in said and "tried would tell board bend." in said


@pytest.mark.parametrize(("names", "said"), [(["radial_distortion", "principal_point"], True), ([], False)])
def test_what_the_whole_lens_brings_is_told_where_it_brings_something(names, said):
    """Fails if the lens's small terms are told where there are none that left-out photographs are better for."""
    lens = {"too_small_for_a_name": names, "left_out_px": 0.25, "left_out_px_of_named": 0.312}
    words = verdict_words({"verdict": "adequate", "steps": [], "whole_lens": lens})
    told = "too small for a name (radial distortion and principal point), the lens leaves left-out points 0.250 px off"
    assert (f"{told}, 0.312 px without." in words) == said and ("Fitted as a calibration" in words) == said


def test_an_error_of_nothing_but_rounding_is_no_error():
    """Fails if a parameter that no fit moved is told to seventeen digits."""
    assert [with_error(0.4, 3.4e-17), with_error(0.0, 3.6e-16), with_error(0.4, 0.02)] == ["0.4", "0", "0.400 ± 0.020"]


BLUR = {"effect": "lens_blur", "parameters": {}, "gap_before": 3.0, "gap_after": 1.0}
STATION = {"height_m": 0.8, "tilt_deg": 45.0, "difference": 90.0, "tells_apart": ["lens_blur", "defocus"]}
COULD = "A station at 0.8 m height and 45° tilt could tell lens blur from defocus."


@pytest.mark.parametrize(
    ("names", "said"),
    [
        ({"confused_with": ["defocus"]}, f"These captures cannot tell it apart from defocus. {COULD}"),
        (
            {"confused_with": ["defocus"], "one_of": ["lens_blur", "defocus"]},
            f"lacks lens blur (or defocus: these captures cannot tell); with that, the gap is the floor. The gap falls from 3.00 "
            f"to 1.00 floors. {COULD}",
        ),
    ],
    ids=["hardly worse", "would do as well"],
)
def test_a_station_is_suggested_for_names_of_a_rig(names, said):
    """Fails if a name that would do as well is said twice or hides the station, or if it is not said what would be told."""
    words = verdict_words({"verdict": "explained", "steps": [BLUR | names], "suggested_station": STATION})
    assert said in words and words.count("cannot tell") == 1


def test_what_a_form_leaves_is_said_beside_its_name(monkeypatch):
    """Fails if a reader takes a group above its floor for a further effect: on either page the form's name stands beside it."""
    monkeypatch.syspath_prepend(PROJECT / "notebooks")
    import diagnosis_figures

    step = BLUR | {"confused_with": [], "residue": {"edges": 1.317}}
    said = verdict_words({"verdict": "explained", "steps": [step, BLUR | {"effect": "exposure"}]})
    assert "lacks lens blur (its form leaves a residue: edges 1.32 floors) and exposure;" in said
    page = diagnosis_figures.words({"camera": "a", "verdict": "explained", "steps": [step], "where": []})
    assert "**lens_blur** () (its form leaves a residue: edges 1.32 floors): the gap falls" in page
