"""Which effect is missing: candidates compete on captures they were not fitted to; the best is adopted; and again.

Losses are sums of the robust loss over whitened residuals (gap.fit); gaps are in units of the floor.
"""

from dataclasses import dataclass, field
from itertools import zip_longest

import numpy as np

from effects import pipeline
from gap.fit import NU, RHO_NOISE, Fitter, State, flatten, is_geometric, rho, spec

GAP_GROUPS = ("corners", "levels", "edges", "colour", "field", "noise")
MOST_STATIONS = 0.7  # share of held-out stations that must gain
LEAST_GAIN = 25.0  # and the least gain in loss that is worth a name
LEAST_PROMISE = 12.0  # first-order gain in training loss below which an effect is not fitted
LARGEST_FLOOR = 1.5  # trials of a station differ by more only where the twin is still wrong
ENOUGH = 1.10  # a gap up to this, in units of the floor, is the floor


@dataclass
class Candidate:
    """The outcome of one candidate: fitted parameters with standard errors, held-out losses per capture."""

    effect: str
    parameters: dict
    errors: dict
    losses: dict
    gap: float
    gap_se: float
    groups: dict
    converged: bool
    gain: float = 0.0
    gain_se: float = 0.0
    stations_gaining: float = 0.0
    matters: bool = False
    state: State = field(default=None, repr=False)


