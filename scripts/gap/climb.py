"""From candidates to a verdict: the best is adopted, all are refitted, and the others tried again until the gap is closed."""

from dataclasses import dataclass

import numpy as np

from effects import library
from gap.diagnose import LEAST_GAIN, LEAST_PROMISE, MANY_PARAMETERS, fitted, gains_by_station, is_there, rank
from gap.fit import GROUPS
from gap.floors import excess_of, losses_of

LEAST_SHARE = 0.15  # of what is left above the floor, that a candidate must gain: less is a patch on a wrong form
MOST_OF_A_GROUP = 0.6  # of the excess of one group of observables, that is enough as well
MOST_STATIONS = 0.7  # share of held-out stations that must not lose: a highlight is not seen from everywhere
CLOSED = 0.2  # share of the first excess up to which the climb has closed the gap, though above the floor
FIRST_STEPS = 3  # that are tried one after the other, until one climb closes the gap well
HARDLY_CLOSED = 0.4  # share above which what helped a little gets no name
ALLOWED = 0.1
STILL_OPEN = 2.0  # gap, in units of the floor, that is open whatever it was at first
ENOUGH = 1.10  # a gap up to this, in units of the floor, is the floor


@dataclass
class Step:
    """One step of the climb: the effect that was added, the refitted twin and its held-out residuals."""

    effect: str
    effects: list
    errors: dict
    candidates: list
    confused_with: list
    groups: dict
    poses: np.ndarray
    main_group: str


@dataclass
class Outcome:
    """Where a climb ended: its steps, the candidates that were left, the verdict and the base it reached.

    ``closed`` says that the gap itself is at the floor, not only most of it gone.
    """

    steps: list
    left: list
    verdict: str
    share_left: float
    effects: list
    poses: np.ndarray
    closed: bool = False


def conclude(diagnosis, first, most_steps=6, progress=None):
    """Climb from the base, leave the diagnosis at what was found, and return the Outcome.

    The best first step is not always on the best way: where it leaves its own group of observables open, or comes near
    and does not reach the floor, the next best ones are tried as well. What can mimic anything of its kind, a warp of many waves,
    competes only where the others leave a gap.
    Where most of the gap stays, and no step closed the group of observables in which it gained most, a good share of it all,
    what helped is a patch on something else: it gets no name, and the base is restored.
    """
    start = Outcome([], rank(first), "unexplained", 1.0, diagnosis.effects, diagnosis.poses)
    before, excess = diagnosis.excess, max(sum(diagnosis.excess.values()), 1.0)
    rigid = [c for c in first if len(c.parameters) <= MANY_PARAMETERS]
    ways = [c for c in rank(rigid) if is_missing(c, before)][:FIRST_STEPS]
    best = climbed(diagnosis, rigid, excess, most_steps, progress)
    on_another_way = best.share_left < CLOSED or (ways and _is_open(diagnosis, main_group(ways[0]), before))
    for way in ways[1:] if on_another_way else []:
        if best.closed:
            break
        diagnosis.rebase(start.effects, start.poses)
        best = better(best, climbed(diagnosis, rigid, excess, most_steps, progress, way.effect))
    diagnosis.rebase(best.effects, best.poses)
    if best.verdict == "unexplained":
        best = _with_flexible(diagnosis, first, start, best, excess, most_steps, progress)
    diagnosis.rebase(best.effects, best.poses)
    closed = any(_closes_a_good_share(diagnosis, step.main_group, before) for step in best.steps)
    if best.verdict == "unexplained" and best.share_left > HARDLY_CLOSED and not closed:
        best = start
        diagnosis.rebase(best.effects, best.poses)
    for step in best.steps:  # what is there beside it is no other name for it
        step.confused_with = [n for n in step.confused_with if n not in dict(best.effects)]
    return best


def climbed(diagnosis, first, excess, most_steps, progress, start_with=None, taken=()):
    """Return the Outcome of a climb from the base; ``excess`` is the first one, in loss."""
    steps, left = climb(diagnosis, first, most_steps, progress, start_with, taken)
    return outcome_of(diagnosis, steps, left, excess)


