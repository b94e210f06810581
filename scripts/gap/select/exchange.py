"""Short fits in a few captures, what held-out ones tell of them, and which of several effects does best in one's place."""

from dataclasses import replace
from functools import partial

from effects import library
from gap.bounds import LITTLE, MAX_SIMPLE, MIN_GAIN, TWICE
from gap.fit.parameters import in_place, is_geometric
from gap.fit.residuals import NU, robust_scale_of, total
from gap.fit.split import probes
from gap.select.naming import is_as_good
from gap.select.search import MAX_STARTS, SCALE_FROM_NEAR, SCALE_FROM_START

FIRST_ITERATIONS, FURTHER_ITERATIONS = 9, 3  # of a fit of many effects at once, of one after a change to it
MAX_GROUP = 3  # effects that may stand for one another


def short_fit(search, effects, poses, scale, iterations=FURTHER_ITERATIONS, moving=None, rough=()):
    """Return the Descent, in a few captures, of all that is free of some effects, or of the parameters ``moving``; everything
    without the effects named ``rough`` first.
    """
    return search.descended(effects, poses, scale, probes(search.train), iterations, moving, rough)


def fitted_alone(search, effects, poses, names):
    """Return the Descent, in a few captures, in which the parameters of some of the effects move, and poses; the others stay.

    What moves no points leaves corners where they are: no fit of these comes first.
    """
    own = search.free([e for e in effects if e[0] in names])
    if any(is_geometric(f) for f in own):
        return short_fit(search, effects, poses, SCALE_FROM_NEAR, moving=own)
    return search.solver.descend(effects, own, poses, probes(search.train), FURTHER_ITERATIONS)


def with_best_starts(search, twin, proposal):
    """Return a twin's effects and a Proposal's: of one that has several starts, the start or first guess that leaves least.

    A fit of many hardly leaves the local minimum near which it begins. Where the twin has none yet, all are guesses: they stay.
    """
    if not search.free(twin.effects):
        return [*twin.effects, *proposal.effects]
    effects, few = dict([*twin.effects, *proposal.effects]), probes(search.train)
    nu = NU * robust_scale_of(search.solver.residuals_of(list(effects.items()), twin.poses, few)) ** 2

    def left(name, start):
        return total(search.solver.residuals_of(list((effects | {name: start}).items()), twin.poses, few), nu)

    for name in proposal.names:
        starts = search.problem.starts_of(name)
        if len(starts) > 1 and not library.is_pure_geometry(name):
            effects[name] = min([effects[name], *starts], key=partial(left, name))
    return list(effects.items())


def from_best_starts(search, end, names):
    """Return (effects, poses) of a Descent, or those in which some of the effects ``names`` begin anew from one of their starts:
    where an effect leaves less, its own parameters fitted alone.

    A fit of many ends in a local minimum near its beginning, and first guesses are made beside what is not fitted yet.
    """
    for name in names:
        if library.is_pure_geometry(name) or search.problem.shows(name):
            continue
        for start in _nearest_starts(search, end, name):
            other = fitted_alone(search, in_place(end.state.effects, name, (name, start)), end.state.poses, [name])
            if other.loss < end.loss - MIN_GAIN:
                end = other
    return list(end.state.effects), end.state.poses


def all_fitted_anew(search, base, twin, steps):
    """Return the Twin of some Steps, or what leaves clearly less: fitted anew from the starts of each effect in turn."""
    ways = zip(steps, [base, *(s.twin for s in steps)], strict=False)
    for step, before in (way for way in ways if way[0].effect not in way[1].names):
        anew = search.fitted_anew(twin, step.effect, before)
        twin = anew if anew.loss < twin.loss - MIN_GAIN else twin
    return twin


def _nearest_starts(search, end, name):
    """Return those MAX_STARTS of an effect's starts that leave least beside a Descent's others; none where it has but one."""
    starts = search.problem.starts_of(name)
    if len(starts) <= MAX_STARTS:
        return starts if len(starts) > 1 else ()

    def left(start):
        effects = in_place(end.state.effects, name, (name, start))
        return total(search.solver.residuals_of(effects, end.state.poses, probes(search.train)), NU)

    return sorted(starts, key=left)[:MAX_STARTS]