def split_by_station(case):
    """Return (training, held-out) indices of captures: whole stations, alternating over heights and tilts.

    Empty held-out where there are fewer than two stations.
    """
    stations = sorted({c.view.station for c in case.captures})
    held_out = {s for k, s in enumerate(stations) if (k + k // 2) % 2}
    train = [i for i, c in enumerate(case.captures) if c.view.station not in held_out]
    test = [i for i, c in enumerate(case.captures) if c.view.station in held_out]
    return train, test


def null_of(effect):
    """Return the parameters at which an effect does nothing."""
    return {k: p.null for k, p in pipeline.available_effects()[effect].PARAMETERS.items()}


def starts_of(effect):
    """Return the starting points of an effect's fit: its parameters' starts side by side."""
    parameters = pipeline.available_effects()[effect].PARAMETERS
    columns = [p.starts for p in parameters.values()]
    rows = zip_longest(*columns)
    return [
        {k: (columns[i][0] if value is None else value) for i, (k, value) in enumerate(zip(parameters, row, strict=True))}
        for row in rows
    ]


def usable(indices, case):
    """Return those captures in which at least one plate was measured."""
    return [i for i in indices if case.captures[i].observation.measured.any()]


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
    """Return {group: floor}: how far trials of one station lie apart, in whitened units; at least 1.

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
            floors[name] = float(np.clip(np.sqrt(rho(np.concatenate(values)).mean() / RHO_NOISE), 1.0, LARGEST_FLOOR))
    return floors


class Diagnosis:
    """The climb of one camera: a base twin (effects and poses) that grows by the best candidate."""

    def __init__(self, case, candidates=None, split=None):
        self.case = case
        self.fitter = Fitter(case)
        train, test = split or split_by_station(case)
        self.train, self.test = usable(train, case), usable(test, case)
        self.candidates = list(candidates or pipeline.available_effects())
        self.effects = []
        self.poses = np.zeros((len(case.captures), 6))

    def set_base(self, effects, free=()):
        """Take a list of effects as the base twin; fit its free parameters and the poses on the training captures."""
        self.effects = [(n, dict(p)) for n, p in effects]
        offsets = [np.zeros((len(self.case.codes.half_code), 8)) for _ in self.case.captures]
        geometric = [f for f in free if is_geometric(f)]
        self.effects, self.poses = self.fitter.fit_geometry(
            self.effects, geometric, self.poses, offsets, self.train, scale=16.0, iterations=10
        )
        fit = self.fitter.fit(self.effects, list(free), self.poses, self.train, iterations=10, scale=2.0)
        self.effects, self.poses = fit.state.effects, fit.state.poses
        self.poses, self.base_groups = self.fitter.score(self.effects, self.poses, self.test)
        _, train_groups = self.fitter.score(self.effects, self.poses, self.train)
        self.floors = floors_of(self.case, train_groups | self.base_groups)
        self.base_losses = losses_of(self.base_groups)
        self.base_gap = overall_gap(self.base_groups, self.floors)
        self.base_gap_se = gap_error(self.base_groups, self.floors)
        return fit

    def promise(self, effect):
        """Return the training loss that an effect could gain, to first order, from the best of its starts.

        Cheap (one prediction a parameter); what promises next to nothing is not fitted.
        """
        free = [(effect, k) for k in null_of(effect)]
        effects = self.effects + [(effect, null_of(effect))]
        indices = self.train[:: max(1, len(self.train) // 6)][:6]
        predictions, _ = self.fitter.start(effects, self.poses, indices)
        groups = self.fitter.residuals_of(effects, self.poses, predictions, indices)
        H, g, _ = self.fitter._normal_equations(effects, free, self.poses, predictions, groups, indices, NU)
        scale = np.sqrt(np.maximum(np.diag(H), 1e-12))
        g, H = g / scale, H / np.outer(scale, scale)
        gain = float(g @ np.linalg.lstsq(H + 1e-6 * np.eye(len(g)), g, rcond=None)[0])
        return gain * len(self.train) / max(len(indices), 1)

    def null_candidate(self, effect):
        """Return the Candidate of an effect that promises nothing: at its null, with the base's gap."""
        parameters = null_of(effect)
        return Candidate(
            effect, parameters, dict.fromkeys(parameters, float("nan")), self.base_losses, self.base_gap,
            self.base_gap_se, group_gaps(self.base_groups, self.floors), True,
        )  # fmt: skip

    def try_effect(self, effect):
        """Return the Candidate of one effect added to the base."""
        if self.promise(effect) < LEAST_PROMISE:
            return self.null_candidate(effect)
        free = [(effect, k) for k in null_of(effect)]
        best = None
        starts = starts_of(effect)
        probe = self.train[:: max(1, len(self.train) // 3)][:3]
        if len(starts) > 1:
            scored = []
            for start in starts:
                fit = self.fitter.fit(self.effects + [(effect, start)], free, self.poses, probe, iterations=2, scale=8.0)
                scored.append((fit.loss, len(scored), fit))
            best = min(scored)[2]
            start_effects = best.state.effects
        else:
            start_effects = self.effects + [(effect, starts[0])]
        fit = self.fitter.fit(start_effects, free, self.poses, self.train, iterations=10, scale=8.0)
        poses, groups = self.fitter.score(fit.state.effects, fit.state.poses, self.test)
        return self._candidate(effect, fit, poses, groups)

    def _candidate(self, effect, fit, poses, groups):
        values = dict(fit.state.effects)[effect]
        errors = dict(zip(values, np.sqrt(np.maximum(np.diag(fit.covariance), 0)), strict=True))
        losses = losses_of(groups)
        gains = gains_by_station(self.case, self.base_losses, losses)
        candidate = Candidate(
            effect, values, errors, losses, overall_gap(groups, self.floors), gap_error(groups, self.floors),
            group_gaps(groups, self.floors), fit.converged,
        )  # fmt: skip
        candidate.gain = float(gains.sum())
        candidate.stations_gaining = float((gains > 0).mean()) if len(gains) else 0.0
        candidate.gain_se = float(np.sqrt(len(gains)) * gains.std(ddof=1)) if len(gains) > 1 else float("nan")
        candidate.matters = any(
            abs(values[k] - p.null) > max(p.matters, 2 * errors[k])
            for k, p in pipeline.available_effects()[effect].PARAMETERS.items()
        )
        candidate.state = State(fit.state.effects, poses, fit.state.offsets)
        return candidate

    def adopt(self, candidate):
        """Make the candidate part of the base and refit all its effects together; return the Fit."""
        self.poses = candidate.state.poses
        effects = candidate.state.effects
        return self.set_base(effects, [(n, k) for n, p in effects for k in p])


def losses_of(groups):
    """Return {capture index: loss}."""
    return {i: float(rho(flatten(g)).sum()) for i, g in groups.items()}


def gains_by_station(case, before, after):
    """Return the gain in loss of each held-out station (s,)."""
    stations = {}
    for i in before:
        stations[case.captures[i].view.station] = stations.get(case.captures[i].view.station, 0.0) + before[i] - after[i]
    return np.array([stations[s] for s in sorted(stations)])


def rank(candidates):
    """Return candidates, best held-out loss first, each parameter charged; those not converged last."""
    return sorted(candidates, key=lambda c: (not c.converged, -(c.gain - 2 * len(c.parameters)), c.effect))


def is_missing(candidate):
    """Return whether a candidate's held-out gain is more than chance and its size matters."""
    return bool(
        candidate.converged
        and candidate.matters
        and candidate.gain > LEAST_GAIN + 2 * len(candidate.parameters)
        and candidate.stations_gaining >= MOST_STATIONS
    )


def effect_parameters(effect):
    """Return the effects.base.Parameter of each parameter of an effect."""
    return {k: spec((effect, k)) for k in null_of(effect)}
