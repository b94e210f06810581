"""Which effects explain together, to first order, what a twin leaves open: forward selection without a fit.

Beside other large effects the robust loss hides what each one is worth: one by one they come slowly, or not at all.
"""

from copy import copy
from dataclasses import dataclass, field

import numpy as np

from effects import library
from gap.bounds import CHARGE, MAX_SIMPLE, MIN_GAIN, MOST, RIVAL_SHARE
from gap.fit.evidence import start_step, step_over_rounding
from gap.fit.normal_equations import normal_equations
from gap.fit.parameters import prior_equations, spec
from gap.fit.split import probes

MAX_TOGETHER = 9  # effects that are proposed at once
MIN_SHARE_PROPOSED = 0.03  # of all that could be gained to first order, that is proposed at first
MAX_EXCHANGED = 2  # others that are fitted in an effect's place
MIN_WAY, MAX_WAY = 0.1, 1.5  # of the way to a start, that a first guess goes at least and at most


@dataclass(frozen=True)
class Way:
    """One form in which an effect may be missing, with its columns in the linear model.

    ``start`` is None where the columns are those of ``parameters`` about their nulls, else the one column goes there.
    """

    effect: str
    parameters: tuple
    start: dict | None
    columns: tuple


@dataclass(frozen=True)
class Proposal:
    """Effects [(name, first guess of the parameters)] and {name: other names of its kind with nearly the predicted gain}.

    ``along`` names those without a predicted gain alone, ``alone`` is the Proposal without them, None where there are none.
    """

    effects: list
    rivals: dict = field(default_factory=dict)
    along: tuple = ()
    alone: object = None

    @property
    def names(self):
        """The names of its effects, best first."""
        return [name for name, _ in self.effects]

    def after(self, effects):
        """Return the Proposal with others, which have no rivals, before its own."""
        alone, none = self.alone and self.alone.after(effects), {name: [] for name, _ in effects}
        return Proposal([*effects, *self.effects], none | self.rivals, self.along, alone)


class LinearModel:
    """What a twin's residuals look like in the derivatives by many effects: normal equations, poses eliminated.

    Columns are scaled to a unit diagonal. A parameter whose null is one of its bounds steps to the other side only.
    """

    def __init__(self, H, g, lower, upper, own):
        self.scale = np.sqrt(np.maximum(np.diag(H), 1e-12))
        self.H, self.g = H / np.outer(self.scale, self.scale), g / self.scale
        self.lower, self.upper, self.own = lower, upper, own

    def gain(self, columns):
        """Return the loss that some columns and the twin's own would gain."""
        return self._solved(columns)[1]

    def steps(self, columns):
        """Return {column: step of its parameter}."""
        return {k: d / self.scale[k] for k, d in self._solved(columns)[0].items()}

    def without(self, columns, steps):
        """Return (the LinearModel where some of the twin's own columns have gone by steps (k,) and stay, the loss that costs)."""
        d = np.asarray(steps) * self.scale[columns]
        rest = copy(self)
        rest.g, rest.own = self.g - self.H[:, columns] @ d, [k for k in self.own if k not in columns]
        return rest, self.gain(()) + d @ self.H[np.ix_(columns, columns)] @ d - 2 * self.g[columns] @ d - rest.gain(())

    def _solved(self, columns):
        """Return ({column: scaled step}, gain): what would leave its bounds at once is left out, the largest step first."""
        left = [*columns, *self.own]
        while left:
            d = np.linalg.solve(self.H[np.ix_(left, left)] + 1e-6 * np.eye(len(left)), self.g[left])
            out = np.array(
                [(self.lower[k] >= 0 and s < 0) or (self.upper[k] <= 0 and s > 0) for k, s in zip(left, d, strict=True)]
            )
            if not out.any():
                return dict(zip(left, d, strict=True)), float(self.g[left] @ d)
            left.pop(int(np.argmax(np.where(out, np.abs(d), -1.0))))
        return {}, 0.0


def proposed(search, twin, names):
    """Return the Proposal of those of ``names`` that explain most together of what a twin leaves open."""
    return selected(search, twin, *linear_model(search, twin, [n for n in names if n not in twin.names]))


