"""Forward selection: the best effect is added, all are refitted, and the others tried again until the gap is closed.

``verdict`` is a function of its arguments alone: workflow, trials and tests call it alike.
"""

from dataclasses import replace
from itertools import groupby

from effects import library
from gap.bounds import (
    CLOSED,
    MANY,
    MIN_GAIN,
    MOST,
    TWICE,
)
from gap.select.candidates import try_beside_others, try_best_predicted, try_by_short_fits
from gap.select.exchange import all_fitted_anew, is_simple
from gap.select.geometry_first import are_told_by_others
from gap.select.joint_way import all_at_once
from gap.select.naming import errors_to_exceed, is_flexible, is_missing_from, is_one_enough, is_significant
from gap.select.outcome import (
    Selection,
    Step,
    confused_with,
    in_last_twin,
    outcome_of,
    twins_on_the_way,
    without_unneeded,
)
from gap.select.search import Search
from gap.select.standing import (
    closes_a_good_share,
    groups_left,
    has_good_share,
    is_at_floor,
    is_nothing_left,
    is_open,
)
from gap.select.twin import rank

MAX_TRIED = 6  # candidates that are fitted in the first step; others stay at their null
FIRST_STEPS = 3  # that are tried one after the other, until one path closes the gap well
BUDGET = 60_000  # predictions and derivatives by images, of one capture each


def verdict(problem, effects=(), candidates=None, fixed=(), budget=BUDGET, threads=1, progress=None, store=None):
    """Return (Search, base Twin, candidates of the first step, Outcome) of a problem.

    effects  [(name, parameters)] of the twin as configured, fixed {(effect, parameter)} what the user fixed of it;
    candidates  names of the library's effects that compete, all where None; budget in predictions of one capture;
    progress  called with each effect that is added and the share of the budget that is spent; store of outcomes (kept.py).
    Where a board's points stay unexplained and its photographs may have moved while they were read, it is that of the problem in
    which they did (BoardCase.moving), if most of what was left is that. Raises ValueError where ``Search.why_unusable`` has a
    reason.
    """
    found = _verdict(problem, effects, candidates, fixed, budget, threads, progress, store)
    search, _, _, outcome = found
    moving = problem.moving(search, outcome.twin) if outcome.verdict == "unexplained" and not problem.draws else None
    if moving is None:
        return found
    # What is stored is of photographs at rest
    with_motion = _verdict(moving, effects, candidates, fixed, budget, threads, progress, None)
    left = sum(with_motion[-1].twin.excess.values())
    return with_motion if left < (1 - MOST) * sum(outcome.twin.excess.values()) else found


def _verdict(problem, effects, candidates, fixed, budget, threads, progress, store):
    search = Search(problem, candidates, fixed, threads=threads, store=store)
    if search.why_unusable():
        raise ValueError(search.why_unusable())
    base = search.fitted([e for e in problem.nuisances if e[0] not in dict(effects)] + list(effects))
    rigid = [n for n in search.candidates if not is_flexible(n) and n not in base.names]
    first, gains = try_best_predicted(search, base, rigid, MAX_TRIED)
    first += [search.null_candidate(base, n) for n in search.candidates if is_flexible(n) and n not in base.names]
    return search, base, first, concluded(Selection(search, budget, gains, progress), base, first)


def concluded(selection, base, first):
    """Return the Outcome of the best of several paths from a base; of that on which warps come first, where it explains."""
    before = base.excess
    if selection.search.problem.floor_within > 1 and is_at_floor(base):  # as good as no repeats can tell
        return outcome_of(selection.search.problem, (), rank(first), base, before)
    warped = _with_warps_first(selection, base, first, before)
    best = warped if warped and warped.verdict == "explained" else _concluded(selection, base, first, before)
    within_budget = not selection.is_spent()  # what follows changes no name
    told = in_last_twin(selection.search, best.twin, best.steps, before)
    others = best.steps and groups_left(best.twin, before, selection.search.problem.floor_within)
    return replace(best, steps=told, within_budget=within_budget, verdict="unexplained" if others else best.verdict)


