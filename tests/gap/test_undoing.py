"""Effects that undo one another: when they are looked for, and which are proposed."""

from types import SimpleNamespace

import pytest
from stand_in_twins import base_twin

from effects import library
from gap.select import joint_way, undoing
from gap.select.linear_model import Proposal

NAMES = ["defocus", "denoising", "lens_blur", "sharpening", "tone_curve"]


def test_what_sharpens_is_known_by_its_noise():
    """Fails if a curve, a mosaic or a filter that smooths is taken for what undoes a blur, or a sharpening is not."""
    assert [n for n in library.available_effects() if library.sharpens(n)] == ["sharpening"]
    assert not library.smooths_noise("sharpening") and not library.smooths_noise("tone_curve")


@pytest.mark.parametrize(("loss", "names"), [(500.0, ["defocus", "sharpening"]), (990.0, [])], ids=["less", "as much"])
def test_a_blur_and_the_sharpening_after_it_are_proposed_together(monkeypatch, loss, names):
    """Fails if one of them is fitted without the other, beside its own old values or with everything, if another blur that leaves
    more is proposed, or both where they leave as much as there is.
    """
    fitted, start = [], library.starts_of("defocus")[1]

    def fitted_alone(_, effects, poses, names):
        fitted.append(names)
        assert [n for n, _ in effects].count("sharpening") == 1
        left = loss if dict(effects).get("defocus") == start else 1200.0
        return SimpleNamespace(state=SimpleNamespace(effects=effects, poses=poses), loss=left)

    monkeypatch.setattr(undoing, "fitted_alone", fitted_alone)
    search = SimpleNamespace(problem=SimpleNamespace(starts_of=library.starts_of))
    effects = [("tone_curve", {}), ("sharpening", {"amount": 0.01, "radius_px": 1.0})]
    end = SimpleNamespace(state=SimpleNamespace(effects=effects, poses=None), loss=1000.0)
    proposal = undoing.undoing(search, end, NAMES)
    assert proposal.names == names and (not names or dict(proposal.effects)["defocus"] == start)
    assert set(map(tuple, fitted)) == {("defocus", "sharpening"), ("lens_blur", "sharpening")}


@pytest.mark.parametrize(
    ("is_closed", "found"), [(False, ["exposure", "defocus", "sharpening"]), (True, ["exposure", "sharpening"])]
)
def test_they_are_looked_for_once_where_rounds_end_with_the_gap_open(monkeypatch, is_closed, found):
    """Fails if rounds end, the gap open, before what undoes one another was looked for, if it is looked for where little is left
    or twice, or if the sharpening that there is stays beside the new one.
    """
    asked, rounds = [], []

    def one_round(search, base, here, proposal):
        rounds.append((here.names, proposal.names))
        if proposal.names == ["denoising"]:
            return None, None, None, None
        effects = (*here.effects, *proposal.effects)
        return base_twin().__class__(effects, here.poses, {}, {}, {}, {}, {}, 0.0, True), "end", {}, set()

    def of(names):
        return Proposal([(n, library.nulls_of(n)) for n in names], dict.fromkeys(names, []))

    for name, stand_in in {
        "_round": one_round, "selected": lambda *_, **__: of(["denoising"]), "linear_model": lambda *_: ([], None),
        "is_at_floor": lambda _: False, "exchanges": lambda *_: {}, "_is_nearly_closed": lambda *_: is_closed,
        "pruned": lambda search, base, twin, end: (twin, end),
        "_with_geometry_told_again": lambda search, base, twin, end, names: (twin, end),
        "undoing": lambda *given: (asked.append(given[1:]), of(["defocus", "sharpening"]))[1],
    }.items():  # fmt: skip
        monkeypatch.setattr(joint_way, name, stand_in)
    selection = SimpleNamespace(search=None, is_spent=lambda: False, progress=None)
    twin, *_ = joint_way._found(selection, base_twin(), base_twin(), NAMES, of(["exposure", "sharpening"]))
    assert twin.names == found and asked == [("end", NAMES)] * (not is_closed)
    assert (["exposure"], ["defocus", "sharpening"]) in rounds or is_closed
