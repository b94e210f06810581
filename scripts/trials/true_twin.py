"""Fit the twin that has a trial's true effects, and say which of them count as hidden:
python scripts/trials/true_twin.py OBSERVED --truth FILE --out FILE.

OBSERVED is what observe_trial.py wrote. An effect counts where taking it out of that twin, all others fitted again,
raises the held-out gap of some group of observables, or of the poses, by ``MIN_RISE``; nobody can be asked to name the
rest.
"""

import argparse
import json
import logging
import os
import sys
from dataclasses import asdict, dataclass
from pathlib import Path

sys.path.insert(0, str(Path(__file__).resolve().parents[1]))
os.environ["OPENBLAS_NUM_THREADS"] = "1"  # before numpy is loaded: threads cost small matrices more than they bring

import cv2
import numpy as np

import job
from gap.fit.residuals import RHO_NOISE, rho
from gap.fit.score import group_gaps
from gap.select.search import Search
from trials.observe_trial import observed_cases

MIN_RISE = 0.02  # of a group's gap


@dataclass
class TrueTwin:
    """The twin with the true effects, fitted: its held-out ``gap`` and ``groups`` (units of ``floor``), which effects count.

    ``without`` has for each effect the groups' gaps of the twin that lacks it, in the same floors. ``gap`` is None
    and no effect counts where nothing could be held out.
    """

    effects: list
    gap: float | None
    groups: dict
    floor: dict
    counted: list
    uncounted: list
    without: dict


def true_twin(search, names):
    """Return the TrueTwin of a search.Search and the names of what is truly hidden.

    Names that no effect of the library has are left out.
    """
    names = [name for name in names if name in search.candidates]
    if search.why_unusable():
        return TrueTwin([], None, {}, {}, [], names, {})
    twin = search.fitted([])
    while left := [name for name in names if name not in twin.names]:
        gains = search.predicted_gains(twin, left)
        twin = search.adopt(search.try_effect(twin, max(left, key=gains.get)))
    groups = gaps_of(twin.groups, twin.floors)
    without = {
        name: gaps_of(search.fitted([e for e in twin.effects if e[0] != name], twin.poses).groups, twin.floors)
        for name in names
    }
    counted = [name for name in names if rises(groups, without[name])]
    uncounted = [name for name in names if name not in counted]
    return TrueTwin([[n, p] for n, p in twin.effects], twin.gap, groups, twin.floors, counted, uncounted, without)


def gaps_of(groups, floor):
    """Return {group: gap} of residual groups, the poses' too: only they show that a mount is off, as the plates follow."""
    poses = [g["pose"].ravel() for g in groups.values() if "pose" in g]
    gaps = group_gaps(groups, floor)
    return gaps | {"pose": float(np.sqrt(rho(np.concatenate(poses)).mean() / RHO_NOISE))} if poses else gaps


def rises(groups, without):
    """Return whether some group's gap is larger by ``MIN_RISE`` in ``without``; both are {group: gap} in the same floors."""
    return any(without[name] > (1 + MIN_RISE) * gap for name, gap in groups.items() if name in without)


def main():
    """Read the command line."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("observed")
    parser.add_argument("--truth", required=True, help="truth.json of the trial")
    parser.add_argument("--out", required=True)
    arguments = parser.parse_args()
    cv2.setNumThreads(1)
    logging.getLogger("twingap").setLevel(logging.WARNING)
    names = [e["effect"] for e in json.loads(Path(arguments.truth).read_text())["effects"]]
    with job.one_message():
        twins = {case.camera: asdict(true_twin(Search(case), names)) for case in observed_cases(arguments.observed)}
        with job.write_atomically(arguments.out) as file:
            json.dump(job.clean(twins), file, indent=1)


if __name__ == "__main__":
    main()
