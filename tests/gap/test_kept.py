"""Outcomes that are kept: the same verdict from them, and after an edit nothing anew but what the effect has a part in."""

from pathlib import Path

import numpy as np
import pytest
from cases import generated_case

from diagnose_camera import stored_outcomes
from effects.contract import available_effects
from gap.select.search import Search
from gap.select.select_effects import verdict
from outcome_store import OutcomeStore

CANDIDATES = ["exposure", "radial_distortion", "vignetting"]
EFFECTS = {name: [module.__file__] for name, module in available_effects().items()}


@pytest.fixture(scope="module")
def case(tmp_path_factory):
    return generated_case(tmp_path_factory.mktemp("kept"), "single", "exposure")[0]


class Counted(OutcomeStore):
    """A store that notes which effects' outcomes are made anew."""

    def __init__(self, *args):
        super().__init__(*args)
        self.made = []

    def put(self, names, text, value):
        super().put(names, text, value)
        self.made.append({name for name in names if name in self.of_effects})


def run(case, store):
    """Return what a verdict told, to the bit, and its cost."""
    search, _, _, outcome = verdict(case, candidates=CANDIDATES, store=store)
    steps = [(s.effect, s.confused_with, s.twin.errors, [c.gain for c in s.candidates]) for s in outcome.steps]
    return repr((outcome.verdict, outcome.twin.effects, outcome.twin.gap, steps)), outcome.twin.poses, search.cost


def test_a_verdict_from_kept_outcomes_is_the_same(case, tmp_path):
    """Fails if an outcome stands for another one's arguments, or a kept one costs less of the budget than when it was made."""
    shared = [Path(__file__)]
    anew = run(case, None)
    for makes in (True, False):
        store = Counted(tmp_path, shared, "facts", EFFECTS)
        told, poses, cost = run(case, store)
        assert (told, cost) == (anew[0], anew[2])
        np.testing.assert_array_equal(poses, anew[1])
        assert bool(store.made) == makes


def test_an_edited_effect_is_tried_anew_and_the_others_are_not(case, tmp_path):
    """Fails if an edit leaves the effect's old outcomes standing, or throws away those it has no part in."""
    run(case, Counted(tmp_path / "kept", [], "facts", EFFECTS))
    edited = tmp_path / "radial_distortion.py"
    edited.write_bytes(Path(*EFFECTS["radial_distortion"]).read_bytes() + b"\n# edited\n")
    store = Counted(tmp_path / "kept", [], "facts", EFFECTS | {"radial_distortion": [edited]})
    run(case, store)
    assert store.made and all("radial_distortion" in names for names in store.made)


@pytest.mark.parametrize("change", ["shared", "facts"])
def test_what_all_depend_on_throws_all_away(tmp_path, change):
    """Fails if other captures, or other code that effects share, are answered with outcomes of before."""
    file = tmp_path / "shared.py"
    file.write_text("one")
    OutcomeStore(tmp_path / "kept", [file], 1, {}).put({"exposure"}, "text", "value")
    assert OutcomeStore(tmp_path / "kept", [file], 1, {}).get({"exposure"}, "text") == "value"
    file.write_text("two" if change == "shared" else "one")
    assert OutcomeStore(tmp_path / "kept", [file], 2 if change == "facts" else 1, {}).get({"exposure"}, "text") is None


@pytest.mark.parametrize(("in_all", "left"), [([], "value"), (["exposure"], None)])
def test_an_effect_that_captures_have_of_their_own_is_in_every_outcome(tmp_path, in_all, left):
    """Fails if the edit of an effect that no twin names, as the captures have it, leaves old outcomes standing."""
    effects, tables = tmp_path / "effects", tmp_path / "expand"
    effects.mkdir(), tables.mkdir()
    exposure = effects / "exposure.py"
    exposure.write_text("one")
    stored_outcomes(tmp_path, [str(exposure)], tables, "facts", in_all).put({"vignetting"}, "text", "value")
    exposure.write_text("two")
    assert stored_outcomes(tmp_path, [str(exposure)], tables, "facts", in_all).get({"vignetting"}, "text") == left


@pytest.mark.parametrize("damaged", [b"\x80\x04", b"\x80\xff", b"no pickle", b"cnone\nsuch\n."])
def test_a_damaged_or_unused_outcome_goes(tmp_path, damaged):
    """Fails if a damaged file ends a diagnosis or is taken for its reason, or outcomes of all times pile up."""
    store = OutcomeStore(tmp_path, [], None, {})
    store.put(set(), "a", [1, 2, 3])
    store.put(set(), "b", [4])
    next(iter(store.used)).write_bytes(damaged)
    assert sorted(str(store.get(set(), text)) for text in "ab") in (["None", "[4]"], ["None", "[1, 2, 3]"])
    later = OutcomeStore(tmp_path, [], None, {})
    later.put(set(), "c", None)
    later.drop_unused()
    assert len(list(tmp_path.glob("*.pickle"))) == 1


def test_a_search_without_a_store_keeps_nothing(case):
    """Fails if a search of trials or tests writes files."""
    assert Search(case, CANDIDATES).store is None
