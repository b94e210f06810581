"""Which effects explain together, to first order, what a camera's first twin leaves open, and how many of these are really hidden:
python tests/bench/bench_together.py [SEED ...]. Of whole cameras, single effects and effects outside the library.

Forward selection in the derivatives by all effects of the library, about their nulls and towards their starts; nothing is fitted but
the first twin's poses.
"""

import argparse
import itertools
import logging
import os
import sys
import tempfile
from dataclasses import dataclass
from pathlib import Path

os.environ["OPENBLAS_NUM_THREADS"] = "1"  # before numpy is loaded: threads cost small matrices more than they bring
ROOT = Path(__file__).resolve().parents[2]
sys.path[:0] = [str(ROOT / "scripts"), str(ROOT / "tests/bench")]

import cv2  # noqa: E402
import numpy as np  # noqa: E402

from effects import library  # noqa: E402
from gap.evidence import start_step  # noqa: E402
from gap.normal_equations import normal_equations  # noqa: E402
from gap.parameters import prior_equations, spec  # noqa: E402
from gap.search import MIN_GAIN, Search  # noqa: E402
from gap.select_effects import is_flexible  # noqa: E402
from gap.split import probes  # noqa: E402
from record import record  # noqa: E402
from trials.generate_trials import generate_trial  # noqa: E402
from trials.observe_trial import observe_trial, observed_cases  # noqa: E402

MAX_TOGETHER = 9  # effects that are proposed at once
LEAST_SHARE = 0.03  # of all that could be gained to first order: what adds less is not proposed
COUNTS = {"whole": 4, "single": 4, "outside": 3}  # of trials of each kind and seed
HIDDEN = {
    "whole": "proposed together, whole trials: names that are hidden",
    "single": "proposed together, single trials: names that are hidden",
    "outside": "proposed together, outside trials: names that are hidden",
}
FIRST = {
    "whole": "proposed together, whole trials: the first name is hidden",
    "single": "proposed together, single trials: the first name is hidden",
}


@dataclass(frozen=True)
class Way:
    """One form in which an effect may be missing: its columns in the linear model."""

    effect: str
    columns: tuple


class LinearModel:
    """What a twin's residuals look like in the derivatives by many effects: normal equations, poses eliminated.

    Columns are scaled to a unit diagonal. A parameter whose null is one of its bounds steps to the other side only.
    """

    def __init__(self, H, g, lower, upper, own):
        self.scale = np.sqrt(np.maximum(np.diag(H), 1e-12))
        self.H, self.g = H / np.outer(self.scale, self.scale), g / self.scale
        self.lower, self.upper, self.own = lower, upper, own

    def gain(self, columns):
        """Return the loss that some columns and the twin's own would gain; what would leave its bounds at once is left out."""
        left = [*columns, *self.own]
        while left:
            d = np.linalg.solve(self.H[np.ix_(left, left)] + 1e-6 * np.eye(len(left)), self.g[left])
            out = np.array(
                [(self.lower[k] >= 0 and s < 0) or (self.upper[k] <= 0 and s > 0) for k, s in zip(left, d, strict=True)]
            )
            if not out.any():
                return float(self.g[left] @ d)
            left.pop(int(np.argmax(np.where(out, np.abs(d), -1.0))))
        return 0.0


def proposed(search, twin, names):
    """Return those of ``names``, best first, that explain most together of what a twin leaves open, to first order.

    Forward selection in the derivatives of a few captures about the twin, its own parameters and poses going along.
    """
    ways, model = linear_model(search, twin, [n for n in names if n not in twin.names])
    captures = len(search.train) / len(probes(search.train))
    possible = model.gain([k for way in ways for k in way.columns]) - model.gain(())
    least = max(MIN_GAIN / captures, LEAST_SHARE * possible)
    taken = []
    while ways and len(taken) < MAX_TOGETHER:
        columns = [k for way in taken for k in way.columns]
        so_far = model.gain(columns)
        gains = [model.gain([*columns, *w.columns]) - so_far - 2 * len(w.columns) / captures for w in ways]
        best = int(np.argmax(gains))
        if gains[best] < least:
            break
        taken.append(ways[best])
        ways = [way for way in ways if way.effect != taken[-1].effect]
    return [way.effect for way in taken]


def linear_model(search, twin, names):
    """Return (Ways of some effects, the LinearModel of them and the twin's own parameters) in a few captures."""
    (indices, groups, nu), beside = search.prepared_for(twin)
    acting = {n: [k for k in library.fitted_parameters(n) if _acts_by_degrees(n, k)] for n in names}
    free = [(n, k) for n in names for k in acting[n]]
    effects = [*twin.effects, *((n, library.nulls_of(n)) for n in names)]
    derivatives = search.solver.derivatives(effects, free, twin.poses, indices, start_step)
    ways = [Way(n, tuple(i for i, f in enumerate(free) if f[0] == n)) for n in names if acting[n]]
    towards = []
    for n in names:
        for start in search.problem.starts_of(n):
            if not acting[n] or _goes_elsewhere(n, start):
                ways.append(Way(n, (len(free) + len(towards),)))
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


def counted(kind, index, seed):
    """Return (names that are hidden, names that are proposed for the first twin) of one trial; none where it shows too little."""
    with tempfile.TemporaryDirectory() as folder:
        name, truth = generate_trial(Path(folder) / "campaigns", Path(folder) / "truths", kind, index, seed)
        observe_trial(Path(folder) / "campaigns" / name, Path(folder) / "kept")
        search = Search(observed_cases(Path(folder) / "kept")[0])
    hidden = [e["effect"] for e in truth["effects"]]
    if search.why_unusable():
        return hidden, []
    twin = search.fitted(list(search.problem.nuisances))
    return hidden, proposed(search, twin, [n for n in search.candidates if not is_flexible(n)])


def main(argv=None):
    """Read the command line, count, record."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("seeds", nargs="*", metavar="SEED", default=["gorse"])
    seeds = parser.parse_args(argv).seeds
    cv2.setNumThreads(1)
    logging.disable()
    for kind, count in COUNTS.items():
        trials = []
        for seed, index in itertools.product(seeds, range(count)):
            trials.append(counted(kind, index, seed))
            hidden, names = trials[-1]
            print(kind, "hidden:", *hidden, "| proposed:", *names, flush=True)
        right = sum(name in hidden for hidden, names in trials for name in names)
        number = sum(len(names) for _, names in trials)
        of = sum(len(hidden) for hidden, _ in trials)
        figures = [(HIDDEN[kind], f"{right} of {number}", f"names; {of} effects are hidden")]
        if kind in FIRST:
            first = sum(names[:1] != [] and names[0] in hidden for hidden, names in trials)
            figures.append((FIRST[kind], f"{first} of {len(trials)}", "cameras"))
        record(figures, f"python tests/bench/bench_together.py {' '.join(seeds)}")


if __name__ == "__main__":
    main()
