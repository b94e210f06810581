"""Real photographs turned round tell of the same camera: ``python tests/bench/bench_turned_boards.py [SET ...]``.

Each board set of ../shared/real is diagnosed by its points as it is, and once more with every photograph turned by 180 degrees
(turned_board.py): the same moves of points are to be named (or one that these captures cannot tell from it), principal point and
tangential terms with other signs. Nothing of the truth need be known. Figures are recorded (record.py) where all sets are done.
"""

import argparse
import logging
import os
import sys
import tempfile
from pathlib import Path

os.environ["OPENBLAS_NUM_THREADS"] = "1"  # before numpy is loaded: threads cost small matrices more than they bring
ROOT = Path(__file__).resolve().parents[2]
sys.path[:0] = [str(ROOT / "scripts"), str(ROOT / "tests"), str(ROOT / "tests/bench")]

from bench_real_boards import REAL, board_sets, measured_points, told_by_points  # noqa: E402
from inputs.campaign import load_campaign  # noqa: E402
from record import record  # noqa: E402
from rig.errors import InputError  # noqa: E402
from turned_board import off_in_errors, turned_round  # noqa: E402


def steps_of(campaign, folder):
    """Return the steps of the verdict's record that points of a board's only camera give; ``folder`` is for what is measured.

    Raises InputError or ValueError where a campaign's photographs are refused.
    """
    (camera,) = load_campaign(campaign).captures.camera.unique()
    _, case = measured_points(campaign, camera, folder)
    *_, result = told_by_points(case)
    return result["steps"]


def named_alike(before, after):
    """Return whether two verdicts' steps name the same effects, in any order, or ones that the captures cannot tell from them."""
    groups = [[{s["effect"], *(s.get("one_of") or ())} for s in steps] for steps in (before, after)]
    return len(before) == len(after) and all(any(a & b for b in groups[1]) for a in groups[0])


def main(argv=None):
    """Read the command line, diagnose, record."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("names", nargs="*", metavar="SET")
    given = parser.parse_args(argv).names
    if not REAL.is_dir():
        raise SystemExit(f"needs the photographs of {REAL}")
    logging.disable()
    alike, off = [], []
    for name in given or board_sets():
        with tempfile.TemporaryDirectory() as folder:
            folder = Path(folder)
            try:
                before = steps_of(REAL / name, folder / "as it is")
            except (InputError, ValueError) as why:  # what is taken must be taken turned as well
                print(f"{name}: refused ({why})", flush=True)
                continue
            after = steps_of(turned_round(REAL / name, folder / "turned"), folder / "of turned")
        alike.append(named_alike(before, after))
        off.append(off_in_errors(before, after))
        names = [", ".join(step["effect"] for step in steps) or "nothing" for steps in (before, after)]
        print(f"{name}: {names[0]}; turned {names[1]}; {off[-1]:.2f} standard errors off", flush=True)
    if not given:
        record([
            ("board sets turned round: the same effects are named", f"{sum(alike)} of {len(alike)}", "sets"),
            ("board sets turned round: values off", f"{sorted(off)[len(off) // 2]:.2f}", f"standard errors in the median set, {max(off):.2f} in the farthest"),
        ])  # fmt: skip


if __name__ == "__main__":
    main()