def selected(search, twin, ways, model, least_share=MIN_SHARE_PROPOSED, share_of_first=0.0):
    """Return the Proposal of those Ways of a LinearModel about a twin that explain most together, MAX_TOGETHER at most.

    Forward selection in the derivatives of a few captures, the twin's own parameters and poses going along. What
    captures show by themselves comes first, whatever it adds; what else adds less than a share of all that could be gained, or
    of what the first one adds, is not proposed.
    """
    captures = len(search.train) / len(probes(search.train))
    possible = model.gain([k for way in ways for k in way.columns]) - model.gain(())
    least = max(MIN_GAIN / captures, least_share * possible)
    shown = [n for n in dict.fromkeys(way.effect for way in ways) if search.problem.shows(n)]
    taken = [next(way for way in ways if way.effect == n) for n in shown]
    left = [way for way in ways if way.effect not in shown]
    while left and len(taken) < MAX_TOGETHER:
        columns = [k for way in taken for k in way.columns]
        so_far = model.gain(columns)
        gains = [model.gain([*columns, *w.columns]) - so_far - CHARGE * len(w.columns) / captures for w in left]
        best = int(np.argmax(gains))
        if gains[best] < least:
            break
        least = max(least, share_of_first * gains[best])
        best = _simpler(left, gains, best)
        taken.append(left[best])
        left = [way for way in left if way.effect != taken[-1].effect]
    rivals = {way.effect: [] if way.effect in shown else _rivals(model, way, taken, left) for way in taken}
    alone = Proposal(_guesses(search, twin, taken, model), rivals)
    smooths = any(library.smooths_noise(w.effect) and not search.problem.shows(w.effect) for w in taken)
    noise = _missing_noise(twin, taken, left, model) if smooths else []
    if not noise:
        return alone
    guesses = _guesses(search, twin, [*taken, noise[0]], model)
    return Proposal(guesses, rivals | _one_of(noise), (noise[0].effect,), alone)


def missing_noise(search, twin, ways, model):
    """Return the Proposal of what adds noise, where a twin's is off and nothing in it adds any; an empty one elsewhere.

    Levels and corners scatter by it as well, no expected image changes: its predicted gain beside what these leave open is small.
    """
    noise = _missing_noise(twin, [], ways, model)
    return Proposal(_guesses(search, twin, noise[:1], model), _one_of(noise)) if noise else Proposal([])


def _one_of(ways):
    """Return {name: other names} of Ways of which the first is taken and the others are its rivals."""
    return {way.effect: sorted({w.effect for w in ways} - {way.effect}) for way in ways[:1]}


def _guesses(search, twin, taken, model):
    """Return the effects [(name, first guess of the parameters)] of Ways that are taken together."""
    steps = model.steps([k for way in taken for k in way.columns])
    return [(way.effect, _first_guess(search, twin, way, steps)) for way in taken]


def _missing_noise(twin, taken, left, model):
    """Return the Ways left of what adds noise, the largest predicted gain first, where a twin's is off and nothing adds any.

    What smooths noise hides it, however much there is: alone neither has a predicted gain.
    """
    added = any(map(library.adds_noise, [*twin.names, *(way.effect for way in taken)]))
    if added or twin.excess.get("noise", 0.0) <= MIN_GAIN:
        return []
    columns = [k for way in taken for k in way.columns]
    makers = [way for way in left if library.adds_noise(way.effect)]
    return sorted(makers, key=lambda way: -model.gain([*columns, *way.columns]))


def _simpler(ways, gains, best):
    """Return the index of the best of simpler ways that affect the same as the best one and add nearly as much; else its own."""
    if len(ways[best].columns) <= MAX_SIMPLE:
        return best
    alike = [k for k, w in enumerate(ways) if library.affects(w.effect) == library.affects(ways[best].effect)]
    simple = [k for k in alike if len(ways[k].columns) <= MAX_SIMPLE and gains[k] > RIVAL_SHARE * gains[best]]
    return max(simple, key=lambda k: gains[k], default=best)


def _rivals(model, way, taken, left):
    """Return the names of those left that affect what a taken one does, and in its place add nearly as much to the others."""
    others = [k for w in taken if w is not way for k in w.columns]
    without = model.gain(others)
    enough = RIVAL_SHARE * (model.gain([*others, *way.columns]) - without)
    alike = [w for w in left if library.affects(w.effect) == library.affects(way.effect)]
    return sorted({w.effect for w in alike if model.gain([*others, *w.columns]) - without > enough})


def exchanges(search, twin, kept, ways, model):
    """Return {effect ``kept`` of a twin: other names, by predicted gain} that may stand in its place, to second order.

    Of what taking it out costs, its parameters back at their nulls and all others refitted, one that affects the same brings
    ``MOST``; one noise is held against another in any case, as levels tell them apart by little. Ways and the
    LinearModel are about the twin, of which what is not ``kept`` goes back to its null. What only moves points corners have told
    apart.
    """
    found = {}
    for name in (n for n in twin.names if n not in kept):
        model, _ = _without_effect(search, twin, name, model)
    for name in (n for n in twin.names if n in kept):
        if (
            not search.free([(name, dict(twin.effects)[name])])
            or library.is_pure_geometry(name)
            or search.is_fixed(name)
            or search.problem.shows(name)
        ):
            continue
        rest, cost = _without_effect(search, twin, name, model)
        brings, at = {}, rest.gain(())
        for way in ways:
            if library.affects(way.effect) == library.affects(name):
                brings[way.effect] = max(brings.get(way.effect, 0.0), rest.gain(way.columns) - at)
        noises = {n for n in brings if library.adds_noise(n) and library.adds_noise(name)}
        rivals = [n for n in brings if n in noises or brings[n] > MOST * cost]
        rivals.sort(key=lambda n: (n not in noises, -brings[n], n))
        if rivals:
            found[name] = rivals[:MAX_EXCHANGED]
    return found


