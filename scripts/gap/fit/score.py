"""Losses and gaps of residual groups {capture index: {group: residuals}}, and the floor: how far repeats lie apart."""

import numpy as np
from scipy.optimize import brentq

from gap.bounds import MAX_FLOOR
from gap.fit.residuals import RHO_NOISE, flatten, rho
from gap.observables import GAP_GROUPS, MIN_FLOOR


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
    return root_mean_square(group_gaps(groups, floors).values())


def root_mean_square(gaps):
    """Return the root mean square of some gaps."""
    return float(np.sqrt(np.mean([v**2 for v in gaps])))


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
                np.clip(np.sqrt(rho(np.concatenate(values)).mean() / RHO_NOISE), MIN_FLOOR[name], MAX_FLOOR)
            )
    return floors


def robust_scatter(values, least):
    """Return the scale, ``least`` or more, in which values (n,) lie about their median as noise of variance 1 does, by the robust
    loss; what is NaN does not count. Source: P. J. Huber, "Robust estimation of a location parameter" (1964).
    """
    values = values[np.isfinite(values)]
    off = values - np.median(values)

    def above_noise(scale):
        return rho(off / scale).sum() - RHO_NOISE * (len(off) - 1)  # the median is fitted

    if above_noise(least) <= 0:
        return least
    return float(brentq(above_noise, least, least + 10 * np.abs(off).max()))


def losses_of(groups):
    """Return {capture index: loss}."""
    return {i: float(rho(flatten(g)).sum()) for i, g in groups.items()}


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


def gains_by_station(problem, before, after):
    """Return the gains (s,) in loss of each station, of captures' losses {capture index: loss} before and after."""
    stations = {}
    for i in before:
        name = problem.captures[i].view.station
        stations[name] = stations.get(name, 0.0) + before[i] - after[i]
    return np.array([stations[s] for s in sorted(stations)])


def error_of_sum(gains):
    """Return the standard error of the sum of stations' gains (s,) by their scatter, infinite of one alone."""
    return float(np.sqrt(len(gains)) * gains.std(ddof=1)) if len(gains) > 1 else float("inf")


def shared_gain(problem, base, gains):
    """Return the part of ``gains`` {group: loss} over a base Twin that its held-out captures do not tell independently: all show
    the sensor's own pattern, which an effect may follow by chance.

    By how much the base's floors are above those of repeats says how much of a group's scatter captures share, its intraclass
    correlation; n of them are worth n / (1 + (n - 1) correlation). Source: L. Kish, "Survey Sampling" (1965), the design effect.
    """
    repeats, others = problem.floors_of(base.groups), len(base.groups) - 1
    shared = {name: max(1 - (repeats.get(name, 1.0) / floor) ** 2, 0.0) for name, floor in base.floors.items()}
    return sum(gain * (1 - 1 / (1 + others * shared.get(name, 0.0))) for name, gain in gains.items())
