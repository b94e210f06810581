"""Which first steps are tried, one after the other, and whether what they lead to gets names."""

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest
from stand_in_twins import twin_with_gaps

from effects import library
from gap.select import candidates, select_effects
from gap.select.outcome import Step, outcome_of
from gap.select.search import MAX_STARTS, Search
from gap.select.twin import Candidate


def best_way(monkeypatch, path, names, before, is_of_signs):
    """Return the Outcome that is taken of ways which begin with effects of some names and go where ``path`` says."""
    monkeypatch.setattr(select_effects, "path", path)
    monkeypatch.setattr(select_effects, "is_missing_from", lambda *_: True)
    monkeypatch.setattr(select_effects, "rank", list)
    search = SimpleNamespace(problem=SimpleNamespace(is_of_signs=is_of_signs))
    first = [SimpleNamespace(effect=n, main_group="edges") for n in names]
    return select_effects._one_by_one(SimpleNamespace(search=search, is_spent=lambda: False), None, first, before, None)


@pytest.mark.parametrize(
    ("is_of_signs", "left", "tried"),
    [
        (True, {"levels": 0.1, "edges": 10.0}, [None]),
        (True, {"levels": 0.1, "edges": 25.0}, [None, "defocus", "motion_blur"]),
        (True, {"levels": 5.0, "edges": 1.0}, [None]),
        (False, {"levels": 0.1, "edges": 10.0}, [None, "defocus", "motion_blur"]),
    ],
    ids=["cells", "cells, edges open", "cells, few levels open", "a rig"],
)
def test_a_boards_cells_are_searched_again_only_where_a_good_share_is_open(monkeypatch, is_of_signs, left, tried):
    """Fails if photographs, whose signs seldom reach their floors, cost another way beside a verdict that explains them, if none
    is tried where edges, most of the gap, stay open beside closed noise, or if a rig's way that closes most and does not reach
    its floor is the only one.
    """
    ways, before = [], {"levels": 10.0, "edges": 100.0}

    def path(selection, base, first, before, start_with=None):
        ways.append(start_with)
        return SimpleNamespace(verdict="explained", is_closed=False, share_left=0.1, twin=SimpleNamespace(excess=left))

    best_way(monkeypatch, path, ("lens_blur", "defocus", "motion_blur"), before, is_of_signs)
    assert ways == tried


def test_only_a_boards_points_are_asked_whether_they_moved(monkeypatch):
    """Fails if a rig's captures or a board's cells that stay unexplained end in an error: they are not asked how they moved."""
    found = None, None, [], SimpleNamespace(verdict="unexplained")
    monkeypatch.setattr(select_effects, "_verdict", lambda *_: found)
    assert select_effects.verdict(SimpleNamespace(draws=True)) is found


@pytest.mark.parametrize(
    ("verdicts", "left", "taken"),
    [
        ("unexplained explained", (0.29, 0.20), 1),
        ("unexplained explained", (0.29, 0.30), 0),
        ("unexplained unexplained", (0.29, 0.20), 0),
        ("unexplained unexplained", (0.29, 0.14), 1),
        ("explained explained", (0.29, 0.20), 0),
    ],
)
def test_a_way_that_explains_takes_the_place_of_one_that_does_not(monkeypatch, verdicts, left, taken):
    """Fails if a camera stays unexplained by the best first step where the next best one explains more of it, or if the best
    step's way, as good by its verdict, gives way to one that leaves hardly less.
    """
    outcomes = [
        SimpleNamespace(verdict=v, is_closed=False, share_left=share, twin=SimpleNamespace(excess={"edges": 25.0}))
        for v, share in zip(verdicts.split(), left, strict=True)
    ]
    ways = iter(outcomes)
    best = best_way(monkeypatch, lambda *_: next(ways), ("motion_blur", "denoising"), {"edges": 100.0}, False)
    assert best is outcomes[taken]


@pytest.mark.parametrize(("field", "said"), [(4.6, "unexplained"), (1.0, "explained")])
def test_what_is_named_explains_no_group_that_it_leaves(monkeypatch, field, said):
    """Fails if a strong effect's name is said to explain a camera whose other fault, in a group of its own, is as it was."""
    quiet = dict.fromkeys(("corners", "edges", "colour", "noise"), 0.5)
    base, last = twin_with_gaps(levels=40.0, field=4.6, **quiet), twin_with_gaps(levels=1.0, field=field, **quiet)
    step, problem = Step("exposure", last, (), (), "levels"), SimpleNamespace(floor_within=1.0)
    explained = outcome_of(problem, [step], (), last, base.excess)
    assert explained.verdict == "explained"
    monkeypatch.setattr(select_effects, "_with_warps_first", lambda *_: explained)
    monkeypatch.setattr(select_effects, "in_last_twin", lambda search, twin, steps, before: steps)
    selection = SimpleNamespace(search=SimpleNamespace(problem=problem), is_spent=lambda: False)
    found = select_effects.concluded(selection, base, [])
    assert (found.verdict, [s.effect for s in found.steps]) == (said, ["exposure"])