def _without_effect(search, twin, name, model):
    """Return ``LinearModel.without`` of an effect of the twin that the model is about, its parameters back at their nulls."""
    free, values = search.free(twin.effects), dict(twin.effects)[name]
    mine = [k for k, (effect, _) in enumerate(free) if effect == name]
    back = [spec(free[k]).null - values[free[k][1]] for k in mine]
    return model.without([len(model.g) - len(free) + k for k in mine], back)


def linear_model(search, twin, names):
    """Return (Ways of some effects, the LinearModel of them and the twin's own parameters) in a few captures."""
    (indices, groups, nu), beside = search.prepared_for(twin)
    acting = {n: tuple(k for k in library.fitted_parameters(n) if _acts_by_degrees(n, k)) for n in names}
    free = [(n, k) for n in names for k in acting[n]]
    effects = [*twin.effects, *((n, library.nulls_of(n)) for n in names)]
    is_rough = any(search.problem.shows(n) for n in twin.names)
    step = step_over_rounding if is_rough else start_step
    derivatives = search.solver.derivatives(effects, free, twin.poses, indices, step)
    ways = [Way(n, acting[n], None, tuple(i for i, f in enumerate(free) if f[0] == n)) for n in names if acting[n]]
    towards = []
    for n in names:
        starts = search.problem.starts_of(n)
        for start in starts:
            if not acting[n] or _goes_elsewhere(n, start) or len(starts) > 1:
                ways.append(Way(n, (), start, (len(free) + len(towards),)))
                towards.append(search.solver.ways(twin.effects, [*twin.effects, (n, start)], twin.poses, indices))
    own, count = search.free(twin.effects), len(free) + len(towards)
    columns = {
        i: (np.hstack([derivatives[i][0], *(t[i][0] for t in towards), beside[i]]), derivatives[i][1]) for i in indices
    }
    prior, pull = np.zeros((count + len(own),) * 2), np.zeros(count + len(own))
    for part, some in ((slice(len(free)), free), (slice(count, None), own)):
        if some:
            prior[part, part], pull[part] = prior_equations(effects, some)
    H, g, _ = normal_equations(columns, groups, nu, (prior, pull))
    lower, upper = np.full(len(g), -np.inf), np.full(len(g), np.inf)
    lower[: len(free)] = [spec(f).lower - spec(f).null for f in free]
    upper[: len(free)] = [spec(f).upper - spec(f).null for f in free]
    lower[len(free) : count] = 0.0
    return ways, LinearModel(H, g, lower, upper, range(count, len(g)))


def _acts_by_degrees(name, key):
    """Return whether a parameter does something by itself, and by degrees."""
    return not spec((name, key)).auxiliary and not spec((name, key)).discrete


def _goes_elsewhere(name, start):
    """Return whether a start moves what only says how an effect acts: where a lamp is, how far a filter reaches."""
    return any(value != spec((name, key)).null for key, value in start.items() if spec((name, key)).auxiliary)


def _first_guess(search, twin, way, steps):
    """Return the parameters from which a fit of a Way starts: as far as the linear model goes."""
    bounds = {key: spec((way.effect, key)) for key in library.nulls_of(way.effect)}
    nulls, first = library.nulls_of(way.effect), search.problem.starts_of(way.effect)[0]
    if search.problem.shows(way.effect):
        return first
    discrete = [key for key, s in bounds.items() if s.discrete and not s.auxiliary]
    if discrete:
        return search.discrete.best_values(way.effect, nulls, list(twin.effects), discrete, twin.poses)
    if way.start is None:
        moves = dict(zip(way.parameters, (steps.get(k, 0.0) for k in way.columns), strict=True))
        if not any(moves.values()):
            return first
        values = {key: nulls[key] + moves.get(key, 0.0) for key in nulls}
        values |= {key: first[key] for key, s in bounds.items() if s.auxiliary}
    else:
        share = float(np.clip(steps.get(way.columns[0], 0.0), MIN_WAY, MAX_WAY))
        values = {
            key: value if bounds[key].auxiliary else nulls[key] + share * (value - nulls[key])
            for key, value in way.start.items()
        }
    return {key: float(np.clip(value, bounds[key].lower, bounds[key].upper)) for key, value in values.items()}
