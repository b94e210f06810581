"""Where a search stands: the sets of effects that it has had, its steps, and the outcome of a way through it."""

from dataclasses import dataclass, field, replace

from gap.bounds import CLOSED, MIN_GAIN, TWICE
from gap.fit.parameters import in_place
from gap.fit.score import error_of_sum, gains_by_station
from gap.select.exchange import one_of
from gap.select.search import Search
from gap.select.standing import residue_of, verdict_of
from gap.select.twin import Candidate, Twin


@dataclass(frozen=True)
class Step:
    """One step: the effect that was added, the refitted twin, and what else was tried.

    confused_with  names that were hardly worse; one_of  its own and those that would do as well in the last twin, where any would
    main_group  of observables, in which it gained most; residue  {it: gap} where the last twin closes it but not to the floor
    """

    effect: str
    twin: Twin
    candidates: tuple
    confused_with: tuple
    main_group: str
    one_of: tuple = ()
    residue: dict = field(default_factory=dict)

    @property
    def rivals(self):
        """What it is confused with, [(name, parameters)] as they were fitted beside it."""
        tried = {c.effect: c.parameters for c in self.candidates}
        return [(n, tried[n]) for n in self.confused_with]


@dataclass(frozen=True)
class Outcome:
    """Where a path ended: its steps, the candidates that were left, the twin it reached and the verdict on it.

    ``share_left`` is of the first excess; ``within_budget`` says that the search ended by itself.
    """

    steps: tuple
    left: tuple
    twin: Twin
    verdict: str
    share_left: float
    within_budget: bool = True

    @property
    def is_closed(self):
        """Whether the gap itself is at the floor as it is estimated, not only most of it gone."""
        return verdict_of(self.steps, self.twin) != "unexplained"


@dataclass
class Selection:
    """A search with the sets of effects that it has had: a path that comes back to one ends.

    gains  {effect: its predicted gain as the base's first effect}
    begun  sets of many effects at once, and beside which, from which rounds began: from one they begin once
    ended  sets in which many effects at once ended: beside them no more are found so
    """

    search: Search
    budget: int
    gains: dict
    progress: object = None

    def __post_init__(self):
        self.had, self.begun, self.ended = set(), set(), set()

    def is_spent(self):
        """Return whether the budget is used up."""
        return self.search.cost > self.budget

    def is_new(self, names):
        """Return whether a set of effects was not had before, and note it."""
        key = frozenset(names)
        new = key not in self.had
        self.had.add(key)
        return new


def outcome_of(problem, steps, left, twin, before):
    """Return the Outcome of steps that led to a twin of a problem; ``before`` is the first excess {group: loss}."""
    share = sum(twin.excess.values()) / max(sum(before.values()), 1.0)
    verdict = verdict_of(steps, twin, share, problem.floor_within)
    return Outcome(tuple(steps), tuple(left), twin, verdict, share)


def without_unneeded(search, twin, kept, steps):
    """Return (Twin, steps) without the effects that the refitted twin no longer needs, but for those ``kept``: one at a
    time, that of the least evidence first.
    """
    for name in sorted(twin.names, key=lambda n: (twin.evidence.get(n, 0.0), n)):
        rest = search.without_unneeded(twin, name) if name not in kept and not search.is_fixed(name) else None
        if rest:
            return without_unneeded(search, rest, kept, [s for s in steps if s.effect != name])
    return twin, steps


def twins_on_the_way(search, base, twin, names):
    """Return the Twins from a base to a Twin, effects ``names`` of its own added one after the other with their values there."""
    sets = [{*base.names, *names[: k + 1]} for k in range(len(names) - 1)]
    return [*(_valued(search, [e for e in twin.effects if e[0] in s], twin) for s in sets), *([twin] if names else [])]


def _valued(search, effects, twin):
    """Return the Twin of some of a Twin's effects with the values that they have there."""
    poses, groups = search.solver.score(effects, twin.poses, search.test)
    return replace(twin, effects=tuple(effects), poses=poses, groups=groups, errors={}, cautious_errors={}, evidence={})


def steps_to(search, base, twin, order):
    """Return the Steps from a base to a Twin, in the order in which effects were proposed, with the Twin's own values."""
    steps, before = [], base
    names = sorted((n for n in twin.names if n not in base.names), key=[*order, *twin.names].index)
    for name, after in zip(names, twins_on_the_way(search, base, twin, names), strict=True):
        gains = {group: before.excess.get(group, 0.0) - left for group, left in after.excess.items()}
        steps.append(Step(name, after, (), (), max(gains, key=gains.get)))
        before = after
    return steps


def told_apart(step, known, alike, twin):
    """Return a Step with what its effect cannot be told from: as a Step ``known`` of the same says, or what did as well."""
    if known:
        return replace(step, candidates=known.candidates, confused_with=known.confused_with)
    alike = [e for e in alike if e[0] not in twin.names]
    tried = [Candidate(step.effect, dict(twin.effects)[step.effect], twin, True)]
    for name, p in alike:
        effects = tuple(in_place(twin.effects, step.effect, (name, p)))
        tried.append(Candidate(name, p, replace(twin, effects=effects), True))
    return replace(step, candidates=tuple(tried), confused_with=tuple(n for n, _ in alike))


def in_last_twin(search, twin, steps, before):
    """Return the Steps to a Twin with what it says of their names: which others would do as well (of a board's photographs
    gap.boards.needs computes that), and what the form of each group's first leaves. ``before`` is the first excess {group: loss}.
    """
    first, told = {step.main_group: step.effect for step in reversed(steps)}, []
    for step in steps:
        step = replace(step, confused_with=tuple(n for n in step.confused_with if n not in twin.names))
        others = [] if search.problem.is_board else step.rivals
        group, within = step.main_group, search.problem.floor_within
        residue = residue_of(twin, group, before, within) if first[group] == step.effect else {}
        alike = one_of(search, twin, step.effect, others)
        told.append(replace(step, one_of=alike, residue=residue))
    return tuple(told)


def confused_with(problem, best, candidates):
    """Return the names of candidates that the held-out stations cannot tell from the best one."""
    names = []
    for other in candidates:
        if other.effect == best.effect or other.gain < MIN_GAIN:
            continue
        ahead = gains_by_station(problem, other.twin.losses, best.twin.losses)
        if ahead.sum() < max(MIN_GAIN, min(TWICE * error_of_sum(ahead), CLOSED * abs(best.gain))):
            names.append(other.effect)
    return names
