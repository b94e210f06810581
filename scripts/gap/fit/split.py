"""Which captures are fitted and which are held out: whole stations, and as many captures as tell enough."""

import numpy as np
from scipy.spatial import cKDTree

MAX_CAPTURES = 6  # that are fitted, and as many that are held out
PROBES = 3  # captures of each half that predicted gains are read from, and noise


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


def thinned(indices, most):
    """Return at most so many of the captures, evenly picked: more cost time and tell little more."""
    if len(indices) <= most:
        return indices
    return [indices[int(k)] for k in np.linspace(0, len(indices) - 1, most).round()]


def usable(indices, case):
    """Return those captures in which at least one plate was measured."""
    return [i for i in indices if case.captures[i].observation.measured.any()]


def probes(indices):
    """Return PROBES of the captures: predicted gains are read from them, and noise, of which a few images tell enough."""
    return indices[:: max(1, len(indices) // PROBES)][:PROBES]
