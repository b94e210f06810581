"""Steps of an outcome."""

from dataclasses import replace

from stand_in_twins import base_twin

from gap.outcome import Step, told_apart


def test_what_did_as_well_is_told_with_a_twin_in_its_place():
    """Fails if a group of names loses one, keeps one that the twin has anyway, or the next station cannot tell them apart."""
    twin = replace(base_twin(), effects=(("lens_blur", {"sigma_px": 1.0}), ("exposure", {"scale": 1.1})))
    step = Step("lens_blur", twin, (), (), "edges")
    told = told_apart(step, None, [("defocus", {"focus_m": 1.0}), ("exposure", {})], twin)
    assert told.confused_with == ("defocus",)
    assert [c.twin.names for c in told.candidates] == [["lens_blur", "exposure"], ["defocus", "exposure"]]
    assert told_apart(step, told, [], twin).confused_with == ("defocus",)
