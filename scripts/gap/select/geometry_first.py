"""Which effects that move points a twin lacks, told by corners alone: exact maps cost next to nothing.

Far off, the robust loss hides what each of several moves of points is worth. So all of them are fitted jointly, from afar, and
the fewest are kept without which, to second order, corners cannot do.
"""

from itertools import combinations

from effects import library
from gap.bounds import CLEAR_GAIN, CLOSED, LITTLE, MIN_GAIN
from gap.fit.evidence import cost_without
from gap.fit.residuals import RHO_NOISE
from gap.select.standing import has_good_share

SCALE, ITERATIONS = 64.0, 16  # robust scale at which the joint fit begins, and its steps


def told_by_corners(search, twin, names):
    """Return (effects [(name, parameters)] of a twin with those that corners tell, poses (n, 6), ``names`` that images may tell).

    The twin's own where corners are a small part of what it leaves open. Where all that moves points explains little of them,
    images would tell patches: they are asked for the others alone.
    """
    moving = [n for n in names if library.is_pure_geometry(n) and n not in twin.names]
    if not moving or not has_good_share("corners", twin.excess):
        return list(twin.effects), twin.poses, names
    effects, told = _told_with(search, twin, moving)
    if _excess(told) > (1 - LITTLE) * _excess(_told_with(search, twin, [])[1]):
        return list(twin.effects), twin.poses, [n for n in names if n not in moving]
    kept = _fewest(moving, _cost_without(search, effects, told))
    start, none = search.problem.start_poses(), search.solver.no_offsets()
    return *_fitted(search, [e for e in effects if e[0] in {*twin.names, *kept}], start, none), names


def are_told_by_others(search, twin, names, others):
    """Return whether of what corners leave open beside a twin all of ``names`` that move points leave much together, and those of
    ``others``, free warps say, little of that: a lens of another form is no warp.
    """
    moving, others = ([n for n in some if library.is_pure_geometry(n)] for some in (names, others))
    if not others or not has_good_share("corners", twin.excess):
        return False
    before, by_others = (_excess(_told_with(search, twin, some)[1]) for some in ([], others))
    if by_others > CLOSED * before:
        return False
    left = min(before, _excess(_told_with(search, twin, moving)[1]))
    return left > CLOSED * before and by_others < CLOSED * left


def _told_with(search, twin, names):
    """Return (effects, their ``_told``) of a twin with effects ``names`` beside its own, from nominal poses."""
    start, none = search.problem.start_poses(), search.solver.no_offsets()
    others = [(n, library.nulls_of(n)) for n in names if n not in twin.names]
    effects, poses = _fitted(search, [*twin.effects, *others], start, none)
    return effects, _told(search, effects, poses, none)


def _told(search, effects, poses, offsets):
    """Return (H, loss, count) of ``Solver.precision_by_corners`` of the training captures, by all that only moves points."""
    return search.solver.precision_by_corners(effects, _moving(search, effects), poses, offsets, search.train)


def _excess(told):
    """Return the loss of corners above that of their noise."""
    _, loss, count = told
    return max(loss - RHO_NOISE * count, 0.0)


def told_beside_the_rest(search, twin, names):
    """Return (effects, poses) of a twin in which those of ``names`` that only move points are what corners tell, once it is known
    how much its other effects move corners.
    """
    moving = [n for n in names if library.is_pure_geometry(n) and not search.is_fixed(n)]
    offsets = search.solver.offsets_of(list(twin.effects), twin.poses, search.train)
    others = [(n, library.nulls_of(n)) for n in moving if n not in twin.names]
    effects, poses = _fitted(search, [*twin.effects, *others], twin.poses, offsets)
    kept = _fewest(moving, _cost_without(search, effects, _told(search, effects, poses, offsets)), 2 * MIN_GAIN)
    return _fitted(search, [e for e in effects if e[0] in kept or e[0] not in moving], twin.poses, offsets)


def _fitted(search, effects, poses, offsets):
    """Return (effects, poses) with all that moves points fitted to the training captures' corners, from afar."""
    return search.solver.fit_geometry(
        effects, _moving(search, effects), poses, offsets, search.train, SCALE, ITERATIONS
    )


def _moving(search, effects):
    """Return the free parameters [(effect, parameter)] of those of some effects that only move points."""
    return [f for f in search.free(effects) if library.is_pure_geometry(f[0])]


def _cost_without(search, effects, told):
    """Return a function of some effects' names: the loss of corners that taking them all out costs to second order.

    Corners that other effects move a little scatter by more than their noise: losses are in units of what is left.
    """
    H, loss, count = told
    unit, cost = max(loss / (RHO_NOISE * count), 1.0), cost_without(effects, _moving(search, effects), H)
    return lambda names: cost(names) / unit


def _fewest(names, cost_without, least=CLEAR_GAIN):
    """Return the fewest of some effects without the rest of which corners lose less than ``least``; of as few, those that cost
    least.

    What is less clear than that is looked for where images are, beside these.
    """
    for count in range(len(names) + 1):
        costs = {kept: cost_without(set(names) - set(kept)) for kept in combinations(names, count)}
        best = min(costs, key=costs.get)
        if costs[best] < least:
            return list(best)
    return list(names)
