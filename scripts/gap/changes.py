"""What has changed between two sets of captures by one camera: effects named one after the other, from how much to how much.

Both sets are fitted together, so that what the first leaves open is in both and drops out; then captures are permuted between
them. ``changes`` is a function of its arguments alone.
"""

from dataclasses import dataclass, replace

import numpy as np

from effects import library
from gap.board import seen_by_points
from gap.evidence import start_step
from gap.joined import joined
from gap.joint_fit import JointFit, JointTwin, Slots, moments, ridge_of
from gap.parameters import fitted_parameters, image_step, spec
from gap.permutation import Moments, labellings, p_values
from gap.residuals import NU, flatten, rho
from gap.search import MAX_PARAMETERS
from gap.solver import Solver
from gap.split import thinned
from job import seed_of

MIN_CAPTURES = (
    5  # of each set: of 252 ways to divide 5 and 5, the given one is then the most telling by chance in 0.4 %
)
MAX_P = 0.01
MAX_REFITTED = 4  # changes that are fitted to compare them
MAX_CHANGES = 6
MAX_GROUP = 3  # effects that may stand for one another
EXCHANGE_ERRORS = 2.0  # standard errors over captures up to which two changes explain alike


@dataclass(frozen=True)
class Change:
    """An effect that is another in the second set: the JointTwin with it, p of the permutations, what cannot be told from it."""

    effect: str
    twin: JointTwin
    p: float
    one_of: tuple


@dataclass(frozen=True)
class Changes:
    """What came of a comparison: the changes in the order found, the twin before any, and what is left.

    asked  {effect: (p, gain)} at the end; p_other of a difference in scatter that no effect explains
    """

    changes: tuple
    base: JointTwin
    last: JointTwin
    asked: dict
    p_other: float
    problem: object
    belongs: np.ndarray
    captures: tuple

    @property
    def verdict(self):
        """``adequate``: nothing has changed; ``explained``: these effects have; ``unexplained``: something else has as well."""
        if self.p_other <= MAX_P:
            return "unexplained"
        return "explained" if self.changes else "adequate"


def changes(before, after, effects=(), candidates=None, threads=1):
    """Return the Changes from one measured problem to another of the same camera (gap.problem.Case, gap.board.BoardCase).

    effects     [(name, parameters)] that either has, with values to start from
    candidates  names of effects that may have changed, all where None
    Raises ValueError where a set has fewer than MIN_CAPTURES usable captures.
    """
    problem, belongs = joined(before, after)
    indices = used(problem, belongs)
    solver = Solver(problem, indices, threads)
    fit = JointFit(solver, belongs, indices)
    names = able_to_change(problem, candidates or list(library.available_effects()))
    twin = common_twin(fit, problem, effects, names)
    base, found, labels = (
        twin,
        [],
        labellings(belongs[indices], np.random.default_rng(seed_of("labels", problem.camera))),
    )
    while True:
        asked = ask(fit, twin, [n for n in names if n not in twin.changed], labels)
        new = named(fit, twin, asked, belongs) if len(found) < MAX_CHANGES else None
        if new is None:
            break
        found.append(new)
        twin = new.twin
    p_other = p_of_scatter(twin, belongs, labels)
    asked = {n: (a.p, a.gain) for n, a in asked.items()}
    return Changes(tuple(found), base, twin, asked, p_other, problem, belongs, tuple(indices))


def used(problem, belongs):
    """Return the indices of the captures that are compared; raises ValueError where a set has too few."""
    sets = [np.flatnonzero(belongs == k) for k in (0, 1)]
    if min(map(len, sets)) < MIN_CAPTURES:
        raise ValueError(
            f"{len(sets[0])} usable captures before and {len(sets[1])} after; {MIN_CAPTURES} of each are needed"
        )
    return [int(i) for members in sets for i in thinned(members, 2 * problem.most_captures)]


def able_to_change(problem, candidates):
    """Return those of some effects whose change a problem's captures can show."""
    return list(candidates) if problem.draws else seen_by_points(candidates)


def is_flexible(name):
    """Return whether an effect is a free warp, that can mimic anything of its kind."""
    return len(library.parameters_of(name)) > MAX_PARAMETERS


def common_twin(fit, problem, effects, names):
    """Return the fitted JointTwin of all that either set has; what costs nothing, as it needs no image, is in it too."""
    shared = dict(problem.nuisances) | dict(effects)
    if not problem.draws:
        shared |= {n: library.nulls_of(n) for n in names if n not in shared and not is_flexible(n)}
    twin = fit.start(list(shared.items()))
    return fit.fitted(twin, fitted_parameters(list(shared.items())))


@dataclass(frozen=True)
class Asked:
    """What a change of an effect would explain to first order: by how much (k,), the loss gained, p against all others."""

    parameters: tuple
    delta: np.ndarray
    gain: float
    p: float


