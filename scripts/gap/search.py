"""Twins as values, and the ways from one to the next: fit, predict what an effect would gain, try it, adopt it, take it out.

Losses are sums of the robust loss over whitened residuals (gap.residuals); gaps are in units of the floor.
"""

import itertools
import math

import numpy as np

from effects import library, pipeline
from gap.normal_equations import normal_equations
from gap.parameters import fitted_parameters, image_step, is_geometric, prior_equations, spec
from gap.residuals import NU, flatten, lost_plates, rho, total, width_of
from gap.score import floors_of, group_gaps, group_losses, losses_of
from gap.solver import Solver
from gap.split import probes, split_by_station, thinned, usable
from gap.twin import Candidate, Twin

MAX_PARAMETERS = 12  # of an effect that is no free warp, and of a base that is fitted beside a candidate
MIN_GAIN = 25.0  # in loss: less is not worth a fit, nor a name
MAX_HIDDEN = 0.05  # share of the held-out plates that a candidate may lose
MAX_STARTS = 2  # that are fitted, those of the largest predicted gain, and as many that are nearest
WIDTH_OF_WHOLE_VALUES = 10.0  # robust scale at which whole values are compared
MAX_NOISE_GAP = 1.5  # gap of the noise's own observables up to which the twin's noise is like the real one
MIN_STATION_LOSS = 3.0  # a station loses that loses more than this, or than 2 % of the whole gain


