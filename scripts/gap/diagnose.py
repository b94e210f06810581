"""Which effects could be missing: each candidate is added to the base twin, fitted, and scored on held-out captures.

Losses are sums of the robust loss over whitened residuals (gap.fit); gaps are in units of the floor.
"""

import itertools
import math
from dataclasses import dataclass, field

import numpy as np

from effects import library, pipeline
from gap.fit import (
    NU,
    Fitter,
    State,
    flatten,
    image_step,
    is_geometric,
    lost_plates,
    prior_equations,
    spec,
    total,
    width_of,
)
from gap.floors import excess_of, floors_of, gap_error, group_gaps, group_losses, losses_of, overall_gap
from gap.split import probes, split_by_station, thinned, usable

TRIED = 6  # candidates that are fitted, the most promising; others stay at their null
TRIED_AGAIN = 4  # the same in later steps of a climb
LEAST_LOSS = 3.0  # a station loses that loses more than this, or than 2 % of the whole gain
LEAST_GAIN = 25.0  # and the least gain in loss that is worth a name
MANY_PARAMETERS = 12
LEAST_PROMISE = LEAST_GAIN  # first-order gain in training loss below which an effect is not fitted
MOST_HIDDEN = 0.05  # share of the held-out plates that a candidate may lose
MOST_STARTS = 2  # that are fitted, the most promising, and as many that are nearest
LEAPING_WIDTH = 10.0  # robust scale at which whole values are compared
LONGEST_WAY = 1e4  # whitened residual beyond which a start says no more
SHARE_OF_BEST = 0.01  # of the best promise: less is not fitted in this step either
LIKE_NOISE = 1.5  # gap of the noise's own observables up to which the twin's noise is like the real one
RECORDED = (
    "effect", "parameters", "errors", "losses", "gap", "gap_se", "groups", "floors", "converged", "gain", "gain_se",
    "stations_gaining", "matters", "group_gains",
)  # fmt: skip


@dataclass
class Candidate:
    """The outcome of one candidate: fitted parameters with standard errors, held-out losses per capture.

    ``gap`` and ``groups`` are in units of ``floors``, the base's.
    """

    effect: str
    parameters: dict
    errors: dict
    losses: dict
    gap: float
    gap_se: float
    groups: dict
    floors: dict
    converged: bool
    gain: float = 0.0
    gain_se: float = 0.0
    stations_gaining: float = 0.0
    matters: bool = False
    group_gains: dict = field(default_factory=dict)
    state: State = field(default=None, repr=False)

    def gap_in(self, floors):
        """Return the gap in units of other floors than those of the base it was tried on."""
        gaps = [gap * self.floors.get(g, 1.0) / floors.get(g, 1.0) for g, gap in self.groups.items()]
        return float(np.sqrt(np.mean(np.square(gaps))))

    def as_record(self):
        """Return plain data of the outcome, poses included; ``from_record`` takes it back."""
        record = {k: getattr(self, k) for k in RECORDED}
        record["errors"] = {k: float(v) for k, v in self.errors.items()}
        record["losses"] = {str(i): v for i, v in self.losses.items()}
        if self.state is not None:
            record["effects"] = [[n, p] for n, p in self.state.effects]
            record["poses"] = self.state.poses.tolist()
        return record

    @classmethod
    def from_record(cls, record):
        """Return the Candidate of plain data."""
        values = {k: record[k] for k in RECORDED}
        values["losses"] = {int(i): v for i, v in record["losses"].items()}
        for key in ("gap_se", "gain_se"):
            values[key] = float("nan") if values[key] is None else values[key]
        state = None
        if "effects" in record:
            state = State([(n, p) for n, p in record["effects"]], np.array(record["poses"]), [])
        return cls(**values, state=state)


def fitted(effects):
    """Return [(effect, parameter)] of all that a fit of a list of effects may move."""
    return [(n, k) for n, p in effects for k in p if not spec((n, k)).is_choice]


def start_step(parameter, value):
    """Return the step from the null to the farthest start: an even parameter has no slope at its null."""
    effect, key = parameter
    steps = [start[key] - value for start in library.starts_of(effect) if start[key] != value]
    return max(steps, key=abs) if steps else image_step(parameter, value)