def _concluded(selection, base, first, before):
    """Return the Outcome of the best of several paths on which warps compete last.

    Where many effects are proposed together, and none alone leaves nothing, they are fitted so first, else one is added after the
    other. The best first step is not always on the best way: where it leaves its own group of observables open, or comes near and
    does not reach the floor, the next best ones are tried as well. What can mimic anything of its kind, a warp of many waves,
    competes only where the others leave a gap. Where most of the gap stays, and no step closed the group of observables in which
    it gained most, a good share of it all, what helped is a patch on something else: it gets no name.
    """
    rigid = [c for c in first if not is_flexible(c.effect)]
    best = None if is_one_enough(rigid) else all_at_once(selection, base, base, [c.effect for c in rigid], before)
    if not best or best.verdict == "unexplained":
        best = _one_by_one(selection, base, rigid, before, best)
    if best.verdict == "unexplained" and not (selection.is_spent() or selection.search.problem.is_of_signs):
        best = _begun_anew(selection, base, best, before)
    # Of many, each was held against others; where all is told by exact maps, looking costs next to nothing
    if best.steps and len(best.steps) < MANY and not (is_at_floor(best.twin) and selection.search.problem.draws):
        best = _with_simpler(selection, base, rigid, best, before)
    if best.verdict == "unexplained" and not selection.is_spent():
        best = _with_flexible(selection, base, first, best, before)
    patched = not any(closes_a_good_share(best.twin, step.main_group, before) for step in best.steps)
    if not best.is_closed and best.share_left > TWICE * CLOSED and patched:
        return outcome_of(selection.search.problem, (), rank(first), base, before)
    return best


def _with_warps_first(selection, base, first, before):
    """Return the Outcome of warps and what is missing beside them, where corners tell that nothing else closes their gap; None
    elsewhere. Warps are named last.
    """
    search = selection.search
    flexible = [c.effect for c in first if is_flexible(c.effect)]
    rigid = [c.effect for c in first if c.effect not in flexible]
    if search.problem.is_board or is_one_enough(first) or not are_told_by_others(search, base, rigid, flexible):
        return None
    ahead = Selection(search, selection.budget, selection.gains, selection.progress)  # sets had so may be had without
    best = _with_flexible(ahead, base, first, outcome_of(search.problem, (), rank(first), base, before), before)
    steps = sorted(best.steps, key=lambda step: is_flexible(step.effect))
    there = twins_on_the_way(search, base, best.twin, [step.effect for step in steps])
    return replace(best, steps=tuple(replace(s, twin=t) for s, t in zip(steps, there, strict=True)))


def _one_by_one(selection, base, first, before, together):
    """Return the Outcome of the best of several paths; an Outcome ``together`` where it leaves far less."""
    ways = [c for c in rank(first) if is_missing_from(selection.search, base, c)][:FIRST_STEPS]
    best = path(selection, base, first, before)
    if together and together.share_left < MOST * best.share_left:
        best = together
    on_another_way = best.share_left < CLOSED or (ways and is_open(best.twin, ways[0].main_group, before))
    for way in ways[1:] if on_another_way else []:
        if _is_good(selection.search.problem, best, before) or selection.is_spent():
            break
        other = path(selection, base, first, before, way.effect)
        if _leads_farther(other, best):
            best = other
    return best


def _begun_anew(selection, base, best, before):
    """Return an Outcome, or where it goes on with effects fitted anew from their starts, if that leaves less held out as well."""
    search, twin = selection.search, all_fitted_anew(selection.search, base, best.twin, best.steps)
    if twin is best.twin:
        return best
    steps = (*best.steps[:-1], replace(best.steps[-1], twin=twin))
    further = outcome_of(search.problem, steps, best.left, twin, before)
    if further.verdict == "unexplained":
        candidates, _ = try_beside_others(search, twin, [c.effect for c in best.left], {})
        further = path(selection, twin, candidates, before, taken=steps)
    return min((best, further), key=lambda o: o.share_left)


def _leads_farther(other, best):
    """Return whether another path's Outcome is taken before the best steps': it explains, as they do not, or leaves far less."""
    explains = best.verdict == "unexplained" and other.verdict == "explained"
    return other.share_left < (1.0 if explains else MOST) * best.share_left


def _is_good(problem, outcome, before):
    """Return whether nothing more is tried beside an Outcome's steps, the first excess ``before``: of signs, whose floors are
    seldom reached, where the verdict explains and no group is open that had a good share.
    """
    if not problem.is_of_signs:
        return outcome.is_closed
    open_ones = [g for g in before if has_good_share(g, before) and is_open(outcome.twin, g, before)]
    return outcome.verdict != "unexplained" and not open_ones