class Search:
    """One problem's captures, split, and the library's effects that compete for it; what it returns are values.

    fixed  {(effect, parameter)} whose values the user wrote: never refitted, and their effects are never taken out
    """

    def __init__(self, problem, candidates=None, fixed=(), split=None, threads=1):
        self.problem = problem
        train, test = split or split_by_station(problem)
        self.train, self.test = thinned(usable(train, problem)), thinned(usable(test, problem))
        self.solver = Solver(problem, probes(self.train) + probes(self.test), threads)
        self.candidates = list(candidates or library.available_effects())
        self.fixed = frozenset(fixed)

    @property
    def cost(self):
        """How many predictions and derivatives by images were made so far."""
        return self.solver.cost

    def why_unusable(self):
        """Return a sentence that says why nothing can be diagnosed, None where it can."""
        if not self.train and not self.test:
            return "no plate of the rig could be measured in any capture (none in view, or black, or saturated)"
        if not self.train or not self.test:
            return "too few stations show plates: nothing could be held out"
        return None

    def free(self, effects):
        """Return [(effect, parameter)] of all that a fit of a list of effects may move."""
        return [f for f in fitted_parameters(effects) if f not in self.fixed]

    def is_fixed(self, name):
        """Return whether the user wrote some value of an effect."""
        return any(effect == name for effect, _ in self.fixed)

    # -- twins --------------------------------------------------------------------------------------------------------

    def fitted(self, effects, poses=None):
        """Return the Twin of some effects, all that is free fitted to the training captures from the values given."""
        poses = np.zeros((len(self.problem.captures), 6)) if poses is None else poses
        free = self.free(effects)
        offsets = [np.zeros((len(self.problem.codes.half_code), 8)) for _ in self.problem.captures]
        geometric = [f for f in free if is_geometric(f)]
        effects, poses = self.solver.fit_geometry(
            effects, geometric, poses, offsets, self.train, scale=16.0, iterations=10
        )
        return self.scored(self.solver.fit(effects, free, poses, self.train, iterations=20, scale=2.0), free)

    def scored(self, fit, free, floors=None):
        """Return the Twin of a gap.solver.Fit, its held-out poses fitted; its own floors where none are given."""
        effects = fit.state.effects
        poses, groups = self.solver.score(effects, fit.state.poses, self.test)
        if floors is None:
            _, of_train = self.solver.score(effects, poses, self.train)
            floors = self._floors(effects, poses, of_train | groups)
        errors, cautious = (dict(zip(free, e, strict=True)) for e in (fit.errors, fit.cautious_errors))
        return Twin(tuple(effects), poses, groups, floors, errors, cautious, fit.loss, fit.converged)

    def _floors(self, effects, poses, groups):
        """Return {group: floor}: what trials of a station differ by, or the twin's own captures from what it expects.

        The second is more where noise meets a codec's leaps, or where a pattern repeats that only the real sensor knows;
        it counts where the twin's noise is like the real one.
        """
        floors = floors_of(self.problem, groups)
        if group_gaps(groups, {}).get("noise", np.inf) > MAX_NOISE_GAP:
            return floors
        own = self.solver.each(lambda i: self.solver.own_scatter(i, effects, poses[i]), probes(self.train))
        scatter = group_gaps(own, {})
        return {name: max(floor, scatter.get(name, 0.0)) for name, floor in floors.items()}

    def adopt(self, candidate):
        """Return the Twin of a candidate with all its effects refitted together.

        A fit does not leap: discrete parameters of the other effects are compared once more beside the new one.
        """
        twin = self.fitted(candidate.twin.effects, candidate.twin.poses)
        compared = self._with_whole_values(twin, candidate.effect)
        if compared == twin.effects:
            return twin
        return min(twin, self.fitted(compared, twin.poses), key=lambda t: t.loss)

    def _with_whole_values(self, twin, new):
        """Return the effects, discrete parameters at their best whole values beside the others, but for the new one's."""
        effects = []
        for name, p in twin.effects:
            discrete = [k for k in library.discrete_parameters(name) if (name, k) not in self.fixed]
            if discrete and name != new:
                others = [e for e in twin.effects if e[0] != name]
                best = self._best_whole_values(name, p, others, discrete, twin.poses)
                if any(abs(best[k] - p[k]) >= 1 for k in discrete):
                    p = best
            effects.append((name, p))
        return tuple(effects)

    def without(self, twin, name):
        """Return the Twin without an effect, refitted."""
        return self.fitted([e for e in twin.effects if e[0] != name], twin.poses)

    def is_unneeded(self, twin, name):
        """Return whether the twin without an effect, refitted, is as good on the held-out captures."""
        rest = [e for e in twin.effects if e[0] != name]
        fit = self.solver.fit(rest, self.free(rest), twin.poses, self.train, iterations=6, scale=4.0)
        _, groups = self.solver.score(fit.state.effects, fit.state.poses, self.test)
        return sum(losses_of(groups).values()) < sum(twin.losses.values()) + MIN_GAIN

    # -- what an effect would gain --------------------------------------------------------------------------------------

    def predicted_gains(self, twin, names):
        """Return {effect: training loss that it could gain to first order} of some effects that the twin has not.

        About its null, the twin's own parameters going along, or towards one of its starts: a prediction for each parameter
        and start. What promises next to nothing need not be fitted.
        """
        probed = self._probed(twin.effects, twin.poses)
        beside = self._beside(twin, probed)
        return {name: self._predicted_gain(twin, name, probed, beside) for name in names if name not in twin.names}

    def _probed(self, effects, poses):
        """Return (indices of the probes, their residual groups, robust nu) of a list of effects."""
        indices = probes(self.train)
        groups = self.solver.residuals_of(effects, poses, indices)
        return indices, groups, NU * width_of(groups) ** 2

    def _beside(self, twin, probed):
        """Return the derivatives {i: (n, k)} of the probes by the twin's free parameters; None where they are none or many."""
        free = self.free(twin.effects)
        if not 0 < len(free) <= MAX_PARAMETERS:
            return None
        return {i: Jt for i, (Jt, _) in self.solver.derivatives(twin.effects, free, twin.poses, probed[0]).items()}

    def _predicted_gain(self, twin, effect, probed, beside):
        indices, groups, nu = probed
        free = [(effect, k) for k in library.fitted_parameters(effect)]
        effects = [*twin.effects, (effect, library.nulls_of(effect))]
        derivatives = self.solver.derivatives(effects, free, twin.poses, indices, start_step)
        if beside is None:
            gain = first_order_gain(effects, free, derivatives, groups, nu)
        else:
            own = self.free(twin.effects)
            alone = {i: (beside[i], Jp) for i, (_, Jp) in derivatives.items()}
            together = {i: (np.hstack([Jt, beside[i]]), Jp) for i, (Jt, Jp) in derivatives.items()}
            gain = first_order_gain(effects, free + own, together, groups, nu)
            gain -= first_order_gain(effects, own, alone, groups, nu)
        starts = library.starts_of(effect)
        towards, _ = self._gains_of_starts(twin, effect, starts, probed) if len(starts) > 1 else ([], [])
        return max([gain * len(self.train) / max(len(indices), 1), *towards])

    def _gains_of_starts(self, twin, effect, starts, probed):
        """Return for each of an effect's starts what going some of the way there gains, and the loss of the start itself.

        The first sees a highlight from afar, the second what a start comes near to though the way there is crooked.
        """
        indices, groups, nu = probed
        gains, losses = [], []
        for start in starts:
            ways = self.solver.ways(twin.effects, [*twin.effects, (effect, start)], twin.poses, indices)
            H, g, _ = normal_equations(ways, groups, nu, (np.zeros((1, 1)), np.zeros(1)))
            gains.append(float(max(g[0], 0.0) ** 2 / max(H[0, 0], 1e-12)) * len(self.train) / len(indices))
            losses.append(sum(rho(flatten(groups[i]) - ways[i][0][:, 0], nu).sum() for i in indices))
        return gains, losses

    # -- trying one -----------------------------------------------------------------------------------------------------

    def null_candidate(self, twin, effect):
        """Return the Candidate of an effect that promises nothing: at its null, with the base's gap."""
        return Candidate(effect, library.nulls_of(effect), twin, twin.floors, False)

    def try_effect(self, twin, effect, beside=()):
        """Return the Candidate of one effect added to a twin and fitted, parameters ``beside`` it refitted."""
        free = [(effect, k) for k in library.fitted_parameters(effect)]
        base = list(twin.effects)
        starts = self._likely_starts(twin, effect)
        start_effects = [*base, (effect, starts[0])]
        if len(starts) > 1:
            probe = probes(self.train)
            fits = [
                self.solver.fit([*base, (effect, s)], free, twin.poses, probe, iterations=2, scale=8.0) for s in starts
            ]
            start_effects = min(fits, key=lambda f: f.loss).state.effects
        free += beside
        fit = self.solver.fit(start_effects, free, twin.poses, self.train, iterations=9, scale=8.0)
        chosen = self._with_choices(effect, fit.state)
        if chosen != fit.state.effects:
            other = self.solver.fit(chosen, free, fit.state.poses, self.train, iterations=9, scale=8.0)
            fit = min(fit, other, key=lambda f: f.loss)
        return self._candidate(twin, effect, self.scored(fit, free, twin.floors))

    def _likely_starts(self, twin, effect):
        """Return those of an effect's starts that are worth a short fit."""
        discrete = [k for k in library.discrete_parameters(effect) if not spec((effect, k)).is_choice]
        if discrete:
            return [self._best_whole_values(effect, library.nulls_of(effect), list(twin.effects), discrete, twin.poses)]
        starts = library.starts_of(effect)
        if len(starts) <= MAX_STARTS:
            return starts
        gains, losses = self._gains_of_starts(twin, effect, starts, self._probed(twin.effects, twin.poses))
        chosen = {*np.argsort(gains)[-MAX_STARTS:], *np.argsort(losses)[:MAX_STARTS]}
        return [starts[k] for k in sorted(chosen)]

    def _with_choices(self, effect, state):
        """Return the effects of a fitted State, one of them with the best values of what no fit moves."""
        names = [k for k in library.discrete_parameters(effect) if spec((effect, k)).is_choice]
        others = [e for e in state.effects if e[0] != effect]
        known = dict(state.effects)[effect]
        best = self._best_whole_values(effect, known, others, names, state.poses) if names else known
        return [(n, best if n == effect else p) for n, p in state.effects]

    def _best_whole_values(self, effect, known, others, names, poses):
        """Return ``known`` parameters of an effect with the best whole values of its discrete ones ``names``.

        ``others`` are the effects beside it. Values that make no other image, such as a place in an order that no other
        effect minds, are not compared.
        """
        i, images = self.train[0], {}
        for values in itertools.product(*(whole_values((effect, name)) for name in names)):
            parameters = known | dict(zip(names, values, strict=True))
            images.setdefault(pipeline.key_of([*others, (effect, parameters)]), []).append(parameters)
        different = [known if known in alike else alike[0] for alike in images.values()]

        def loss(parameters):
            groups = self.solver.residuals(i, [*others, (effect, parameters)], poses[i])
            return total({i: groups}, NU * WIDTH_OF_WHOLE_VALUES**2)

        return min(different, key=loss) if len(different) > 1 else different[0]

    def _candidate(self, base, effect, twin):
        values = dict(twin.effects)[effect]
        if self._hides_plates(base, twin):
            return Candidate(effect, values, twin, base.floors, True)
        gains = gains_by_station(self.problem, base.losses, twin.losses)
        before, after = group_losses(base.groups), group_losses(twin.groups)
        return Candidate(
            effect, values, twin, base.floors, True,
            gain=float(gains.sum()),
            gain_se=float(np.sqrt(len(gains)) * gains.std(ddof=1)) if len(gains) > 1 else float("nan"),
            stations_gaining=float((gains > -MIN_STATION_LOSS - 0.02 * gains.sum()).mean()) if len(gains) else 0.0,
            is_significant=is_significant(effect, values, twin.cautious_errors),
            group_gains={name: before[name] - after[name] for name in before},
        )  # fmt: skip

    def _hides_plates(self, base, twin):
        """Return whether a twin shows fewer plates than the base: one that is lost costs less than one that is far off."""
        plates = sum(len(g["corners"]) for g in twin.groups.values())
        return lost_plates(twin.groups) - lost_plates(base.groups) > MAX_HIDDEN * plates