def exchanged(search, end, name, rivals, iterations=FURTHER_ITERATIONS):
    """Return (Descent in which an effect or one of its rivals has its place, whichever leaves least, its name, the others
    [(name, p)] that leave as little): all fitted as long, for so many ``iterations``.

    A rival is fitted with everything from the best of its first starts, its own parameters fitted alone, where that leaves no
    more than ``TWICE`` times as much. One of many forms takes a simple one's place only where it leaves ``LITTLE``
    less: it fits what is missing besides as well.
    """
    effects, poses = end.state.effects, end.state.poses
    others = [e for e in effects if e[0] != name]
    ends = {}
    for rival in rivals:
        starts = search.problem.starts_of(rival)[:MAX_STARTS]
        trials = [fitted_alone(search, [*others, (rival, start)], poses, [rival]) for start in starts]
        best = min(trials, key=loss_of)
        if best.loss < TWICE * end.loss:
            ends[rival] = short_fit(search, best.state.effects, best.state.poses, SCALE_FROM_NEAR, iterations)
    if any(rival.loss < end.loss + MIN_GAIN for rival in ends.values()):
        end = min(end, short_fit(search, effects, poses, SCALE_FROM_NEAR, iterations), key=loss_of)
    ends[name] = end
    held_back = 1.0 if has_forms(name) else 1 / (1 - LITTLE)
    left = {n: ends[n].loss * (held_back if has_forms(n) else 1.0) for n in sorted(ends)}
    kept = min(left, key=left.get)
    near = [n for n in left if n != kept and left[n] < left[kept] + MIN_GAIN]
    return ends[kept], kept, [(n, dict(ends[n].state.effects)[n]) for n in near]


def one_of(search, twin, name, others):
    """Return (name, others that cannot be told from it), the best first, MAX_GROUP of them at most; () where it stands alone."""
    alike = as_good_instead(search, twin, name, others)
    return (name, *alike) if alike else ()


def as_good_instead(search, twin, name, others):
    """Return {effect: Twin} of those that cannot be told from an effect, the best first, MAX_GROUP with it at most.

    ``others`` [(name, p)] are fitted in the effect's place in a Twin, with all the rest: each that is as good stands for it.
    """
    fitted = {other[0]: search.fitted(in_place(twin.effects, name, other), twin.poses) for other in others}
    alike = sorted((n for n in fitted if is_as_good(fitted[n], twin)), key=lambda n: sum(fitted[n].losses.values()))
    return {n: fitted[n] for n in alike[: MAX_GROUP - 1]}


def is_simple(name):
    """Return whether an effect has few parameters: one form, with which little else can be mimicked."""
    return len(library.fitted_parameters(name)) <= MAX_SIMPLE


def has_forms(name):
    """Return whether an effect of photometry has many forms: a curve, say. Moves of points are told by corners alone."""
    return not (is_simple(name) or library.is_pure_geometry(name))


def or_leader_alone(search, twin, proposal, end, iterations):
    """Return the Descent in which a Proposal was fitted or, where it stuck and leaves more, of what brings most in it, alone."""
    leader = max(proposal.names, key=lambda n: (end.evidence.get(n, 0.0), n))
    effects = [*twin.effects, (leader, dict(proposal.effects)[leader])]
    return min(end, short_fit(search, effects, twin.poses, SCALE_FROM_START, iterations), key=loss_of)


def loss_of(end):
    """Return the loss of a Descent."""
    return end.loss


def seen(search, twin):
    """Return a Twin as the captures of another search see it, in floors of its own, as the verdict's are."""
    effects = list(twin.effects)
    poses, groups = search.solver.score(effects, twin.poses, search.test)
    _, of_train = search.solver.score(effects, poses, search.train)
    return replace(twin, poses=poses, groups=groups, floors=search.floors_at(effects, poses, of_train | groups))


def standing(search, base, end):
    """Return the Twin of a Descent as far as held-out captures tell it."""
    return seen(search, replace(base, effects=tuple(end.state.effects), poses=end.state.poses, loss=end.loss))
