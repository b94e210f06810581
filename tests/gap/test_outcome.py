"""Steps of an outcome."""

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest
from stand_in_twins import base_twin, standing_with, twin_with_gaps

from diagnose_camera import step_records
from effects import library
from gap.select.outcome import Step, in_last_twin, told_apart
from gap.select.standing import groups_left, residue_of
from gap.select.twin import Candidate
from trials.summarise_trials import names_in


def test_what_did_as_well_is_told_with_a_twin_in_its_place():
    """Fails if a group of names loses one, keeps one that the twin has anyway, or the next station cannot tell them apart."""
    twin = replace(base_twin(), effects=(("lens_blur", {"sigma_px": 1.0}), ("exposure", {"scale": 1.1})))
    step = Step("lens_blur", twin, (), (), "edges")
    told = told_apart(step, None, [("defocus", {"focus_m": 1.0}), ("exposure", {})], twin)
    assert told.confused_with == ("defocus",)
    assert [c.twin.names for c in told.candidates] == [["lens_blur", "exposure"], ["defocus", "exposure"]]
    assert told_apart(step, told, [], twin).confused_with == ("defocus",)


def test_a_parameter_at_its_bound_has_no_standard_error():
    """Fails if what a fit pushed against its bound is told with the error of a minimum, "0.000000 ± 0.000057", or another
    parameter of the same effect loses its own.
    """
    low, high = (getattr(library.parameters_of("denoising")["median_share"], end) for end in ("lower", "upper"))
    errors = {("denoising", k): 0.1 for k in ("strength_dn", "median_share")}
    for share, said in ((low, None), (0.5 * (low + high), 0.1), (high, None)):
        effects = (("denoising", {"strength_dn": 4.0, "median_share": share, "average_px": 0.8}),)
        told = replace(base_twin(), effects=effects, errors=errors).told("denoising")
        assert told["median_share"] == {"value": share, "se": said}
        assert told["strength_dn"]["se"] == 0.1 and told["average_px"]["se"] is None


LOSSES = {"defocus": 524.0, "motion_blur": 526.0, "field_curvature": 500.0, "denoising": 510.0}  # of the twin: 500


def exchanging_search(is_board=False):
    """Return a search in which a fit of the effects beside exposure loses what LOSSES says of the other, and notes them."""
    asked = []

    def fitted(effects, poses):
        (other, _), exposure = effects
        assert exposure == ("exposure", {"scale": 1.1})
        asked.append(other)
        return standing_with(effects, LOSSES[other])

    problem = SimpleNamespace(is_board=is_board, floor_within=1.0)
    return SimpleNamespace(problem=problem, fitted=fitted, asked=asked)


def step_confused_with(*names):
    """Return (Twin of a blur and an exposure, Step of the blur, tried beside others and confused with some effects)."""
    twin = replace(base_twin(), effects=(("lens_blur", {}), ("exposure", {"scale": 1.1})), groups={0: {}})
    twin.__dict__["losses"] = {0: 500.0}
    tried = tuple(Candidate(n, {}, twin, True) for n in ("lens_blur", "exposure", "vignetting", *LOSSES))
    return twin, Step("lens_blur", twin, tried, names, "edges")


@pytest.mark.parametrize(
    ("confused", "one_of"),
    [
        ((), ()),
        (("motion_blur",), ()),
        (("motion_blur", "defocus"), ("lens_blur", "defocus")),
        (("defocus", "denoising", "field_curvature"), ("lens_blur", "field_curvature", "denoising")),
        (("exposure",), ()),
    ],
    ids=["none", "costs more", "one of two costs less", "the three best", "is in the twin"],
)
def test_a_group_has_what_costs_less_than_a_gain_in_the_last_twin(confused, one_of):
    """Fails if what was hardly worse in an earlier twin stands for a name though the exchange costs more in the last one, the
    twin's own effects are exchanged for one another, or a group grows beyond three.
    """
    search, (twin, step) = exchanging_search(), step_confused_with(*confused)
    told = in_last_twin(search, twin, [step], {})
    assert [s.one_of for s in told] == [one_of]
    assert told[0].confused_with == tuple(n for n in confused if n != "exposure")
    assert search.asked == list(told[0].confused_with)  # no other fit