def start_step(parameter, value):
    """Return the step from the null to the farthest start: an even parameter has no slope at its null."""
    effect, key = parameter
    steps = [start[key] - value for start in library.starts_of(effect) if start[key] != value]
    return max(steps, key=abs) if steps else image_step(parameter, value)


def whole_values(parameter):
    """Return the whole values of (effect, parameter) within its bounds."""
    bounds = spec(parameter)
    return [float(value) for value in range(math.ceil(bounds.lower), math.floor(bounds.upper) + 1)]


def first_order_gain(effects, free, derivatives, groups, nu):
    """Return the loss that a Gauss-Newton step of the free parameters would gain: a score test's statistic."""
    H, g, _ = normal_equations(derivatives, groups, nu, prior_equations(effects, free))
    scale = np.sqrt(np.maximum(np.diag(H), 1e-12))
    g, H = g / scale, H / np.outer(scale, scale)
    return float(g @ np.linalg.lstsq(H + 1e-6 * np.eye(len(g)), g, rcond=None)[0])


def gains_by_station(problem, before, after):
    """Return the gain in loss of each held-out station (s,)."""
    stations = {}
    for i in before:
        name = problem.captures[i].view.station
        stations[name] = stations.get(name, 0.0) + before[i] - after[i]
    return np.array([stations[s] for s in sorted(stations)])


def is_significant(effect, values, errors):
    """Return whether some parameter is farther from its null than is worth naming and than three standard errors.

    ``errors`` {(effect, parameter): standard error}; what was not fitted has none. One that only says how another acts tells
    nothing. Of many waves, which stand in for one another, none need be certain by itself: together they must be worth naming,
    and what they gain on captures that no fit saw says how certain they are.
    """
    acting = {k: p for k, p in library.parameters_of(effect).items() if not p.auxiliary}
    if len(acting) > MAX_PARAMETERS:
        return math.hypot(*((values[k] - p.null) / p.matters for k, p in acting.items())) > 1
    return any(abs(values[k] - p.null) > max(p.matters, 3 * errors.get((effect, k), 0.0)) for k, p in acting.items())


def rank(candidates):
    """Return candidates, best held-out loss first, each parameter charged."""
    return sorted(candidates, key=lambda c: (-(c.gain - 2 * len(c.parameters)), c.effect))
