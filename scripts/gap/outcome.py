"""Where a search stands: the sets of effects that it has had, its steps, and the outcome of a way through it."""

from dataclasses import dataclass

from gap.search import Search
from gap.standing import verdict_of
from gap.twin import Twin


@dataclass(frozen=True)
class Step:
    """One step: the effect that was added, the refitted twin, and what else was tried."""

    effect: str
    twin: Twin
    candidates: tuple
    confused_with: tuple
    main_group: str


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

    gains  {effect: what it promised as the base's first effect}
    """

    search: Search
    budget: int
    gains: dict
    progress: object = None

    def __post_init__(self):
        self.had = set()

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
