"""How far off are points of photographs that moved while they were read? ``python tests/bench/bench_hand_motion.py [SET ...]``.

The twin of each real set is fitted to some of its photographs; every other point of the rest tells pose and motion, or the pose
alone, and the points between say how far these lead. Figures are recorded (record.py).
"""

import argparse
import sys
import tempfile
from dataclasses import replace
from pathlib import Path

ROOT = Path(__file__).resolve().parents[2]
sys.path[:0] = [str(ROOT / "scripts"), str(ROOT / "tests"), str(ROOT / "tests/bench")]

import numpy as np  # noqa: E402

from bench_real_boards import REAL, measured_points, told_by_points  # noqa: E402
from inputs.campaign import load_campaign  # noqa: E402
from record import record  # noqa: E402
from rig.geometry import N_POSE  # noqa: E402

BY_HAND = ("chess_lifecam_1280", "charuco_lifecam_1280_old_pattern")


def off_between_px(problem, twin, indices):
    """Return the RMS length, pixels, of how far the points between those that tell the poses of some captures lie off."""
    halves, between = [], {}
    for i, capture in enumerate(problem.captures):
        seen = capture.observation.measured.copy()
        between[i] = np.flatnonzero(seen)[1::2]
        seen[between[i]] = False
        halves.append(replace(capture, observation=replace(capture.observation, measured=seen)))
    effects, told = list(twin.effects), replace(problem, captures=halves)
    poses, _ = told.solver().score(effects, twin.poses[:, : len(problem.sigma_pose)], indices)
    off = [
        (problem.captures[i].observation.features - problem.corners_of(problem.captures[i], effects, poses[i])[:, 0])[
            at
        ]
        for i, at in between.items()
        if i in indices
    ]
    return float(np.sqrt((np.concatenate(off) ** 2).sum(1).mean()))


def main(argv=None):
    """Read the command line and measure."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("sets", nargs="*", metavar="SET", default=BY_HAND)
    given, words = parser.parse_args(argv), []
    if not REAL.is_dir():
        raise SystemExit(f"needs the photographs of {REAL}")
    for name in given.sets:
        (camera,) = load_campaign(REAL / name).captures.camera.unique()
        with tempfile.TemporaryDirectory() as folder:
            _, case = measured_points(REAL / name, camera, Path(folder))
        _, search, _, outcome, _ = told_by_points(case)
        moving = search.problem
        if moving.gap_at_rest is None:
            print(f"{name}: at rest")
            continue
        still = replace(moving, sigma_pose=moving.sigma_pose[:N_POSE])
        off = [off_between_px(problem, outcome.twin, search.test) for problem in (still, moving)]
        words.append(f"{name} {off[1]:.2f} (without motion {off[0]:.2f})")
        print(f"{name}: {off[1]:.3f} px off, {off[0]:.3f} without motion")
    record([("photographs that moved while read: points that did not tell the pose, off", ", ".join(words), "px")])


if __name__ == "__main__":
    main()