def ask(fit, twin, names, labels):
    """Return {effect: Asked} of changes of some effects that a JointTwin has in common or lacks."""
    free = fitted_parameters(list(twin.effects[0]))
    slots = Slots(free, twin.changed)
    columns = {n: [(n, k) for k in library.fitted_parameters(n) if not spec((n, k)).auxiliary] for n in names}
    lacking = [f for n in names if n not in twin.names for f in columns[n]]
    wider = replace(
        twin,
        effects=tuple((*e, *((n, library.nulls_of(n)) for n in names if n not in twin.names)) for e in twin.effects),
    )
    every = free + lacking
    H, g = moments(fit, wider, every, start_step_of(twin.names))
    parameters = slots.parameters()
    _, precision = ridge_of(parameters)
    expand = [np.zeros((len(parameters), len(every))) for _ in (0, 1)]
    for k in (0, 1):
        expand[k][slots.of[k], np.arange(len(free))] = 1
    D = np.array([np.concatenate([expand[fit.belongs[i]], np.eye(len(every))]) for i in fit.indices])
    made = Moments(D @ np.array(H) @ D.transpose(0, 2, 1), np.einsum("nab,nb->na", D, np.array(g)), precision)
    found, evidence = {}, []
    for n in names:
        mine = np.array([every.index(f) for f in columns[n]])
        own = np.zeros((len(fit.indices), 0)) if n in twin.names else np.ones((len(fit.indices), 1))
        delta, gain, e = made.asked(mine, own, labels)
        evidence.append(e)
        found[n] = Asked(tuple(columns[n]), delta[0], float(gain[0]), np.nan)
    return with_p(found, np.array(evidence))


def with_p(found, evidence):
    """Return {effect: Asked} with their p; free warps are compared among themselves, as they are named last."""
    names, out = list(found), {}
    for flexible in (False, True):
        some = [k for k, n in enumerate(names) if is_flexible(n) == flexible]
        if some:
            p = p_values(evidence[some])
            out |= {names[k]: replace(found[names[k]], p=float(p[q])) for q, k in enumerate(some)}
    return out


def start_step_of(has):
    """Return the steps of derivatives by images: towards a start where a twin lacks the effect."""

    def step(parameter, value):
        return image_step(parameter, value) if parameter[0] in has else start_step(parameter, value)

    return step


def named(fit, twin, asked, belongs):
    """Return the Change that explains most of those that are no chance, None where there is none."""
    likely = [n for n, a in asked.items() if a.p <= MAX_P]
    likely = [n for n in likely if not is_flexible(n)] or likely
    likely = sorted(likely, key=lambda n: -asked[n].gain)[:MAX_REFITTED]
    tried = {n: with_own(fit, twin, n) for n in likely}
    tried = {n: t for n, t in tried.items() if matters(n, t)}
    if not tried:
        return None
    best = min(tried, key=lambda n: tried[n].loss + 2 * len(asked[n].parameters))
    alike = [
        n for n in sorted(tried, key=lambda n: tried[n].loss) if n != best and explains_alike(tried[n], tried[best])
    ]
    one_of = (best, *alike)[:MAX_GROUP] if alike else ()
    return Change(best, tried[best], asked[best].p, one_of)


def with_own(fit, twin, name):
    """Return the JointTwin in which an effect has parameters of its own in each set, all fitted."""
    effects = [e if name in twin.names else (*e, (name, library.starts_of(name)[0])) for e in twin.effects]
    start = fit.twin(effects, (*twin.changed, name), twin.poses)
    return fit.fitted(start, fitted_parameters(list(start.effects[0])))


def matters(name, twin):
    """Return whether some parameter of an effect differs between the sets by more than is worth naming and three errors."""
    before, after = (dict(e)[name] for e in twin.effects)
    for key, p in library.parameters_of(name).items():
        error = np.hypot(*(errors.get((name, key), 0.0) for errors in twin.errors))
        if not p.auxiliary and abs(after[key] - before[key]) > max(p.matters, 3 * error):
            return True
    return False


def explains_alike(other, best):
    """Return whether a change explains the captures no worse than the best, by what they differ among captures."""
    loss = [np.array([rho(flatten(g)).sum() for g in twin.groups.values()]) for twin in (other, best)]
    ahead = loss[0] - loss[1]
    return ahead.sum() <= EXCHANGE_ERRORS * np.sqrt(len(ahead)) * ahead.std(ddof=1)


def p_of_scatter(twin, belongs, labels):
    """Return the p, by permuted captures, of residuals being larger in one set than in the other."""
    size = np.array([np.log(np.mean(rho(flatten(g), NU)) + 1e-9) for g in twin.groups.values()])
    ones = labels.mean(1, keepdims=True)
    difference = np.abs((labels / ones - (1 - labels) / (1 - ones)) @ size)
    return float((difference >= difference[0] - 1e-9).mean())
