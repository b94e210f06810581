"""The second look at photographs of a board: with lens and poses from its points, what do the cells themselves show?

diagnose_camera calls it where ``diagnose.cells`` is set. Points tell where light lands; levels, edges, colours and noise of the
board's patches tell what became of it. Both looks make one record: the steps of the first, told in gaps of the patches, and
those of the second.
"""

import logging

from case_files import load_patches
from gap import ladder
from gap.photographs import competing
from gap.score import gap_error, overall_gap
from gap.search import Search
from gap.select_effects import verdict

log = logging.getLogger("twingap")


def look_at_patches(files, points, outcome, candidates, budget, threads, progress, store):
    """Return (Search, base Twin, candidates of the first step, Outcome, {effect: why it does not compete}) of a board's patches.

    files (expand, register_json, camera, patches.npz); points is the BoardCase, outcome where its search ended. Raises ValueError
    where too little of the board can be measured.
    """
    case = load_patches(*files, points, outcome.twin)
    given = list(outcome.twin.effects)
    fixed = {(name, key) for name, p in given for key in p}
    search = Search(case, candidates, fixed, threads=threads, store=store)
    if search.why_unusable():
        raise ValueError(search.why_unusable())
    names, why = competing(search, search.fitted(given), candidates)
    return *verdict(case, given, names, fixed, budget, threads, progress, store), why


def both_looks(first, second, search, base, steps):
    """Return the record of both looks: records ``first`` of the points, ``second`` of the patches.

    search is that of the patches; base and steps are those of the points: their gaps are told as patches show them.
    """
    floors = second["floor"]
    gaps = [_gap_of(search, twin, floors) for twin in (base, *(step.twin for step in steps))]
    told = [
        record | {"gap_before": before[0], "gap_after": after[0], "gap_after_se": after[1]}
        for record, before, after in zip(first["steps"], gaps[:-1], gaps[1:], strict=True)
    ]
    named = [*told, *second["steps"]]
    open_ones = "unexplained" in (first["verdict"], second["verdict"])
    return first | {
        "verdict": "unexplained" if open_ones else "explained" if named else "adequate",
        "gap": second["gap"],
        "gap_se": second["gap_se"],
        "gap_as_configured": gaps[0][0],
        "groups": second["groups"],
        "floor": floors | {"corners_px": first["floor"]["corners_px"]},
        "steps": named,
        "candidates": _numbered(first["candidates"], second["candidates"]),
        "candidates_left": _numbered(first["candidates_left"], second["candidates_left"]),
        "within_budget": first["within_budget"] and second["within_budget"],
        "points": {k: first[k] for k in ("verdict", "gap", "gap_se", "gap_as_configured", "groups")},
    }


def rows_of_both(rows, search, outcome, twins):
    """Return the ladder's rows of the points, gaps as patches show them, and a row for each step of the patches' Outcome.

    ``twins`` are those of the rows. Where points land is the same for all steps that patches showed.
    """
    case, start = search.problem, search.problem.start_poses()
    twins = [(name, effects, start) for name, effects, _ in twins]
    twins += [(step.effect, list(step.twin.effects), step.twin.poses) for step in outcome.steps]
    of_patches = ladder.rungs(search.solver, twins, search.test, {}, outcome.twin.floors)
    log.info("%s: %d patches of the board in %d photographs", case.camera, len(case.patches), len(case.captures))
    of_gap = [c for c in ladder.COLUMNS if c.startswith("gap")]
    points = [*rows, *[rows[-1]] * len(outcome.steps)]
    return [
        point | {k: patch[k] for k in ("step", "effect", *of_gap)}
        for point, patch in zip(points, of_patches, strict=True)
    ]


def _gap_of(search, twin, floors):
    """Return (gap, its error) that held-out patches show of a Twin of the points."""
    _, groups = search.solver.score(list(twin.effects), search.problem.start_poses(), search.test)
    return overall_gap(groups, floors), gap_error(groups, floors)


def _numbered(first, second):
    return [c | {"rank": k + 1} for k, c in enumerate([*first, *second])]