def outcome_of(diagnosis, steps, left, excess):
    """Return the Outcome of steps that led to the diagnosis's base; ``excess`` is the first one, in loss."""
    share = sum(diagnosis.excess.values()) / excess
    reached = (diagnosis.base_gap, diagnosis.base_gap_se)
    closed = verdict_of(steps, *reached) != "unexplained"
    return Outcome(steps, left, verdict_of(steps, *reached, share), share, diagnosis.effects, diagnosis.poses, closed)


def climb(diagnosis, first, most_steps=6, progress=None, start_with=None, taken=()):
    """Add the best candidate, refit, try all others again, until none is missing or all is at its floor.

    Return (steps, last candidates).

    ``start_with`` names the effect of the first step, the best where None; ``taken`` are steps that led to the base.

    ``first`` are the candidates of the base, and their effects those that compete. An earlier effect that the refitted
    twin no longer needs is dropped.
    """
    steps, candidates = list(taken), rank(first)
    while len(steps) < most_steps:
        missing = [c for c in candidates if is_missing(c, diagnosis.excess)]
        if not missing:
            break
        best = next((c for c in missing if c.effect == start_with and not steps), missing[0])
        confused = confused_with(best, candidates, diagnosis.case)
        group, before = main_group(best), (diagnosis.effects, diagnosis.poses)
        fit = diagnosis.adopt(best)
        errors = {k: e for (n, k), e in zip(diagnosis.free(), fit.cautious_errors, strict=True) if n == best.effect}
        if not is_there(best.effect, dict(diagnosis.effects)[best.effect], errors):
            diagnosis.rebase(*before)  # beside the others, refitted, nothing of it is left
            candidates = [c for c in candidates if c is not best]
            continue
        for name in unneeded(
            diagnosis, [n for n, _ in diagnosis.effects if n != best.effect and n not in diagnosis.fixed]
        ):
            fit = diagnosis.drop(name)
            steps = [s for s in steps if s.effect != name]
        steps.append(_step(diagnosis, fit, best.effect, candidates, confused, group))
        if progress:
            progress(best.effect)
        if is_at_floor(diagnosis):
            return steps, rank([diagnosis.null_candidate(c.effect) for c in first])
        candidates = diagnosis.try_beside_others([c.effect for c in first], lambda c: is_missing(c, diagnosis.excess))
    return steps, candidates


def _with_flexible(diagnosis, first, start, best, excess, most_steps, progress):
    """Return the Outcome with the warps of many waves: added to what was found, or in the place of what they mimic.

    A warp brings its own lens along: rigid effects that move points must be worth their names beside it.
    """
    flexible = [c.effect for c in first if len(c.parameters) > MANY_PARAMETERS]
    tried = [diagnosis.try_effect(e) for e in flexible if diagnosis.promise(e) >= LEAST_PROMISE]
    further = climbed(diagnosis, tried + best.left, excess, most_steps, progress, taken=best.steps)
    found = min((best, further), key=lambda o: o.share_left)
    rigid = [
        step.effect for step in further.steps if step.effect not in flexible and library.is_pure_geometry(step.effect)
    ]
    if rigid and any(step.effect in flexible for step in further.steps):
        without = _retraced(diagnosis, start, further, rigid, excess)
        if without.verdict == "explained":
            return without
    return found


def _retraced(diagnosis, start, outcome, without, excess):
    """Return the Outcome of the same steps, each refitted, without some effects."""
    diagnosis.rebase(start.effects, start.poses)
    steps, found = [], dict(outcome.effects)
    for step in outcome.steps:
        if step.effect not in without:
            effects = diagnosis.effects + [(step.effect, found[step.effect])]
            fit = diagnosis.set_base(effects, [f for f in fitted(effects) if f[0] not in diagnosis.fixed])
            steps.append(_step(diagnosis, fit, step.effect, step.candidates, step.confused_with, step.main_group))
    left = rank([*outcome.left, *(diagnosis.null_candidate(name) for name in without)])
    return outcome_of(diagnosis, steps, left, excess)


