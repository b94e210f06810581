"""Which effect is missing: candidates compete on captures they were not fitted to; the best is adopted; and again.

Losses are sums of the robust loss over whitened residuals (gap.fit); gaps are in units of the floor.
"""

import math
from dataclasses import dataclass, field, replace
from itertools import zip_longest

import numpy as np
from scipy.spatial import cKDTree

from effects import pipeline
from gap.fit import (
    GROUPS,
    NU,
    RHO_NOISE,
    Fitter,
    State,
    flatten,
    image_step,
    is_geometric,
    prior_equations,
    rho,
    spec,
    total,
    width_of,
)
from gap.observe import SMALLEST_SIDE_PX, code_sides_px, wholly_inside
from rig.geometry import station_pose

GAP_GROUPS = ("corners", "levels", "edges", "colour", "field", "noise")
MOST_CAPTURES = 6  # that are fitted, and as many that are held out
PROBES = 3  # captures of each half that promises are read from, and noise
TRIED = 6  # candidates that are fitted, the most promising; others stay at their null
TRIED_AGAIN = 4  # the same in later steps of a climb
MOST_STATIONS = 0.7  # share of held-out stations that must not lose: a highlight is not seen from everywhere
LEAST_LOSS = 3.0  # a station loses that loses more than this, or than 2 % of the whole gain
LEAST_GAIN = 25.0  # and the least gain in loss that is worth a name
LEAST_SHARE = 0.15  # of what is left above the floor, that a candidate must gain: less is a patch on a wrong form
MOST_OF_A_GROUP = 0.6  # of the excess of one group of observables, that is enough as well
CLOSED = 0.2  # share of the first excess up to which the climb has closed the gap, though above the floor
MANY_PARAMETERS = 12
FIRST_STEPS = 3  # that are tried one after the other, until one climb closes the gap well
HARDLY_CLOSED = 0.4  # share above which what helped a little gets no name
LEAST_PROMISE = LEAST_GAIN  # first-order gain in training loss below which an effect is not fitted
MOST_STARTS = 2  # that are fitted, the most promising, and as many that are nearest
LEAPING_WIDTH = 10.0  # robust scale at which whole values are compared
LONGEST_WAY = 1e4  # whitened residual beyond which a start says no more
SHARE_OF_BEST = 0.01  # of the best promise: less is not fitted in this step either
# Floors come from trials; they differ by more only where the twin is still wrong
SMALLEST_FLOOR = {"corners": 0.25, "edges": 0.25, "levels": 0.5, "colour": 0.5, "field": 0.5, "noise": 0.5}
LARGEST_FLOOR = 1.5
LIKE_NOISE = 1.5  # gap of the noise's own observables up to which the twin's noise is like the real one
ALLOWED = 0.1
STILL_OPEN = 2.0  # gap, in units of the floor, that is open whatever it was at first
ENOUGH = 1.10  # a gap up to this, in units of the floor, is the floor


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


RECORDED = (
    "effect", "parameters", "errors", "losses", "gap", "gap_se", "groups", "floors", "converged", "gain", "gain_se",
    "stations_gaining", "matters", "group_gains",
)  # fmt: skip