class Diagnosis:
    """The climb of one camera: a base twin (effects and poses) that grows by the best candidate."""

    def __init__(self, case, candidates=None, split=None):
        self.case = case
        train, test = split or split_by_station(case)
        self.train, self.test = thinned(usable(train, case)), thinned(usable(test, case))
        self.fitter = Fitter(case, probes(self.train) + probes(self.test))
        self.candidates = list(candidates or library.available_effects())
        self.effects = []
        self.fixed = set()  # effects whose parameters the user fixed: never refitted, never dropped
        self.poses = np.zeros((len(case.captures), 6))

    def set_base(self, effects, free=()):
        """Take a list of effects as the base twin; fit its free parameters and the poses on the training captures."""
        self.effects = [(n, dict(p)) for n, p in effects]
        offsets = [np.zeros((len(self.case.codes.half_code), 8)) for _ in self.case.captures]
        geometric = [f for f in free if is_geometric(f)]
        self.effects, self.poses = self.fitter.fit_geometry(
            self.effects, geometric, self.poses, offsets, self.train, scale=16.0, iterations=10
        )
        fit = self.fitter.fit(self.effects, list(free), self.poses, self.train, iterations=20, scale=2.0)
        self.effects, self.poses = fit.state.effects, fit.state.poses
        self._score_base()
        return fit

    def rebase(self, effects, poses):
        """Take up a base that was fitted before."""
        self.effects, self.poses = effects, poses
        self._score_base()

    def _score_base(self):
        self.poses, self.base_groups = self.fitter.score(self.effects, self.poses, self.test)
        _, train_groups = self.fitter.score(self.effects, self.poses, self.train)
        self.floors = self._floors(train_groups | self.base_groups)
        self.base_losses = losses_of(self.base_groups)
        self.excess = excess_of(self.base_groups, self.floors)
        self.base_gap = overall_gap(self.base_groups, self.floors)
        self.base_gap_se = gap_error(self.base_groups, self.floors)

    def _floors(self, groups):
        """Return {group: floor}: what trials of a station differ by, or the twin's own captures from what it expects.

        The second is more where noise meets a codec's leaps, or where a pattern repeats that only the real sensor knows;
        it counts where the twin's noise is like the real one.
        """
        floors = floors_of(self.case, groups)
        if group_gaps(groups, {}).get("noise", np.inf) > LIKE_NOISE:
            return floors
        own = {i: self.fitter.own_scatter(i, self.effects, self.poses[i]) for i in probes(self.train)}
        scatter = group_gaps(own, {})
        return {name: max(floor, scatter.get(name, 0.0)) for name, floor in floors.items()}

    def is_usable(self):
        """Return whether there is enough to fit and to hold out."""
        return self.why_unusable() is None

    def why_unusable(self):
        """Return a sentence that says why nothing can be diagnosed, None where it can."""
        if not self.train and not self.test:
            return "no plate of the rig could be measured in any capture (none in view, or black, or saturated)"
        if not self.train or not self.test:
            return "too few stations show plates: nothing could be held out"
        return None

    def restore(self, record):
        """Take up the base that an earlier job fitted: effects, poses, and which effects the user fixed."""
        self.fixed = {n for n, _ in record["effects"]} - {key.split(".")[0] for key in record["errors"]}
        self.rebase([(n, p) for n, p in record["effects"]], np.array(record["poses"]))

    def promise(self, effect, beside=None):
        """Return the training loss that an effect could gain, to first order: about its null, or towards a start.

        Cheap (a prediction for each parameter and start); what promises next to nothing is not fitted. ``beside`` are the
        derivatives {i: (n, k)} by the base's free parameters, which then go along: they may have made up for the effect.
        """
        free = [(effect, k) for k in library.fitted_parameters(effect)]
        effects = self.effects + [(effect, library.nulls_of(effect))]
        indices, groups, nu = self._probed(effects)
        derivatives = self.fitter.derivatives(effects, free, self.poses, groups, indices, start_step)
        if beside is None:
            gain = self._first_order_gain(effects, free, derivatives, groups, nu)
        else:
            alone = {i: (beside[i], Jp) for i, (_, Jp) in derivatives.items()}
            together = {i: (np.hstack([Jt, beside[i]]), Jp) for i, (Jt, Jp) in derivatives.items()}
            gain = self._first_order_gain(effects, free + self.free(), together, groups, nu)
            gain -= self._first_order_gain(effects, self.free(), alone, groups, nu)
        starts = library.starts_of(effect)
        towards, _ = self.start_promises(effect, starts) if len(starts) > 1 else ([], [])
        return max([gain * len(self.train) / max(len(indices), 1), *towards])

    def _first_order_gain(self, effects, free, derivatives, groups, nu):
        """Return the loss that a Gauss-Newton step of the free parameters would gain."""
        H, g, _ = self.fitter.normal_equations(derivatives, groups, nu, prior_equations(effects, free))
        scale = np.sqrt(np.maximum(np.diag(H), 1e-12))
        g, H = g / scale, H / np.outer(scale, scale)
        return float(g @ np.linalg.lstsq(H + 1e-6 * np.eye(len(g)), g, rcond=None)[0])

    def _beside(self):
        """Return the derivatives {i: (n, k)} of the probes by the base's free parameters; None where they are none or many."""
        if not 0 < len(self.free()) <= MANY_PARAMETERS:
            return None
        indices, groups, _ = self._probed(self.effects)
        derivatives = self.fitter.derivatives(self.effects, self.free(), self.poses, groups, indices)
        return {i: Jt for i, (Jt, _) in derivatives.items()}

    def start_promises(self, effect, starts):
        """Return for each of an effect's starts what going some of the way there gains, and the loss of the start itself.

        The first sees a highlight from afar, the second what a start comes near to though the way there is crooked.
        """
        nulls = self.effects + [(effect, library.nulls_of(effect))]
        indices, groups, nu = self._probed(nulls)
        by_pose = {i: self.fitter.pose_columns(i, nulls, self.poses[i], groups[i]) for i in indices}
        gains, losses = [], []
        for start in starts:
            effects = self.effects + [(effect, start)]
            there = {i: self.fitter.residuals_at(i, effects, self.poses[i]) for i in indices}
            ways = {i: np.clip(flatten(groups[i]) - flatten(there[i]), -LONGEST_WAY, LONGEST_WAY) for i in indices}
            derivatives = {i: (ways[i][:, None], by_pose[i]) for i in indices}
            H, g, _ = self.fitter.normal_equations(derivatives, groups, nu, (np.zeros((1, 1)), np.zeros(1)))
            gains.append(float(max(g[0], 0.0) ** 2 / max(H[0, 0], 1e-12)) * len(self.train) / len(indices))
            losses.append(total(there, nu))
        return gains, losses

    def best_leap(self, effect, known, others, names, poses):
        """Return ``known`` parameters of an effect with the best whole values of its discrete ones ``names``.

        ``others`` are the effects beside it. Values that make no other image, such as a place in an order that no other
        effect minds, are not compared.
        """
        i, images = self.train[0], {}
        for values in itertools.product(*(whole_values((effect, name)) for name in names)):
            parameters = known | dict(zip(names, values, strict=True))
            images.setdefault(pipeline.key_of(others + [(effect, parameters)]), []).append(parameters)
        different = [known if known in alike else alike[0] for alike in images.values()]

        def loss(parameters):
            groups = self.fitter.residuals_at(i, others + [(effect, parameters)], poses[i])
            return total({i: groups}, NU * LEAPING_WIDTH**2)

        return min(different, key=loss) if len(different) > 1 else different[0]

    def likely_starts(self, effect):
        """Return those of an effect's starts that are worth a short fit."""
        leaping = [k for k in library.discrete_parameters(effect) if not spec((effect, k)).is_choice]
        if leaping:
            return [self.best_leap(effect, library.nulls_of(effect), self.effects, leaping, self.poses)]
        starts = library.starts_of(effect)
        if len(starts) <= MOST_STARTS:
            return starts
        gains, losses = self.start_promises(effect, starts)
        chosen = {*np.argsort(gains)[-MOST_STARTS:], *np.argsort(losses)[:MOST_STARTS]}
        return [starts[k] for k in sorted(chosen)]

    def _probed(self, effects):
        """Return (indices of the probes, their residual groups, robust scale) of a list of effects."""
        indices = probes(self.train)
        predictions, _ = self.fitter.start(effects, self.poses, indices)
        groups = self.fitter.residuals_of(self.poses, predictions, indices)
        return indices, groups, NU * width_of(groups) ** 2

    def promises(self, names=None):
        """Return {effect: promise} of candidates (all, or some names) that the base has not."""
        names = self.candidates if names is None else names
        beside = self._beside()
        return {name: self.promise(name, beside) for name in names if name not in dict(self.effects)}

    def try_promised(self, effect, promises, most=TRIED):
        """Return the Candidate of an effect: fitted where it is among the ``most`` promising, else at its null."""
        if is_promising(effect, promises, most):
            return self.try_effect(effect)
        return self.null_candidate(effect)

    def null_candidate(self, effect):
        """Return the Candidate of an effect that promises nothing: at its null, with the base's gap."""
        parameters = library.nulls_of(effect)
        return Candidate(
            effect, parameters, dict.fromkeys(parameters, float("nan")), self.base_losses, self.base_gap,
            self.base_gap_se, group_gaps(self.base_groups, self.floors), self.floors, True,
        )  # fmt: skip

    def try_beside_others(self, names, convinces):
        """Return the candidates of some effects, best first, beside those of the base.

        What was adopted may have made up for a part of what promises most: where that is not the best, or does not convince
        (a function of a Candidate), all are tried again, the base refitted with them.
        """
        promises = self.promises(names)
        candidates = rank([self.try_promised(e, promises, TRIED_AGAIN) for e in promises])
        tried = [e for e in promises if is_promising(e, promises, TRIED_AGAIN)]
        favourite = max(tried, key=promises.get, default=None)
        as_promised = favourite == candidates[0].effect and convinces(candidates[0])
        if favourite is None or as_promised or len(self.free()) > MANY_PARAMETERS:
            return candidates
        others = [c for c in candidates if c.effect not in tried]
        return rank([*others, *(self.try_effect(e, self.free()) for e in tried)])

    def try_effect(self, effect, beside=()):
        """Return the Candidate of one effect added to the base and fitted, parameters ``beside`` it refitted."""
        free = [(effect, k) for k in library.fitted_parameters(effect)]
        starts = self.likely_starts(effect)
        probe = probes(self.train)
        if len(starts) > 1:
            scored = []
            for start in starts:
                fit = self.fitter.fit(
                    self.effects + [(effect, start)], free, self.poses, probe, iterations=2, scale=8.0
                )
                scored.append((fit.loss, len(scored), fit))
            best = min(scored)[2]
            start_effects = best.state.effects
        else:
            start_effects = self.effects + [(effect, starts[0])]
        fit = self.fitter.fit(start_effects, free + list(beside), self.poses, self.train, iterations=9, scale=8.0)
        chosen = self._with_choices(effect, fit.state)
        if chosen != fit.state.effects:
            other = self.fitter.fit(chosen, free + list(beside), fit.state.poses, self.train, iterations=9, scale=8.0)
            fit = min(fit, other, key=lambda f: f.loss)
        poses, groups = self.fitter.score(fit.state.effects, fit.state.poses, self.test)
        return self._candidate(effect, fit, poses, groups)

    def _with_choices(self, effect, state):
        """Return the effects of a fitted State, one of them with the best values of what no fit moves."""
        names = [k for k in library.discrete_parameters(effect) if spec((effect, k)).is_choice]
        others = [e for e in state.effects if e[0] != effect]
        known = dict(state.effects)[effect]
        best = self.best_leap(effect, known, others, names, state.poses) if names else known
        return [(n, best if n == effect else p) for n, p in state.effects]

    def _candidate(self, effect, fit, poses, groups):
        values, names = dict(fit.state.effects)[effect], library.fitted_parameters(effect)
        errors, cautious = (
            dict(zip(names, e[: len(names)], strict=True))  # they come first
            for e in (fit.errors, fit.cautious_errors)
        )
        losses = losses_of(groups)
        gains = gains_by_station(self.case, self.base_losses, losses)
        candidate = Candidate(
            effect, values, errors, losses, overall_gap(groups, self.floors), gap_error(groups, self.floors),
            group_gaps(groups, self.floors), self.floors, fit.converged,
        )  # fmt: skip
        candidate.state = State(fit.state.effects, poses, fit.state.offsets)
        if self._hides_plates(groups):
            return candidate
        candidate.gain = float(gains.sum())
        candidate.stations_gaining = float((gains > -LEAST_LOSS - 0.02 * gains.sum()).mean()) if len(gains) else 0.0
        before, after = group_losses(self.base_groups), group_losses(groups)
        candidate.group_gains = {name: before[name] - after[name] for name in before}
        candidate.gain_se = float(np.sqrt(len(gains)) * gains.std(ddof=1)) if len(gains) > 1 else float("nan")
        candidate.matters = is_there(effect, values, cautious)
        return candidate

    def _hides_plates(self, groups):
        """Return whether a twin shows fewer plates than the base: one that is lost costs less than one that is far off."""
        plates = sum(len(g["corners"]) for g in groups.values())
        return lost_plates(groups) - lost_plates(self.base_groups) > MOST_HIDDEN * plates

    def free(self):
        """Return [(effect, parameter)] of what is fitted in the base."""
        return [f for f in fitted(self.effects) if f[0] not in self.fixed]

    def adopt(self, candidate):
        """Make the candidate part of the base and refit all its effects together; return the Fit.

        A fit does not leap: what leaps in the base is looked for once more beside the new effect.
        """
        self.poses = candidate.state.poses
        self.effects = candidate.state.effects
        fit = self.set_base(self.effects, self.free())
        leapt = self._leapt(candidate.effect)
        if leapt == self.effects:
            return fit
        before = self.effects, self.poses
        again = self.set_base(leapt, self.free())
        if again.loss < fit.loss:
            return again
        self.rebase(*before)
        return fit

    def _leapt(self, new):
        """Return the base's effects, those that leap at their best whole values beside the others, but for the new one."""
        effects = []
        for name, p in self.effects:
            discrete = library.discrete_parameters(name)
            if discrete and name != new and name not in self.fixed:
                others = [e for e in self.effects if e[0] != name]
                best = self.best_leap(name, p, others, discrete, self.poses)
                if any(abs(best[k] - p[k]) >= 1 for k in discrete):
                    p = best
            effects.append((name, p))
        return effects

    def drop(self, name):
        """Take an effect out of the base and refit; return the Fit."""
        self.effects = [(n, p) for n, p in self.effects if n != name]
        return self.set_base(self.effects, self.free())