def _step(diagnosis, fit, effect, candidates, confused, group):
    """Return the Step that led to the diagnosis's base."""
    errors = dict(zip(diagnosis.free(), fit.errors, strict=True))
    twin, seen = diagnosis.effects, diagnosis.base_groups
    return Step(effect, twin, errors, candidates, confused, seen, diagnosis.poses, group)


def is_at_floor(diagnosis):
    """Return whether every group of observables, poses too, is at its floor: what helps further has nothing to explain."""
    floors = {name: ENOUGH * diagnosis.floors.get(name, 1.0) for name in GROUPS}
    return not any(excess_of(diagnosis.base_groups, floors).values())


def is_missing(candidate, excess):
    """Return whether a candidate's held-out gain is more than chance, on most stations, matters, and closes enough.

    Enough is a good share of all that is left, or most of what is left in one group of observables (``excess``).
    """
    enough = candidate.gain > LEAST_SHARE * sum(excess.values()) or closes_a_group(candidate, excess)
    return bool(
        enough
        and candidate.matters
        and candidate.gain > LEAST_GAIN + 2 * len(candidate.parameters)
        and candidate.stations_gaining >= MOST_STATIONS
    )


def closes_a_group(candidate, excess):
    """Return whether most of what is left in one group of observables is gained."""
    least = LEAST_GAIN + 2 * len(candidate.parameters)
    return any(gain > max(least, MOST_OF_A_GROUP * excess[name]) for name, gain in candidate.group_gains.items())


def better(outcome, other):
    """Return the other outcome where it leaves less than half as much: the way of the best steps has the benefit."""
    return other if other.share_left < 0.5 * outcome.share_left else outcome


def main_group(candidate):
    """Return the group of observables in which a candidate gains most."""
    return max(candidate.group_gains, key=candidate.group_gains.get)


def _is_open(diagnosis, group, before):
    return diagnosis.excess[group] > CLOSED * before[group]


def _closes_a_good_share(diagnosis, group, before):
    return before[group] > LEAST_SHARE * sum(before.values()) and not _is_open(diagnosis, group, before)


def unneeded(diagnosis, names):
    """Return those effects without which the refitted twin is as good on the held-out captures."""
    out = []
    for name in names:
        rest = [(n, p) for n, p in diagnosis.effects if n != name]
        free = [f for f in diagnosis.free() if f[0] != name]
        fit = diagnosis.fitter.fit(rest, free, diagnosis.poses, diagnosis.train, iterations=6, scale=4.0)
        _, groups = diagnosis.fitter.score(fit.state.effects, fit.state.poses, diagnosis.test)
        if sum(losses_of(groups).values()) < sum(diagnosis.base_losses.values()) + LEAST_GAIN:
            out.append(name)
            break
    return out


def confused_with(best, candidates, case):
    """Return the names of candidates that the held-out stations cannot tell from the best one."""
    names = []
    for other in candidates:
        if other.effect == best.effect or other.gain < LEAST_GAIN:
            continue
        ahead = gains_by_station(case, other.losses, best.losses)
        error = np.sqrt(len(ahead)) * ahead.std(ddof=1) if len(ahead) > 1 else np.inf
        if ahead.sum() < max(LEAST_GAIN, min(2 * error, 0.2 * abs(best.gain))):
            names.append(other.effect)
    return names


def verdict_of(steps, gap, gap_se, share_left=1.0):
    """Return ``adequate``, ``explained`` or ``unexplained`` from the steps taken and the gap that is left.

    A gap that captures disagree about is no smaller for that: the error is allowed for up to ``ALLOWED`` only.
    ``share_left`` is what the climb left of the excess: effects have the right name before they have the last form.
    """
    nearly_closed = steps and share_left < CLOSED and gap < STILL_OPEN
    if gap - min(2 * np.nan_to_num(gap_se), ALLOWED) > ENOUGH and not nearly_closed:
        return "unexplained"
    return "explained" if steps else "adequate"