@pytest.mark.parametrize("there", ["lens_blur", "vignetting"])
def test_short_fits_begin_what_a_sharpening_undoes_anew(monkeypatch, there):
    """Fails if a sharpening is fitted only beside the weak blur that stands for both, or beside a fall-off, which hides none."""
    own, begun = (there, library.nulls_of(there)), []

    def short_fit(search, effects, *_):
        begun.append(effects)
        return SimpleNamespace(loss=1000.0)

    monkeypatch.setattr(candidates, "short_fit", short_fit)
    search = SimpleNamespace(problem=SimpleNamespace(starts_of=library.starts_of), train=[0, 1, 2, 3])
    twin = SimpleNamespace(effects=(own,), poses=None, names=[there])
    candidates.try_by_short_fits(
        search, twin, [SimpleNamespace(effect="sharpening", complete=False, gain=0.0, parameters={})]
    )
    anew = [(there, start) for start in library.starts_of(there)[:MAX_STARTS]]
    starts = library.starts_of("sharpening")
    beside_a_blur = [[own], *([beside, ("sharpening", start)] for start in starts for beside in [own, *anew])]
    assert begun == (beside_a_blur if there == "lens_blur" else [])


def twin_with_excess(**excess):
    """Return a Twin whose groups of observables lie above their floors by a loss each, in the same units."""
    return twin_with_gaps(**{group: np.sqrt(1 + loss) for group, loss in excess.items()})


@pytest.mark.parametrize(
    ("after", "is_named"),
    [
        ({"levels": 44.0, "edges": 40.0}, False),
        ({"levels": 48.0, "edges": 36.0}, False),
        ({"levels": 23.0, "edges": 40.0}, False),
        ({"levels": 20.0, "edges": 19.0}, True),
        ({"levels": 10.0, "edges": 40.0}, True),
        ({"levels": 0.1, "edges": 0.1}, True),
    ],
    ids=["16 % of one group", "16 % of two", "37 %", "61 %", "all but a sixth of its own group", "all"],
)
def test_what_closes_little_of_a_gap_that_stays_open_gets_no_name(monkeypatch, after, is_named):
    """Fails if a step that closes a sixth, or a third, of the excess keeps its name though the gap is open, or if one that
    closes most of it, or its own group, loses it.
    """
    problem = SimpleNamespace(floor_within=1.0, is_board=False, draws=True)
    selection = SimpleNamespace(search=SimpleNamespace(problem=problem), is_spent=lambda: True)
    base, twin = twin_with_excess(levels=60.0, edges=40.0), twin_with_excess(**after)
    step = Step("exposure", twin, (), (), "levels")
    best = outcome_of(problem, [step], [], twin, base.excess)
    monkeypatch.setattr(select_effects, "all_at_once", lambda *_: None)
    monkeypatch.setattr(select_effects, "_one_by_one", lambda *_: best)
    told = select_effects.concluded(selection, base, [])
    assert [s.effect for s in told.steps] == (["exposure"] if is_named else [])
    assert told.twin is (twin if is_named else base)


@pytest.mark.parametrize(("left", "is_asked"), [({"edges": 1.0}, False), ({"edges": 1.0, "levels": 1.0}, True)])
def test_many_are_fitted_together_only_where_one_leaves_something(monkeypatch, left, is_asked):
    """Fails if a single effect that leaves nothing costs a search for many, or if what it leaves is not looked into."""
    base, asked = twin_with_excess(levels=60.0, edges=40.0), []
    one = Candidate("lens_blur", {"sigma_px": 1.0}, twin_with_excess(**left), True, gain=1000.0)
    problem = SimpleNamespace(floor_within=1.0, is_board=False, draws=True)
    outcome = outcome_of(problem, [], [], base, base.excess)
    monkeypatch.setattr(select_effects, "all_at_once", lambda *a: asked.append(a))
    monkeypatch.setattr(select_effects, "_one_by_one", lambda *_: outcome)
    selection = SimpleNamespace(search=SimpleNamespace(problem=problem), is_spent=lambda: True)
    select_effects.concluded(selection, base, [one])
    assert bool(asked) == is_asked