def whole_values(parameter):
    """Return the whole values of (effect, parameter) within its bounds."""
    bounds = spec(parameter)
    return [float(value) for value in range(math.ceil(bounds.lower), math.floor(bounds.upper) + 1)]


def is_promising(effect, promises, most=TRIED):
    """Return whether an effect's promise is worth a fit: more than nothing, among the ``most`` best, and near the best."""
    best = sorted(promises, key=lambda n: (-promises[n], n))[:most]
    return effect in best and promises[effect] >= max(LEAST_PROMISE, SHARE_OF_BEST * promises[best[0]])


def gains_by_station(case, before, after):
    """Return the gain in loss of each held-out station (s,)."""
    stations = {}
    for i in before:
        stations[case.captures[i].view.station] = (
            stations.get(case.captures[i].view.station, 0.0) + before[i] - after[i]
        )
    return np.array([stations[s] for s in sorted(stations)])


def is_there(effect, values, errors):
    """Return whether some parameter is farther from its null than is worth naming and than three standard errors.

    One that only says how another acts tells nothing. Of many waves, which stand in for one another, none need be certain
    by itself: together they must be worth naming, and what they gain on captures that no fit saw says how certain they are.
    """
    acting = {k: p for k, p in library.parameters_of(effect).items() if not p.auxiliary}
    if len(acting) > MANY_PARAMETERS:
        return math.hypot(*((values[k] - p.null) / p.matters for k, p in acting.items())) > 1
    return any(abs(values[k] - p.null) > max(p.matters, 3 * errors[k]) for k, p in acting.items())


def rank(candidates):
    """Return candidates, best held-out loss first, each parameter charged."""
    return sorted(candidates, key=lambda c: (-(c.gain - 2 * len(c.parameters)), c.effect))
