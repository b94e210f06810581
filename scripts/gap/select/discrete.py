"""Discrete parameters: an image changes discontinuously with them, so whole values are compared (grid search), not fitted."""

import itertools
import math

from effects import library, pipeline
from gap.fit.parameters import fitted_parameters, is_geometric, spec
from gap.fit.residuals import NU, total
from gap.fit.split import probes

WIDTH_OF_WHOLE_VALUES = 10.0  # robust scale at which whole values are compared
MANY_WHOLE_VALUES, WHOLE_STRIDE = 20, 4  # of more values every fourth is compared at first, and then all
BEST_WHOLE_VALUES = 3  # about so many of the best
ITERATIONS_OF_CHOICES = 4  # of fits that compare choices, in a few captures


class Discrete:
    """Compares whole values by a Solver, in some of the captures ``train``; parameters stay that ``is_given`` says of."""

    def __init__(self, solver, train, is_given):
        self.solver, self.train, self.is_given = solver, train, is_given

    def compared_once_more(self, effects, new, poses):
        """Return fitted effects, discrete parameters at their best whole values beside the others, but for the new one's."""
        effects = list(effects)
        for k, (name, p) in enumerate(effects):
            if name == new:
                continue
            discrete = [d for d in library.discrete_parameters(name) if not self.is_given((name, d))]
            choices = [d for d in discrete if spec((name, d)).is_choice]
            numbers = [d for d in discrete if d not in choices]
            if numbers:
                best = self.best_values(name, p, effects[:k] + effects[k + 1 :], numbers, poses)
                if any(abs(best[d] - p[d]) >= 1 for d in numbers):
                    effects[k] = name, best
            if choices and self._matters_beside(effects, k, new, choices):
                effects[k] = name, self._best_choices(effects, k, new, choices, poses)
        return tuple(effects)

    def _matters_beside(self, effects, k, new, names):
        """Return whether a new effect tells ways apart that the k-th effect's choices ``names`` had alike before."""
        without = [e for e in effects if e[0] != new]
        return len(ways_of(effects, k, names)) > len(ways_of(without, without.index(effects[k]), names))

    def _best_choices(self, effects, k, new, names, poses):
        """Return the parameters of the k-th effect with its best choices ``names``: each fitted in a few captures with the new
        effect, as what was found beside another choice makes up for it.
        """
        name, known = effects[k]
        free = [
            f
            for f in fitted_parameters(effects)
            if f[0] in (name, new) and not self.is_given(f) and not is_geometric(f)
        ]

        def loss(p):
            others = [*effects[:k], (name, p), *effects[k + 1 :]]
            return self.solver.approach(others, free, poses, probes(self.train), ITERATIONS_OF_CHOICES).loss

        return min(ways_of(effects, k, names).values(), key=loss)

    def with_choices(self, effect, state):
        """Return the effects of a fitted State, one of them with the best values of what no fit moves."""
        names = [k for k in library.discrete_parameters(effect) if spec((effect, k)).is_choice]
        others = [e for e in state.effects if e[0] != effect]
        known = dict(state.effects)[effect]
        best = self.best_values(effect, known, others, names, state.poses) if names else known
        return [(n, best if n == effect else p) for n, p in state.effects]

    def best_values(self, effect, known, others, names, poses):
        """Return ``known`` parameters of an effect with the best whole values of its discrete ones ``names``.

        ``others`` are the effects beside it. Of many values every few are compared, then all about the best ones. Values that
        make no other image, such as a place in an order that no other effect minds, are not compared.
        """
        i, losses = self.train[0], {}
        start = [*others, (effect, known)]

        def with_values(values):
            return [*others, (effect, known | dict(zip(names, values, strict=True)))]

        def loss(values):
            effects = with_values(values)
            key = pipeline.key_of(effects)
            if key not in losses:
                groups = self.solver.residuals_towards(i, start, effects, poses[i])
                losses[key] = total({i: groups}, NU * WIDTH_OF_WHOLE_VALUES**2)
            return losses[key]

        at = tuple(known[name] for name in names)
        tried = {at, *itertools.product(*(few(whole_values((effect, name))) for name in names))}
        if len({pipeline.key_of(with_values(values)) for values in tried}) == 1:
            return known
        for values in sorted(tried, key=loss)[:BEST_WHOLE_VALUES]:
            tried |= set(itertools.product(*(near(v, (effect, n)) for v, n in zip(values, names, strict=True))))
        best = min(sorted(tried, key=lambda values: (values != at, values)), key=loss)
        return known | dict(zip(names, best, strict=True))


def ways_of(effects, k, names):
    """Return {image key: parameters} of the k-th effect with all choices ``names`` that make other images, its own first."""
    name, known = effects[k]
    ways = {pipeline.key_of(effects): known}
    for values in itertools.product(*(whole_values((name, choice)) for choice in names)):
        p = known | dict(zip(names, values, strict=True))
        ways.setdefault(pipeline.key_of([*effects[:k], (name, p), *effects[k + 1 :]]), p)
    return ways


def whole_values(parameter):
    """Return the whole values of (effect, parameter) within its bounds."""
    bounds = spec(parameter)
    return [float(value) for value in range(math.ceil(bounds.lower), math.floor(bounds.upper) + 1)]


def few(values):
    """Return every few of many whole values, all of a few."""
    return values if len(values) <= MANY_WHOLE_VALUES else values[::WHOLE_STRIDE]


def near(value, parameter):
    """Return the whole values of (effect, parameter) that lie nearer to one than the next that ``few`` leaves."""
    return [v for v in whole_values(parameter) if abs(v - value) < WHOLE_STRIDE]
