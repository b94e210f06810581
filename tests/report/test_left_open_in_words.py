"""What a campaign leaves open, in the report's words."""

from reporting.sentences import assumed, verdict_words

SCENE = {"left_open": ["exposure"], "exposure": 1.0, "reflectance": {"white": 0.8}}
ADEQUATE = {"verdict": "adequate", "steps": []}


def test_the_range_of_captures_own_numbers_is_told():
    """Fails if a reader of an automatic exposure never learns what it was, or least and most change places."""
    said = verdict_words(ADEQUATE | {"own": {"exposure scale": {"a": 0.505, "b": 1.16, "c": 0.9}}})
    assert "Each capture has its own exposure scale 0.505 to 1.16." in said
    assert "its own" not in verdict_words(ADEQUATE)


def test_what_is_fitted_for_all_is_said_only_where_it_is_open():
    """Fails if declared reflectances are said to be fitted, or open ones are not."""
    assert "exposure for 1.0. The diagnosis fits each capture's own and blames nothing on them." in assumed(SCENE)[0]
    both = assumed(SCENE | {"left_open": ["exposure", "reflectance"]})[0]
    assert "own, reflectances for all captures alike, and" in both
    assert assumed(SCENE | {"left_open": []}) == []