def path(selection, base, first, before, start_with=None, taken=()):
    """Return the Outcome of adding the best candidate, refitting and trying all others again, until none is missing.

    ``first`` are the candidates of the base, and their effects those that compete; ``start_with`` names the effect of the
    first step, the best where None; ``taken`` are steps that led to the base; ``before`` is the first excess. An earlier effect
    that the refitted twin no longer needs is taken out. Where many others are proposed together beside a step, they are
    fitted so.
    """
    search, twin, gains = selection.search, base, selection.gains
    steps, candidates, names = list(taken), rank(first), [c.effect for c in first]
    while not selection.is_spent():
        missing = [c for c in candidates if is_missing_from(search, twin, c)]
        if not missing and search.problem.is_of_signs:
            here = outcome_of(search.problem, steps, (), twin, before)
            if not _is_good(search.problem, here, before):
                candidates = try_by_short_fits(search, twin, candidates)
                missing = [c for c in candidates if is_missing_from(search, twin, c)]
        if not missing:
            break
        best = next((c for c in missing if c.effect == start_with and not steps), missing[0])
        adopted = search.adopt(best)
        to_exceed = errors_to_exceed(search.problem, twin, adopted)
        if not is_significant(best.effect, dict(adopted.effects)[best.effect], to_exceed):
            candidates = [c for c in candidates if c is not best]  # beside the others, refitted, nothing of it is left
            continue
        confused = confused_with(search.problem, best, candidates)
        twin, steps = without_unneeded(search, adopted, {best.effect}, steps)
        steps.append(Step(best.effect, twin, tuple(candidates), tuple(confused), best.main_group))
        if selection.progress:
            selection.progress(best.effect, search.cost / selection.budget)
        if is_at_floor(twin) or is_nothing_left(twin):
            candidates = [search.null_candidate(twin, name) for name in names if name not in twin.names]
            break
        if not selection.is_new(twin.names):
            break
        together = all_at_once(selection, base, twin, names, before, steps) if not taken else None
        if together and together.verdict == "explained":
            return together
        candidates, gains = try_beside_others(search, twin, names, gains)
    return outcome_of(search.problem, steps, rank(candidates), twin, before)


def _with_simpler(selection, base, first, best, before):
    """Return the Outcome with simpler effects in the place of one of many parameters, a curve say, that stands for them.

    Where the predicted gain of some simpler ones together is what it brings, they take its place, if they then do as well.
    """
    search, simple = selection.search, [c.effect for c in first if is_simple(c.effect)]
    for step in best.steps:
        if is_simple(step.effect) or selection.is_spent():
            continue
        alike = [n for n in simple if library.affects(n) == library.affects(step.effect) and n not in best.twin.names]
        rest, sets = [e for e in best.twin.effects if e[0] != step.effect], search.mimics(best.twin, step.effect, alike)
        effects = {tuple(simpler): [*rest, *((n, library.nulls_of(n)) for n in simpler)] for simpler in sets}
        likely = [simpler for simpler in effects if search.may_do_as_well(best.twin, effects[simpler])]
        for _, of_a_size in groupby(likely, len):
            twins = {simpler: search.fitted(effects[simpler], best.twin.poses) for simpler in of_a_size}
            simpler = min(twins, key=lambda some: sum(twins[some].losses.values()))
            if sum(twins[simpler].losses.values()) < sum(best.twin.losses.values()):
                best = _in_its_place(search, base, best, step, simpler, twins[simpler], before)
                break
    return best


def _in_its_place(search, base, outcome, step, simpler, twin, before):
    """Return an Outcome whose last Twin is another, with simpler effects in the place of one of its Steps."""
    at = outcome.steps.index(step)
    instead = [replace(step, effect=n, confused_with=()) for n in simpler]  # those were the curve's
    steps = [*outcome.steps[:at], *instead, *outcome.steps[at + 1 :]]
    there = twins_on_the_way(search, base, twin, [s.effect for s in steps])
    steps = [replace(s, twin=t) for s, t in zip(steps, there, strict=True)]
    left = [*(c for c in outcome.left if c.effect not in simpler), search.null_candidate(twin, step.effect)]
    return outcome_of(search.problem, steps, rank(left), twin, before)


def _with_flexible(selection, base, first, best, before):
    """Return the Outcome with the warps of many waves: added to what was found, or in the place of what they mimic.

    A warp brings its own lens along: rigid effects that move points must be worth their names beside it.
    """
    search = selection.search
    flexible = [c.effect for c in first if is_flexible(c.effect)]
    gains = search.predicted_gains(best.twin, flexible)
    tried = [search.try_effect(best.twin, name) for name in gains if gains[name] >= MIN_GAIN]
    if not tried:
        return best
    further = path(selection, best.twin, [*tried, *best.left], before, taken=best.steps)
    found = min((best, further), key=lambda o: o.share_left)
    rigid = [s.effect for s in further.steps if s.effect not in flexible and library.is_pure_geometry(s.effect)]
    if rigid and any(step.effect in flexible for step in further.steps):
        without = _retraced(search, base, further, rigid, before)
        if without.verdict == "explained":
            return without
    return found


def _retraced(search, base, outcome, without, before):
    """Return the Outcome of the same steps, each refitted, without some effects."""
    twin, steps, found = base, [], dict(outcome.twin.effects)
    for step in outcome.steps:
        if step.effect not in without:
            twin = search.fitted([*twin.effects, (step.effect, found[step.effect])], twin.poses)
            steps.append(replace(step, twin=twin))
    left = rank([*outcome.left, *(search.null_candidate(twin, name) for name in without)])
    return outcome_of(search.problem, steps, left, twin, before)
