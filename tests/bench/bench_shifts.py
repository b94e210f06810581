"""Where each detector puts corners: ``python tests/bench/bench_shifts.py`` writes the table of docs/detectors.md.

Exact, noise-free images of one marker at a time, as the ideal twin shows it: VIEWS places and turns, seen nearly straight on
and obliquely. What corners are off by is taken apart into a constant shift, a move outward and the scatter of the rest.
"""

import re
import sys
from pathlib import Path

ROOT = Path(__file__).resolve().parents[2]
sys.path.insert(0, str(ROOT / "scripts"))

import numpy as np

from detectors import contract
from id_study.views import study_image, study_marker, study_scene, study_views
from markers.contract import count_of, marker_corners_world
from rig.geometry import project

PAGE = ROOT / "docs/detectors.md"
PLACE = re.compile(r"(?<=<!-- shifts -->\n).*?(?=<!-- end of shifts -->)", re.DOTALL)
VIEWS = 40
BOARDS = ("CHARUCO_4X4_75_DICT_4X4_50", "GRID_3X3_20_DICT_4X4_50", "CIRCLES_4X7_60")
FAMILIES = ("DICT_5X5_1000", "DICT_4X4_50", "DICT_APRILTAG_36h11", "tagStandard41h12", "STAG_HD21", *BOARDS)
FEWEST = 6  # ids of a family that are shown in turn, where it has as many
MIN_SIDE_PX = 20  # of a marker that counts: smaller ones tell of the search, not of a convention


def offsets_of(detector, family):
    """Return (what corners are off by (n, 4, 2) px, directions outward (n, 4, 2), views that count)."""
    off, outward, count = [], [], 0
    for number, view in enumerate(study_views(VIEWS)):
        marker = number % min(FEWEST, count_of(family))
        corners = project(view.K, view.T_cam_world, marker_corners_world(study_marker(family, marker)))
        if np.linalg.norm(corners - np.roll(corners, 1, axis=0), axis=1).min() < MIN_SIDE_PX:
            continue
        count += 1
        image = study_image(study_scene(family, marker), view, 0.0)
        mine = [d for d in detector.detect(image) if (d.dictionary, d.id) == (family, marker)]
        if mine:
            off.append(mine[0].corners - corners)
            away = corners - corners.mean(axis=0)
            outward.append(away / np.linalg.norm(away, axis=1, keepdims=True))
    return np.reshape(off, (-1, 4, 2)), np.reshape(outward, (-1, 4, 2)), count


def row_of(name, family):
    """Return a line of the table; None where the detector does not read the family."""
    if not contract.reads(name, family):
        return None
    off, outward, count = offsets_of(contract.make(name, [family]), family)
    if not len(off):
        return f"| `{name}` | {family} | 0 of {count} | | | |"
    shift = np.median(off.reshape(-1, 2), axis=0)
    out = np.median((off * outward).sum(axis=-1))
    rest = off - shift - out * outward
    scatter = 1.4826 * np.median(np.abs(rest))
    return f"| `{name}` | {family} | {len(off)} of {count} | {shift[0]:+.2f}, {shift[1]:+.2f} | {out:+.2f} | {scatter:.2f} |"


def table():
    """Return the table in Markdown."""
    lines = [
        "| detector | family | read | shift right, down, px | outward, px | scatter, px |",
        "|---|---|---|---|---|---|",
    ]
    rows = [row_of(name, family) for name in contract.available() for family in FAMILIES]
    return "\n".join([*lines, *filter(None, rows)]) + "\n"


if __name__ == "__main__":
    made = table()
    print(made)
    PAGE.write_text(PLACE.sub(lambda _: made, PAGE.read_text()))
