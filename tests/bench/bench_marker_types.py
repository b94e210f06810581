"""Verdicts on rigs of other markers: ``python tests/bench/bench_marker_types.py [--rigs N ...]``.

Photographs of plates of other types with one hidden effect, drawn by OpenCV's warps (tests/marker_photographs.py), against
all effects of the library.
"""

import argparse
import sys
import tempfile
import time
from pathlib import Path

ROOT = Path(__file__).resolve().parents[2]
sys.path[:0] = [str(ROOT / "scripts"), str(ROOT / "tests")]

import cv2
from tabulate import tabulate

from gap.select.select_effects import verdict
from marker_photographs import write_marker_campaign
from record import record
from trials.observe_trial import observe_camera, observed_cases

RIGS = {  # what is recorded: the families of a rig
    "a rig of STag: exactly what is hidden is named": ("STAG_HD21",),
    "a rig of tagStandard41h12: exactly what is hidden is named": ("tagStandard41h12",),
    "a rig of ChArUco boards and circles: exactly what is hidden is named": (
        "CHARUCO_5X4_75_DICT_4X4_50",
        "CIRCLES_3X5_60",
    ),
}
HIDDEN = {"": {}, "radial_distortion": {"k1": -0.05}, "lens_blur": {"blur_px": 0.8}, "marker_scale": {"scale": 1.03}}


def named(families, hidden, folder):
    """Return (verdict, names, gaps before and after, seconds) of a rig of some families with something hidden."""
    campaign = write_marker_campaign(folder / "campaign", families, **hidden)
    observe_camera(campaign, "cam", folder / "observed" / "cam")
    start = time.perf_counter()
    _, base, _, outcome = verdict(observed_cases(folder / "observed")[0])
    names = [step.effect for step in outcome.steps]
    return outcome.verdict, names, f"{base.gap:.2f} to {outcome.twin.gap:.2f}", time.perf_counter() - start


def main():
    """Read the command line, measure, print a table and record the figures."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--rigs", type=int, nargs="*", default=range(len(RIGS)), help="which of RIGS, from 0")
    chosen = [list(RIGS)[k] for k in parser.parse_args().rigs]
    cv2.setNumThreads(1)
    rows, figures = [], []
    for what in chosen:
        for effect, hidden in HIDDEN.items():
            with tempfile.TemporaryDirectory() as scratch:
                said, names, gaps, seconds = named(RIGS[what], hidden, Path(scratch))
            right = names == [effect] if effect else not names
            rig = " and ".join(RIGS[what])
            rows.append([rig, effect or "nothing", said, ", ".join(names), gaps, f"{seconds:.0f}", right])
            print(rows[-1], file=sys.stderr, flush=True)
        of_rig = [row[-1] for row in rows[-len(HIDDEN) :]]
        figures.append((what, f"{sum(of_rig)} of {len(of_rig)}", "verdicts"))
    print(tabulate(rows, ["family", "hidden", "verdict", "named", "gap", "s", "right"], tablefmt="github"))
    record(figures)


if __name__ == "__main__":
    main()