def test_names_of_a_board_are_told_from_information_not_by_fits():
    """Fails if a board's steps get a group twice, by two rules."""
    search, (twin, step) = exchanging_search(is_board=True), step_confused_with("defocus")
    assert in_last_twin(search, twin, [step], {})[0].one_of == () and not search.asked


@pytest.mark.parametrize(
    ("gap", "before", "floor_within", "is_told"),
    [
        (1.3, 10.0, 1.0, True),
        (1.09, 10.0, 1.0, False),
        (1.3, 2.0, 1.0, False),
        (1.3, 10.0, 2.0, False),
    ],
    ids=["closed, above the floor", "at the floor", "open", "where the floor is known to a factor"],
)
def test_what_a_form_leaves_is_told_of_a_group_that_was_closed(gap, before, floor_within, is_told):
    """Fails if a group at its floor has a residue, or one that stays open counts as closed."""
    first, last = twin_with_gaps(edges=before), twin_with_gaps(edges=gap)
    found = residue_of(last, "edges", first.excess, floor_within)
    assert found == ({"edges": pytest.approx(gap)} if is_told else {})


@pytest.mark.parametrize(
    ("gaps", "is_told"),
    [((1.15, 1.15), True), ((0.95, 1.35), False), ((0.9, 1.6), True)],
    ids=["captures agree", "a little, captures do not", "more than an error excuses"],
)
def test_what_captures_disagree_about_is_no_residue_if_it_is_little(gaps, is_told):
    """Fails if two errors of a group's gap, 0.1 at most, are not allowed for as the verdict does, or excuse all that is left."""
    groups = {i: twin_with_gaps(edges=gap).groups[0] for i, gap in enumerate(gaps)}
    last = replace(base_twin(), groups=groups, floors={"edges": 0.5})
    assert bool(residue_of(last, "edges", {"edges": 1e4})) == is_told


@pytest.mark.parametrize(
    ("gap", "first", "floor_within", "is_left"),
    [(6.0, 6.0, 1.0, True), (6.0, 20.0, 1.0, False), (2.0, 2.0, 1.0, False), (6.0, 6.0, 6.0, False)],
    ids=["as it was", "closed but for its form", "too little loss", "where the floor is known to a factor"],
)
def test_a_group_that_nothing_closed_is_left(gap, first, floor_within, is_left):
    """Fails if a group that another effect leaves as it was passes for a form of what closed the rest, or a form for another."""
    before = twin_with_gaps(levels=20.0, field=first)
    left = groups_left(twin_with_gaps(levels=1.0, field=gap), before.excess, floor_within)
    assert left == (["field"] if is_left else [])


@pytest.mark.filterwarnings("error")
def test_a_pose_has_no_residue():
    """Fails if a pose, which is no observable, is asked for its gap: a warning of an empty mean in a camera's log."""
    last = replace(base_twin(), groups={i: {"pose": np.ones(6)} for i in range(2)}, floors={})
    assert residue_of(last, "pose", {"pose": 1e3}) == {}


def test_the_first_of_a_groups_steps_has_its_residue():
    """Fails if a residue is told of each effect that changes a group a little, or of a group whose first step is another's."""
    first, last = twin_with_gaps(edges=20.0, levels=20.0, noise=20.0), twin_with_gaps(edges=1.3, levels=1.2, noise=1.0)
    names = [("lens_blur", "edges"), ("exposure", "levels"), ("sharpening", "edges"), ("sensor_noise", "noise")]
    steps = [Step(name, last, (), (), group) for name, group in names]
    told = in_last_twin(exchanging_search(), last, steps, first.excess)
    assert [list(step.residue) for step in told] == [["edges"], ["levels"], [], []]


def test_a_record_has_groups_and_residues_where_there_are_any():
    """Fails if what counts the names reads none, or if a step that stands alone seems to be one of several."""
    last = replace(twin_with_gaps(edges=1.3), effects=(("lens_blur", {}), ("exposure", {})))
    told = Step("lens_blur", last, (), ("defocus",), "edges", ("lens_blur", "defocus"), {"edges": 1.3})
    records = step_records([told, Step("exposure", last, (), (), "levels")], last, last.floors)
    assert [(r.get("one_of"), r.get("residue")) for r in records] == [
        (["lens_blur", "defocus"], {"edges": 1.3}),
        (None, None),
    ]
    assert names_in(records[0]) == ["lens_blur", "defocus"]