def split_by_station(case):
    """Return (training, held-out) indices of captures: whole stations, half of them each.

    They alternate over heights and tilts; then two change places for as long as this brings the held-out plates nearer to
    the training ones in the image: what lies where no plate was fitted tests nothing.
    Empty held-out where there are fewer than two stations.
    """
    stations = sorted({c.view.station for c in case.captures})
    remoteness = remoteness_of([plate_centres(case, s) for s in stations])
    second = {k for k in range(len(stations)) if (k + k // 2) % 2}
    train = min((set(range(len(stations))) - second, second), key=remoteness)
    while True:
        swaps = [train - {a} | {b} for a in sorted(train) for b in range(len(stations)) if b not in train]
        nearest = min(swaps, key=remoteness, default=train)
        if remoteness(nearest) >= remoteness(train):
            break
        train = nearest
    fitted = {stations[k] for k in train}
    captures = range(len(case.captures))
    return tuple(
        [i for i in captures if (case.captures[i].view.station in fitted) == chosen] for chosen in (True, False)
    )


def plate_centres(case, station):
    """Return the centres (n, 2) of all plates measured at a station, pixels."""
    found = [c.observation for c in case.captures if c.view.station == station and c.observation is not None]
    return np.concatenate([np.zeros((0, 2)), *(o.corners[o.measured].mean(1) for o in found)])


def remoteness_of(points):
    """Return a function of the stations (set of indices) that train: how far the others' points, a list of arrays (n, 2),
    lie from the nearest of theirs; the fourth powers' mean, as it is holes that count.
    """
    station = np.repeat(np.arange(len(points)), [len(p) for p in points])
    every = np.concatenate([np.zeros((0, 2)), *points])
    to_station = [cKDTree(p).query(every)[0] if len(p) else np.full(len(every), np.inf) for p in points]

    def remoteness(train):
        held_out = ~np.isin(station, list(train))
        if not train or not held_out.any():
            return np.inf
        return float((np.min([to_station[k][held_out] for k in train], axis=0) ** 4).mean())

    return remoteness


def null_of(effect):
    """Return the parameters at which an effect does nothing."""
    return {k: p.null for k, p in pipeline.available_effects()[effect].PARAMETERS.items()}


def starts_of(effect):
    """Return the starting points of an effect's fit: its parameters' starts side by side."""
    parameters = pipeline.available_effects()[effect].PARAMETERS
    columns = [p.starts for p in parameters.values()]
    rows = zip_longest(*columns)
    return [
        {
            k: (columns[i][0] if value is None else value)
            for i, (k, value) in enumerate(zip(parameters, row, strict=True))
        }
        for row in rows
    ]


def start_step(parameter, value):
    """Return the step from the null to the farthest start: an even parameter has no slope at its null."""
    s = spec(parameter)
    steps = [start - value for start in s.starts if start != value]
    return max(steps, key=abs) if steps else image_step(parameter, value)


def thinned(indices):
    """Return at most MOST_CAPTURES of the captures, evenly picked: more cost time and tell little more."""
    if len(indices) <= MOST_CAPTURES:
        return indices
    return [indices[int(k)] for k in np.linspace(0, len(indices) - 1, MOST_CAPTURES).round()]


def usable(indices, case):
    """Return those captures in which at least one plate was measured."""
    return [i for i in indices if case.captures[i].observation.measured.any()]


def probes(indices):
    """Return PROBES of the captures: promises are read from them, and noise, of which a few images tell enough."""
    return indices[:: max(1, len(indices) // PROBES)][:PROBES]


def group_gaps(groups, floors):
    """Return {group: gap} over captures' residual groups, in units of the floor."""
    out = {}
    for name in GAP_GROUPS:
        values = [g[name].ravel() for g in groups.values() if name in g and g[name].size]
        if values:
            out[name] = float(np.sqrt(rho(np.concatenate(values)).mean() / RHO_NOISE) / floors.get(name, 1.0))
    return out


def overall_gap(groups, floors):
    """Return the root mean square over the groups of observables."""
    return float(np.sqrt(np.mean([v**2 for v in group_gaps(groups, floors).values()])))


def gap_error(groups, floors):
    """Return the jackknife standard error over captures of the overall gap."""
    if len(groups) < 2:
        return float("nan")
    keys = list(groups)
    left_out = [overall_gap({k: groups[k] for k in keys if k != out}, floors) for out in keys]
    n = len(keys)
    return float(np.sqrt((n - 1) / n * ((np.array(left_out) - np.mean(left_out)) ** 2).sum()))


def floors_of(case, groups):
    """Return {group: floor}: how far trials of one station lie apart, in whitened units.

    Differences of two trials' residuals, over the square root of two, free of what the twin lacks.
    """
    pairs = {}
    for i in groups:
        pairs.setdefault(case.captures[i].view.station, []).append(i)
    differences = {name: [] for name in GAP_GROUPS}
    for members in pairs.values():
        for a, b in zip(members[:-1], members[1:], strict=True):
            oa, ob = case.captures[a].observation, case.captures[b].observation
            both = oa.measured & ob.measured
            pick_a, pick_b = both[oa.measured], both[ob.measured]
            for name in GAP_GROUPS:
                if name not in groups[a] or name not in groups[b]:
                    continue
                ya, yb = groups[a][name], groups[b][name]
                if ya.ndim == 2:
                    ya, yb = ya[pick_a], yb[pick_b]
                if ya.shape == yb.shape:
                    differences[name].append(((ya - yb) / np.sqrt(2)).ravel())
    floors = {}
    for name, values in differences.items():
        if values and sum(v.size for v in values) >= 20:
            floors[name] = float(
                np.clip(np.sqrt(rho(np.concatenate(values)).mean() / RHO_NOISE), SMALLEST_FLOOR[name], LARGEST_FLOOR)
            )
    return floors


class Diagnosis:
    """The climb of one camera: a base twin (effects and poses) that grows by the best candidate."""

    def __init__(self, case, candidates=None, split=None):
        self.case = case
        train, test = split or split_by_station(case)
        self.train, self.test = thinned(usable(train, case)), thinned(usable(test, case))
        self.fitter = Fitter(case, probes(self.train) + probes(self.test))
        self.candidates = list(candidates or pipeline.available_effects())
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
        free = [(effect, k) for k in null_of(effect)]
        effects = self.effects + [(effect, null_of(effect))]
        indices, groups, nu = self._probed(effects)
        derivatives = self.fitter.derivatives(effects, free, self.poses, groups, indices, start_step)
        if beside is None:
            gain = self._first_order_gain(effects, free, derivatives, groups, nu)
        else:
            alone = {i: (beside[i], Jp) for i, (_, Jp) in derivatives.items()}
            together = {i: (np.hstack([Jt, beside[i]]), Jp) for i, (Jt, Jp) in derivatives.items()}
            gain = self._first_order_gain(effects, free + self.free(), together, groups, nu)
            gain -= self._first_order_gain(effects, self.free(), alone, groups, nu)
        starts = starts_of(effect)
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
        nulls = self.effects + [(effect, null_of(effect))]
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

    def best_leap(self, effect, name):
        """Return the start of an effect whose image changes by leaps with a parameter: the best of its whole values."""
        i, parameter = self.train[0], spec((effect, name))
        whole = range(math.ceil(parameter.lower), math.floor(parameter.upper) + 1)
        starts = [null_of(effect) | {name: float(value)} for value in whole]

        def loss(start):
            groups = self.fitter.residuals_at(i, self.effects + [(effect, start)], self.poses[i])
            return total({i: groups}, NU * LEAPING_WIDTH**2)

        return min(starts, key=loss)

    def likely_starts(self, effect):
        """Return those of an effect's starts that are worth a short fit."""
        leaping = getattr(pipeline.effect_named(effect), "LEAPS", None)
        if leaping:
            return [self.best_leap(effect, leaping)]
        starts = starts_of(effect)
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
        parameters = null_of(effect)
        return Candidate(
            effect, parameters, dict.fromkeys(parameters, float("nan")), self.base_losses, self.base_gap,
            self.base_gap_se, group_gaps(self.base_groups, self.floors), self.floors, True,
        )  # fmt: skip

    def try_beside_others(self, names):
        """Return the candidates of some effects, best first, beside those of the base.

        What was adopted may have made up for a part of what promises most: where that is not the best, all are tried again,
        the base refitted with them.
        """
        promises = self.promises(names)
        candidates = rank([self.try_promised(e, promises, TRIED_AGAIN) for e in promises])
        tried = [e for e in promises if is_promising(e, promises, TRIED_AGAIN)]
        favourite = max(tried, key=promises.get, default=None)
        if favourite in (None, candidates[0].effect) or len(self.free()) > MANY_PARAMETERS:
            return candidates
        others = [c for c in candidates if c.effect not in tried]
        return rank([*others, *(self.try_effect(e, self.free()) for e in tried)])

    def try_effect(self, effect, beside=()):
        """Return the Candidate of one effect added to the base and fitted, parameters ``beside`` it refitted."""
        free = [(effect, k) for k in null_of(effect)]
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
        poses, groups = self.fitter.score(fit.state.effects, fit.state.poses, self.test)
        return self._candidate(effect, fit, poses, groups)

    def _candidate(self, effect, fit, poses, groups):
        values = dict(fit.state.effects)[effect]
        own = np.diag(fit.covariance)[: len(values)]  # they come first
        errors = dict(zip(values, np.sqrt(np.maximum(own, 0)), strict=True))
        losses = losses_of(groups)
        gains = gains_by_station(self.case, self.base_losses, losses)
        candidate = Candidate(
            effect, values, errors, losses, overall_gap(groups, self.floors), gap_error(groups, self.floors),
            group_gaps(groups, self.floors), self.floors, fit.converged,
        )  # fmt: skip
        candidate.gain = float(gains.sum())
        candidate.stations_gaining = float((gains > -LEAST_LOSS - 0.02 * gains.sum()).mean()) if len(gains) else 0.0
        before, after = group_losses(self.base_groups), group_losses(groups)
        candidate.group_gains = {name: before[name] - after[name] for name in before}
        candidate.gain_se = float(np.sqrt(len(gains)) * gains.std(ddof=1)) if len(gains) > 1 else float("nan")
        candidate.matters = is_there(effect, values, errors)
        candidate.state = State(fit.state.effects, poses, fit.state.offsets)
        return candidate

    def free(self):
        """Return [(effect, parameter)] of what is fitted in the base."""
        return [(n, k) for n, p in self.effects for k in p if n not in self.fixed]

    def adopt(self, candidate):
        """Make the candidate part of the base and refit all its effects together; return the Fit."""
        self.poses = candidate.state.poses
        self.effects = candidate.state.effects
        return self.set_base(self.effects, self.free())

    def drop(self, name):
        """Take an effect out of the base and refit; return the Fit."""
        self.effects = [(n, p) for n, p in self.effects if n != name]
        return self.set_base(self.effects, self.free())


def group_losses(groups):
    """Return {group: loss} over captures."""
    names = sorted({name for g in groups.values() for name in g})
    return {n: float(sum(rho(g[n]).sum() for g in groups.values() if n in g)) for n in names}


def excess_of(groups, floors):
    """Return {group: loss above what repeats of a station would show}, none below 0."""
    sizes = {n: sum(g[n].size for g in groups.values() if n in g) for n in group_losses(groups)}
    return {
        n: max(loss - RHO_NOISE * sizes[n] * floors.get(n, 1.0) ** 2, 0.0) for n, loss in group_losses(groups).items()
    }


def is_promising(effect, promises, most=TRIED):
    """Return whether an effect's promise is worth a fit: more than nothing, among the ``most`` best, and near the best."""
    best = sorted(promises, key=lambda n: (-promises[n], n))[:most]
    return effect in best and promises[effect] >= max(LEAST_PROMISE, SHARE_OF_BEST * promises[best[0]])


def losses_of(groups):
    """Return {capture index: loss}."""
    return {i: float(rho(flatten(g)).sum()) for i, g in groups.items()}


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
    acting = {k: p for k, p in effect_parameters(effect).items() if not p.qualifies}
    if len(acting) > MANY_PARAMETERS:
        return math.hypot(*((values[k] - p.null) / p.matters for k, p in acting.items())) > 1
    return any(abs(values[k] - p.null) > max(p.matters, 3 * errors[k]) for k, p in acting.items())


def rank(candidates):
    """Return candidates, best held-out loss first, each parameter charged."""
    return sorted(candidates, key=lambda c: (-(c.gain - 2 * len(c.parameters)), c.effect))


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


def effect_parameters(effect):
    """Return the effects.base.Parameter of each parameter of an effect."""
    return {k: spec((effect, k)) for k in null_of(effect)}


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


def errors_of(diagnosis, fit, effect):
    """Return {parameter: standard error} of one of the effects that were fitted together."""
    errors = np.sqrt(np.maximum(np.diag(fit.covariance), 0))
    return {k: e for (name, k), e in zip(diagnosis.free(), errors, strict=True) if name == effect}


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
        if not is_there(best.effect, dict(diagnosis.effects)[best.effect], errors_of(diagnosis, fit, best.effect)):
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
        candidates = diagnosis.try_beside_others([c.effect for c in first])
    return steps, candidates


@dataclass
class Outcome:
    """Where a climb ended: its steps, the candidates that were left, the verdict and the base it reached."""

    steps: list
    left: list
    verdict: str
    share_left: float
    effects: list
    poses: np.ndarray


def climbed(diagnosis, first, excess, most_steps, progress, start_with=None, taken=()):
    """Return the Outcome of a climb from the base; ``excess`` is the first one, in loss."""
    steps, left = climb(diagnosis, first, most_steps, progress, start_with, taken)
    share = sum(diagnosis.excess.values()) / excess
    verdict = verdict_of(steps, diagnosis.base_gap, diagnosis.base_gap_se, share)
    return Outcome(steps, left, verdict, share, diagnosis.effects, diagnosis.poses)


def conclude(diagnosis, first, most_steps=6, progress=None):
    """Climb from the base, leave the diagnosis at what was found, and return the Outcome.

    The best first step is not always on the best way: where it leaves its own group of observables open, or comes near
    and stays open, the next best ones are tried as well. What can mimic anything of its kind, a warp of many waves,
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
        if best.verdict != "unexplained":
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


def _with_flexible(diagnosis, first, start, best, excess, most_steps, progress):
    """Return the Outcome with the warps of many waves: added to what was found, or in the place of what they mimic.

    A warp brings its own lens along: rigid effects that move points must be worth their names beside it.
    """
    flexible = [c.effect for c in first if len(c.parameters) > MANY_PARAMETERS]
    tried = [diagnosis.try_effect(e) for e in flexible if diagnosis.promise(e) >= LEAST_PROMISE]
    further = climbed(diagnosis, tried + best.left, excess, most_steps, progress, taken=best.steps)
    found = min((best, further), key=lambda o: o.share_left)
    rigid = [step.effect for step in further.steps if step.effect not in flexible and moves_points(step.effect)]
    if rigid and any(step.effect in flexible for step in further.steps):
        without = _retraced(diagnosis, start, further, rigid, excess)
        if without.verdict == "explained":
            return without
    return found


def moves_points(effect):
    """Return whether an effect moves points and does nothing else."""
    return all(is_geometric((effect, key)) for key in null_of(effect))


def _retraced(diagnosis, start, outcome, without, excess):
    """Return the Outcome of the same steps, each refitted, without some effects."""
    diagnosis.rebase(start.effects, start.poses)
    steps, found = [], dict(outcome.effects)
    for step in outcome.steps:
        if step.effect not in without:
            effects = diagnosis.effects + [(step.effect, found[step.effect])]
            fit = diagnosis.set_base(effects, [(n, k) for n, p in effects for k in p if n not in diagnosis.fixed])
            steps.append(_step(diagnosis, fit, step.effect, step.candidates, step.confused_with, step.main_group))
    share = sum(diagnosis.excess.values()) / excess
    verdict = verdict_of(steps, diagnosis.base_gap, diagnosis.base_gap_se, share)
    left = rank([*outcome.left, *(diagnosis.null_candidate(name) for name in without)])
    return Outcome(steps, left, verdict, share, diagnosis.effects, diagnosis.poses)


def _step(diagnosis, fit, effect, candidates, confused, group):
    """Return the Step that led to the diagnosis's base."""
    errors = dict(zip(diagnosis.free(), np.sqrt(np.maximum(np.diag(fit.covariance), 0)), strict=True))
    twin, seen = diagnosis.effects, diagnosis.base_groups
    return Step(effect, twin, errors, candidates, confused, seen, diagnosis.poses, group)


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


def verdict_of(steps, gap, gap_se, share_left=1.0):
    """Return ``adequate``, ``explained`` or ``unexplained`` from the steps taken and the gap that is left.

    A gap that captures disagree about is no smaller for that: the error is allowed for up to ``ALLOWED`` only.
    ``share_left`` is what the climb left of the excess: effects have the right name before they have the last form.
    """
    nearly_closed = steps and share_left < CLOSED and gap < STILL_OPEN
    if gap - min(2 * np.nan_to_num(gap_se), ALLOWED) > ENOUGH and not nearly_closed:
        return "unexplained"
    return "explained" if steps else "adequate"


def suggested_station(case, a, b):
    """Return the station ({height_m, tilt_deg}) at which two twins (lists of effects) differ most, and by how much.

    Corners are compared after each twin's pose was adjusted within its prior, levels by the images' difference;
    the sum is in units of 0.05 px and 1 grey level.
    """
    capture = case.captures[0]
    best = None
    for height_m in (0.25, 0.5, 0.8, 1.2, 1.6):
        for tilt_deg in (0.0, 15.0, 30.0, 45.0, 60.0):
            view = replace(capture.view, T_cam_world=station_pose(height_m, tilt_deg))
            probe = replace(capture, view=view)
            score = _difference(case, probe, a, b)
            if best is None or score > best[0]:
                best = (score, height_m, tilt_deg)
    return {"height_m": best[1], "tilt_deg": best[2], "difference": round(float(best[0]), 2)}


def _difference(case, capture, a, b):
    zero = np.zeros(6)
    pixels = [case.corners_of(capture, effects, zero).reshape(-1, 8) for effects in (a, b)]
    inside = wholly_inside(pixels[0].reshape(-1, 4, 2), capture.view.width, capture.view.height)
    inside &= np.isfinite(pixels[1]).all(1) & (code_sides_px(pixels[0].reshape(-1, 4, 2)) >= SMALLEST_SIDE_PX)
    if not inside.any():
        return 0.0
    d = (pixels[1] - pixels[0])[inside].ravel() / 0.05
    J = []
    for k in range(6):
        h = np.zeros(6)
        h[k] = 1e-5
        J.append((case.corners_of(capture, a, h).reshape(-1, 8)[inside].ravel() - pixels[0][inside].ravel()) / 1e-5)
    J = np.stack(J, axis=1) / 0.05
    prior = np.where(np.isfinite(case.sigma_pose), 1 / case.sigma_pose**2, 0)
    d = d - J @ np.linalg.solve(J.T @ J + np.diag(prior + 1e-9), J.T @ d)
    images = [
        case.image_of(case.radiance_of(capture, effects, zero), capture, effects, zero).mean() for effects in (a, b)
    ]
    return np.sqrt((d**2).mean()) + abs(images[0] - images[1])