@pytest.mark.parametrize(
    ("gain", "left", "end"),
    [(900.0, 0.1, "anew"), (900.0, 30.0, "beside it"), (900.0, 90.0, "stuck"), (10.0, 0.1, "stuck")],
    ids=["another minimum", "one that leaves a gap", "one that leaves more held out", "hardly less"],
)
def test_what_leaves_a_gap_is_fitted_anew_before_the_search_ends(monkeypatch, gain, left, end):
    """Fails if a near lamp stays `unexplained` in the wrong place where its fit from another start closes the gap, if nothing is
    sought beside a better place that leaves one, if a twin that is worse held out or hardly differs counts, or if effects of the
    base begin anew.
    """
    lamp, lens = (("illumination_gradient", {}), ("vignetting", {}))
    base = replace(twin_with_excess(levels=100.0), effects=(lens,))
    stuck = replace(twin_with_excess(levels=60.0), effects=(lens, lamp), loss=1000.0)
    asked, anew = [], replace(twin_with_excess(levels=left), effects=(lens, lamp), loss=1000.0 - gain)

    def fitted_anew(twin, effect, before):
        asked.append((effect, before.names))
        return anew

    monkeypatch.setattr(select_effects, "try_beside_others", lambda *_: ([], {}))
    monkeypatch.setattr(select_effects, "path", lambda s, twin, first, before, taken: found_beside(twin, taken))
    problem = SimpleNamespace(floor_within=1.0)

    def found_beside(twin, taken):
        return outcome_of(problem, [*taken, Step("defocus", twin, (), (), "edges")], [], twin, base.excess)

    selection = SimpleNamespace(search=SimpleNamespace(problem=problem, fitted_anew=fitted_anew))
    taken = [Step("vignetting", base, (), (), "levels"), Step("illumination_gradient", stuck, (), (), "levels")]
    best = outcome_of(problem, taken, [], stuck, base.excess)
    found = select_effects._begun_anew(selection, base, best, base.excess)
    assert asked == [("illumination_gradient", ["vignetting"])]
    if end == "stuck":
        assert found is best
    else:
        assert found.twin is anew and [s.twin for s in found.steps[:2]] == [base, anew]
        assert [s.effect for s in found.steps[2:]] == (["defocus"] if end == "beside it" else [])


def test_an_effect_begins_anew_where_it_has_several_likely_starts():
    """Fails if the fit that leaves least is not taken, the values before count as none, or what has one start is fitted again."""
    twin = SimpleNamespace(effects=[("vignetting", {}), ("defocus", {"focus_m": 1.0})], poses=None, loss=50.0)
    fitted = []

    def fit(effects, poses, scale):
        fitted.append([dict(effects)["defocus"]["focus_m"], list(dict(effects))])
        return SimpleNamespace(loss=10.0 * dict(effects)["defocus"]["focus_m"])

    def anew(*starts):
        search = SimpleNamespace(
            store=None, fitted=fit, _likely_starts=lambda before, effect: [{"focus_m": s} for s in starts]
        )
        return Search.fitted_anew(search, twin, "defocus", None).loss

    assert (anew(3.0, 2.0), anew(8.0, 9.0), anew(1.0)) == (20.0, 50.0, 50.0)
    assert fitted == [[focus, ["vignetting", "defocus"]] for focus in (3.0, 2.0, 8.0, 9.0)]


def test_only_what_may_do_as_well_is_fitted_whole_in_a_curves_place(monkeypatch):
    """Fails if each set of simpler effects is fitted whole, which takes longer than all the rest, or if a longer set is taken
    where a shorter one does as well.
    """
    fitted, likely = [], [["exposure"], ["exposure", "veiling_glare"]]
    twin = SimpleNamespace(effects=(("tone_curve", {}),), names=["tone_curve"], poses=None, losses={0: 500.0})

    def fit(effects, poses):
        fitted.append([n for n, _ in effects])
        return SimpleNamespace(losses={0: 400.0})

    search = SimpleNamespace(
        mimics=lambda *_: [["ink_reflectance"], *likely],
        may_do_as_well=lambda _, effects: [n for n, _ in effects] in likely,
        fitted=fit,
    )
    monkeypatch.setattr(select_effects, "_in_its_place", lambda *a: a[4])
    step = SimpleNamespace(effect="tone_curve")
    selection = SimpleNamespace(search=search, is_spent=lambda: False)
    first = [SimpleNamespace(effect=n) for n in ("exposure", "veiling_glare", "ink_reflectance")]
    best = SimpleNamespace(steps=[step], twin=twin)
    taken = select_effects._with_simpler(selection, None, first, best, None)
    assert list(taken) == ["exposure"] and fitted == [["exposure"]]
