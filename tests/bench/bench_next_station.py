"""Where to photograph next, closed: ``python tests/bench/bench_next_station.py [--runs N] [--most N]``.

A camera with one hidden effect, drawn by the generator of tests/bench/generator, and a rival that few captures cannot tell from
it. From the same first captures, one more is taken again and again where the program suggests, or at random, until the verdict
names the hidden effect alone. The pairs are those of PAIRS whose first verdict is not right; one capture is the fewest.
"""

import argparse
import sys
import tempfile
from dataclasses import replace
from pathlib import Path

ROOT = Path(__file__).resolve().parents[2]
sys.path[:0] = [str(ROOT / "scripts"), str(ROOT / "tests/bench")]

import cv2
import numpy as np
from tabulate import tabulate
from tqdm import tqdm

from gap.bounds import LITTLE
from gap.explain.next_station import HEIGHTS_M, TILTS_DEG, suggested_station
from gap.select.naming import is_missing
from gap.select.outcome import confused_with
from gap.select.search import Search
from gap.select.twin import rank
from generator import draw_effect, generate_campaign, nominal
from record import record
from trials.observe_trial import observe_camera, observed_cases

# Stations (m, degrees) of the first captures, two each: of one height; all from afar, of two distances or three
SIDE, TWO_FAR, FAR = [(0.5, 45), (0.5, 60)], [(1.2, 30), (1.6, 30)], [(1.2, 30), (1.6, 30), (1.6, 45)]
STATIONS = [(h, int(t)) for h in HEIGHTS_M for t in TILTS_DEG]
SIZE, CAMERA = "tiny", "hp325"
PAIRS = [  # (hidden, rival, strength: a part of what is clear, first stations)
    ("rail_sag", "radial_distortion", 0.2, SIDE), ("rail_sag", "focal_length", 0.2, SIDE),
    ("rail_sag", "principal_point", 0.2, SIDE), ("rail_sag", "tangential_distortion", 0.2, SIDE),
    ("rail_sag", "camera_pose_offset", 0.2, SIDE), ("rail_sag", "marker_scale", 0.2, SIDE),
    ("rail_sag", "camera_pose_offset", 0.2, FAR), ("focal_length", "camera_pose_offset", 0.15, FAR),
    ("radial_distortion", "tangential_distortion", 0.1, FAR), ("tangential_distortion", "principal_point", 0.25, FAR),
    ("principal_point", "tangential_distortion", 0.15, FAR), ("rolling_shutter", "principal_point", 0.15, FAR),
    ("rolling_shutter", "tangential_distortion", 0.15, FAR), ("lens_blur", "defocus", 0.2, FAR),
    ("lens_blur", "defocus", 0.2, TWO_FAR), ("field_curvature", "lens_blur", 0.4, TWO_FAR),
    ("defocus", "field_curvature", 0.2, TWO_FAR), ("field_curvature", "defocus", 0.4, TWO_FAR),
]  # fmt: skip


def measured(folder, hidden, strength, stations):
    """Return the Case of a campaign with one hidden effect, both captures of each station measured."""
    camera = nominal.RIGS[SIZE].cameras[0]
    seed = f"next station/{hidden}"
    effects = [(hidden, draw_effect(hidden, strength, camera, seed))]
    generate_campaign(folder / "campaign", folder / "truth", effects, seed, SIZE, CAMERA, stations=stations)
    observe_camera(folder / "campaign", CAMERA, folder / "observed" / CAMERA)
    return observed_cases(folder / "observed")[0]


def station_of(capture):
    """Return the (height_m, tilt_deg) of a capture, as they are in its name."""
    _, height, tilt, _ = capture.view.capture.rsplit("_", 3)
    return int(height[1:]) / 100, int(tilt[1:])


class Rivals:
    """A hidden effect and its rival, each fitted to some captures as the verdict's first step has them."""

    def __init__(self, case, pair):
        self.case, self.pair = case, pair
        search = Search(case, list(pair))
        self.base = search.fitted([])
        self.candidates = rank(search.try_effect(self.base, name) for name in pair)

    @property
    def are_told_apart(self):
        """Whether the first step is the hidden effect, its rival not confused with it."""
        best = self.candidates[0]
        if best.effect != self.pair[0] or not is_missing(best, self.base.excess, LITTLE):
            return False
        return self.pair[1] not in confused_with(self.case, best, self.candidates)

    def suggested(self):
        """Return the station where they are to be told apart."""
        found = suggested_station(self.case, *(list(c.twin.effects) for c in self.candidates))
        return found["height_m"], int(found["tilt_deg"])


def captures_needed(pool, pair, start, choose, most):
    """Return how many captures beyond the first were taken until the effects were told apart; ``most`` + 1 where they never were.

    start  the stations of the first captures; choose  function (Rivals, stations that are left) -> station
    """
    left = list(pool.captures)
    taken = [left.pop(k) for k in reversed(range(len(left))) if station_of(left[k]) in start]
    rivals = Rivals(replace(pool, captures=taken), pair)
    for number in range(1, most + 1):
        where = choose(rivals, sorted({station_of(c) for c in left}))
        taken.append(left.pop(next(k for k, c in enumerate(left) if station_of(c) == where)))
        rivals = Rivals(replace(pool, captures=taken), pair)
        if rivals.are_told_apart:
            return number
    return most + 1


def random_choice(pair, run):
    """Return the choice of a station at random, seeded by the pair and the run."""
    rng = nominal.rng_of("random stations", *pair, run)
    return lambda rivals, left: left[rng.integers(len(left))]


def measure(hidden, rival, strength, start, scratch, runs, most):
    """Return (captures needed where suggested, at random (runs,)) of a pair; None where the first captures tell."""
    pair = hidden, rival
    first = measured(scratch / "first", hidden, strength, start)
    if Rivals(first, pair).are_told_apart:
        return None
    pool = measured(scratch / "all", hidden, strength, STATIONS)
    by_suggestion = captures_needed(pool, pair, start, lambda rivals, left: rivals.suggested(), most)
    at_random = [captures_needed(pool, pair, start, random_choice(pair, run), most) for run in range(runs)]
    return by_suggestion, at_random


def main():
    """Read the command line, measure, print a table and record the figures."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--runs", type=int, default=3, help="how many times stations are taken at random")
    parser.add_argument("--most", type=int, default=5, help="captures after which it is given up")
    a = parser.parse_args()
    cv2.setNumThreads(1)
    told, untold = [], []
    with tempfile.TemporaryDirectory() as scratch:
        for k, pair in enumerate(tqdm(PAIRS, desc="pairs", unit="pair")):
            outcome = measure(*pair, Path(scratch) / str(k), a.runs, a.most)
            if outcome:
                row = [*pair[:2], *outcome]
                (told if min(outcome[0], *outcome[1]) <= a.most else untold).append(row)
                print(row, flush=True)
    print(tabulate(told + untold, ["hidden", "rival", "suggested", "at random"], tablefmt="github"))
    by_suggestion = sum(row[2] for row in told)
    at_random = sum(np.mean(row[3]) for row in told)
    pairs = f"of {len(told)} pairs; {len(untold)} more told neither way by {a.most}"
    record(
        [
            ("next station: captures until the first name is right, where suggested", by_suggestion / len(told), pairs),
            ("next station: captures until the first name is right, at random", at_random / len(told), pairs),
            ("next station: suggested over random", by_suggestion / at_random, "of the captures"),
        ]
    )


if __name__ == "__main__":
    main()
