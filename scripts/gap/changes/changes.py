"""What has changed between two sets of captures by one camera: effects named one after the other, from how much to how much.

Both sets are fitted together, so that what the first leaves open is in both and drops out; then captures are permuted between
them. ``changes`` is a function of its arguments alone.
"""

from dataclasses import dataclass, replace

import numpy as np

from effects import library
from gap.boards.board import seen_by_points
from gap.boards.board_shape import offsets_of
from gap.boards.readout_motion import with_motion
from gap.bounds import CHARGE, MAX_P, MAX_TIMES_OFF, MOST, TWICE
from gap.changes.joined import joined
from gap.changes.joint_fit import JointFit, JointTwin, Slots, equations_of, moments, ridge_of
from gap.changes.permutation import MAX_DIRECTIONS, Moments, labellings, p_values
from gap.changes.power import TRIED, least_seen
from gap.fit.evidence import start_step
from gap.fit.parameters import fitted_parameters, image_step, spec
from gap.fit.residuals import flatten, rho
from gap.fit.solver import Solver
from gap.fit.split import thinned
from gap.observables import corners_in
from gap.problem import may_have
from gap.select.exchange import MAX_GROUP
from gap.select.naming import is_flexible, is_significant
from job import seed_of

MIN_CAPTURES = 5  # of each set: 252 ways to divide 5 and 5 give a p below MAX_P, fewer captures none
MAX_REFITTED = 4  # changes that are fitted to compare them
MAX_CHANGES = 6
SHAPE_ROUNDS = 2  # in which a board's shape and the twin are fitted in turn


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

    asked  {effect: Asked} at the end, p_left the least p of those that would be worth their parameters; p_other of a
    difference in scatter that no effect explains
    """

    changes: tuple
    base: JointTwin
    last: JointTwin
    asked: dict
    p_left: float
    p_other: float
    fit: JointFit

    @property
    def problem(self):
        """The joined problem, captures of both sets."""
        return self.fit.solver.problem

    def captures_of(self, number):
        """Return the indices of the captures of a set, 0 or 1, that were compared."""
        return self.fit.members[number]

    @property
    def least_seen(self):
        """{effect: as power.least_seen} of those that have not changed; a free warp has no amount."""
        names = [n for n in self.asked if not is_flexible(n)]
        return {n: least_seen(n, lambda parameters, n=n: power_to_see(n, self.asked, parameters)) for n in names}

    def residuals_of_points(self, i):
        """Return (seen (p, 2), off (p, 2)) of capture i: its points or plates' centres, and how far off the twin has them
        that holds for the first set, pixels.
        """
        effects, solver = list(self.last.effects[0]), self.fit.solver
        poses, _ = solver.score(effects, self.last.poses, [i])
        observation, predicted = self.problem.captures[i].observation, solver.predictor.predict(i, effects, poses[i])
        both = np.flatnonzero(observation.measured & predicted.measured)
        seen, there = observation.corners[both].mean(1), corners_in(predicted.features[both]).mean(1)
        return seen, seen - there

    @property
    def verdict(self):
        """``adequate``: nothing has changed; ``explained``: these effects have; ``unexplained``: something else has as well."""
        if min(self.p_left, self.p_other) <= MAX_P:
            return "unexplained"
        return "explained" if self.changes else "adequate"


def changes(before, after, effects=(), candidates=None, threads=1):
    """Return the Changes from one measured problem to another of the same camera (gap.problem.Case, board.BoardCase).

    effects     [(name, parameters)] that either has, with values to start from
    candidates  names of effects that may have changed, all where None
    Raises ValueError where a set has fewer than MIN_CAPTURES usable captures.
    """
    problem, belongs = joined(before, after)
    indices = used(problem, belongs)
    names = able_to_change(problem, candidates or list(library.available_effects()))
    fit = JointFit(Solver(problem, indices, threads), belongs, indices)
    twin = common_twin(fit, problem, effects, names)
    if outliers := outlying(fit, twin):
        fit = JointFit(fit.solver, belongs, [i for i in indices if i not in outliers])
        twin = fit.fitted(fit.twin(twin.effects, (), twin.poses))
    base_fit, twin = with_shape(fit, twin, threads)
    labels = labellings(belongs[base_fit.indices], np.random.default_rng(seed_of("labels", problem.camera)))
    found, last, asked, fit = forward(base_fit, twin, (), names, labels, threads)
    if warp := warp_in_parts(twin, found):
        alone = with_own(base_fit, twin, warp.effect)
        found, last, asked, fit = forward(
            base_fit, alone, (Change(warp.effect, alone, warp.p, ()),), names, labels, threads
        )
    p_other = p_of_scatter(last, labels)
    return Changes(tuple(found), twin, last, asked, p_of_change(asked), p_other, fit)


def forward(fit, twin, found, names, labels, threads):
    """Return ([Change], last JointTwin, {effect: Asked}, JointFit): one change named after the other, from those ``found``.

    After each a board's shape is fitted again: what had changed was in part taken for it.
    """
    found = list(found)
    while True:
        asked = ask(fit, twin, [n for n in names if n not in twin.changed], labels)
        new = named(fit, twin, asked) if len(found) < MAX_CHANGES else None
        if new is None:
            return found, twin, asked, fit
        fit, twin = with_shape(fit, new.twin, threads)
        found.append(replace(new, twin=twin))


def outlying(fit, twin):
    """Return the captures that lie off much farther than others of their set, such as ones with another board's points.

    None of a set that would have too few without them.
    """
    size = {i: np.median(np.abs(flatten(groups))) for i, groups in twin.groups.items()}
    found = []
    for members in fit.members:
        usual = np.median([size[i] for i in members])
        off = [i for i in members if size[i] > MAX_TIMES_OFF * usual]
        found += off if len(members) - len(off) >= MIN_CAPTURES else []
    return found


def warp_in_parts(base, found):
    """Return the Change of a free warp of which the changes found before it were parts, None where there is none.

    They were where they explain less than ``MOST`` of what is explained with it.
    """
    for k, change in enumerate(found):
        if is_flexible(change.effect) and k:
            share = (base.loss - found[k - 1].twin.loss) / max(base.loss - change.twin.loss, 1e-9)
            return change if share < MOST else None
    return None


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
    if problem.is_board:
        return seen_by_points(candidates)
    return [n for n in candidates if may_have(problem, n)]


def common_twin(fit, problem, effects, names):
    """Return the fitted JointTwin of all that either set has; what costs nothing, as it needs no image, is in it too."""
    shared = dict(problem.nuisances) | dict(effects)
    if not problem.draws:
        shared |= {n: library.nulls_of(n) for n in names if n not in shared and not is_flexible(n)}
    return fit.fitted(fit.start(list(shared.items())))


def with_shape(fit, twin, threads):
    """Return (JointFit, JointTwin) of a board whose points lie where both sets together show them; of a rig as they are."""
    for _ in range(0 if fit.solver.problem.draws else SHAPE_ROUNDS):
        problem = fit.solver.problem
        points = problem.points + offsets_of(problem, twin, fit.belongs, fit.indices)
        fit = JointFit(Solver(replace(problem, points=points), fit.indices, threads), fit.belongs, fit.indices)
        twin = fit.fitted(fit.twin(twin.effects, twin.changed, twin.poses))
    return fit, twin


@dataclass(frozen=True)
class Asked:
    """What a change of an effect would explain to first order: its parameters, the loss gained where photographs are still, p
    against all others, and what both come from.

    differences (Differences, ...) are of still photographs and, where motion is likely, of ones that move while they are read.
    """

    parameters: tuple
    gain: float
    p: float
    differences: tuple


def ask(fit, twin, names, labels):
    """Return {effect: Asked} of changes of some effects that a JointTwin has in common or lacks."""
    if not names:
        return {}
    free = fitted_parameters(list(twin.effects[0]))
    slots = Slots(free, twin.changed)
    columns = {n: [(n, k) for k in library.fitted_parameters(n) if not spec((n, k)).auxiliary] for n in names}
    lacking = [f for n in names if n not in twin.names for f in columns[n]]
    wider = replace(
        twin,
        effects=tuple((*e, *((n, library.nulls_of(n)) for n in names if n not in twin.names)) for e in twin.effects),
    )
    every = free + lacking

    def step(parameter, value):
        return image_step(parameter, value) if parameter[0] in twin.names else start_step(parameter, value)

    equations, nu = equations_of(fit, wider, every, step)
    moved = with_motion(fit.solver.problem, equations, nu) if fit.solver.problem.is_board else None
    parameters = slots.parameters()
    _, precision = ridge_of(parameters)
    expand = [np.zeros((len(parameters), len(every))) for _ in (0, 1)]
    for k in (0, 1):
        expand[k][slots.of[k], np.arange(len(free))] = 1
    D = np.array([np.concatenate([expand[fit.belongs[i]], np.eye(len(every))]) for i in fit.indices])
    made = []
    for H, g in (moments(of, nu) for of in (equations, moved) if of):
        made.append(Moments(D @ H @ D.transpose(0, 2, 1), np.einsum("nab,nb->na", D, g), precision))
    differences = {}
    for n in names:
        mine = np.array([every.index(f) for f in columns[n]])
        differences[n] = tuple(m.differences(mine, n not in twin.names, labels) for m in made)
    p = p_values(np.array([d.evidence for of in differences.values() for d in of])).reshape(len(names), -1).min(1)
    return {
        n: Asked(tuple(columns[n]), float(of[0].gain()[0]), float(p[k]), of)
        for k, (n, of) in enumerate(differences.items())
    }


def power_to_see(name, asked, parameters):
    """Return in which share of divisions points would tell an effect with parameters, one of {effect: Asked}."""
    nulls, own = library.nulls_of(name), asked[name].differences
    more = np.array([parameters[key] - nulls[key] for _, key in asked[name].parameters])
    beside = [d.evidence for n, a in asked.items() if n != name for d in a.differences]

    def told(k):
        changed = [d.with_more(more, k).evidence for d in own]
        return p_values(np.array([*changed, *beside]), k)[: len(own)].min() <= MAX_P

    return float(np.mean([told(k) for k in thinned(range(1, len(own[0].labels)), TRIED)]))


def named(fit, twin, asked):
    """Return the Change that explains most where not all is chance, None where it is.

    Whether something has changed the largest evidence says; what it was, the loss that is left, each parameter charged. A
    free warp gets a name where it is no chance itself, and explains more than any other by what it has more parameters.
    """
    p = p_of_change(asked)
    if p > MAX_P:
        return None
    likely = sorted(
        (n for n in asked if not is_flexible(n) or asked[n].p <= MAX_P), key=lambda n: -net_predicted_gain(asked[n])
    )
    if likely and is_flexible(likely[0]):
        likely = likely[:1]
    tried = {n: with_own(fit, twin, n) for n in likely[:MAX_REFITTED] if not is_flexible(n) or n == likely[0]}
    tried = {n: t for n, t in tried.items() if matters(n, t)}
    if not tried:
        return None
    best = min(tried, key=lambda n: tried[n].loss + charge(asked[n]))
    alike = [
        n for n in sorted(tried, key=lambda n: tried[n].loss) if n != best and explains_alike(tried[n], tried[best])
    ]
    one_of = (best, *alike)[:MAX_GROUP] if alike else ()
    return Change(best, tried[best], p, one_of)


def p_of_change(asked):
    """Return the least p of those {effect: Asked} whose predicted gain is more than their parameters cost, 1 where none does.

    Beside what has changed, sets that are fitted each by itself scatter so little that what explains nothing is no chance.
    """
    return min((a.p for a in asked.values() if net_predicted_gain(a) > 0), default=1.0)


def charge(asked):
    """Return what the parameters of a change cost in loss, as Akaike's; of a free warp's those that were looked at."""
    return CHARGE * min(len(asked.parameters), MAX_DIRECTIONS)


def net_predicted_gain(asked):
    """Return the predicted gain in loss of a change (score test), its parameters charged."""
    return asked.gain - charge(asked)


def with_own(fit, twin, name):
    """Return the JointTwin in which an effect has parameters of its own in each set, all fitted."""
    effects = [e if name in twin.names else (*e, (name, library.starts_of(name)[0])) for e in twin.effects]
    return fit.fitted(fit.twin(effects, (*twin.changed, name), twin.poses))


def matters(name, twin):
    """Return whether an effect differs between the sets by more than is worth naming."""
    before, after = (dict(e)[name] for e in twin.effects)
    nulls = library.nulls_of(name)
    return is_significant(name, {k: nulls[k] + after[k] - before[k] for k in nulls}, {})


def explains_alike(other, best):
    """Return whether a change explains the captures no worse than the best, by what they differ among captures."""
    loss = [np.array([rho(flatten(g)).sum() for g in twin.groups.values()]) for twin in (other, best)]
    ahead = loss[0] - loss[1]
    return ahead.sum() <= TWICE * np.sqrt(len(ahead)) * ahead.std(ddof=1)


def p_of_scatter(twin, labels):
    """Return the p, by permuted captures, of residuals being larger in one set than in the other."""
    size = np.array([np.log(np.mean(rho(flatten(g))) + 1e-9) for g in twin.groups.values()])
    ones = labels.mean(1, keepdims=True)
    difference = np.abs((labels / ones - (1 - labels) / (1 - ones)) @ size)
    return float((difference >= difference[0] - 1e-9).mean())
