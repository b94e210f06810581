"""What has changed is told in a sentence a change, from how much to how much."""

from reporting.sentences import verdict_words

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
