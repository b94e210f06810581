"""What a campaign leaves open, in the report's words."""

import pytest

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


BOARD = {"target": {"type": "chessboard"}}
GROUPS = {
    "light": ["glare and the curve's foot"],
    "exposure light": ["the exposure and the lamp's strength", "glare and the curve's foot"],
    "white_balance light": ["the colour balance and the lamp's colour", "glare and the curve's foot"],
    "exposure": [],
    "light exposure white_balance reflectance": [
        "the exposure, the lamp's strength and the white of the print",
        "the colour balance and the lamp's colour",
        "the black of the print, glare and the curve's foot",
    ],
}


@pytest.mark.parametrize("left_open", GROUPS)
def test_what_hides_one_another_on_a_board_is_said(left_open):
    """Fails if a print's white is told as known though the lamp is not, or what was declared is said to be hidden."""
    said = " ".join(assumed(BOARD | {"left_open": left_open.split()}))
    groups = "; ".join(GROUPS[left_open])
    assert (f"hide one another, and are told together alone: {groups}." in said) == bool(groups)
    assert ("hide one another" in said) == bool(groups)


def test_what_lies_about_a_board_is_said_to_be_left_out():
    """Fails if a twin's grey ground passes for what the photograph shows there, or a rig, which has none, is told of it."""
    for left_open in ([], ["exposure"]):
        assert "What lies about the board is not modelled" in assumed(BOARD | {"left_open": left_open})[-1]
        assert "about the board" not in " ".join(assumed(SCENE | {"left_open": left_open}))
