"""Measure and write docs/benchmarks.md: ``python tests/bench/run_benchmarks.py [NAME ...]``; without a name all.

NAMEs are those of the files, such as ``geometry`` of bench_geometry.py, and ``blind_trials``. Each prints its tables and
puts its figures into docs/benchmarks.csv (record.py), from which the page is written.
"""

import argparse
import subprocess
import sys
from pathlib import Path

import pandas as pd

from record import ROOT, as_text, record, write_page

HERE = Path(__file__).resolve().parent
SCRIPTS = [
    "size", "growth", "geometry", "render", "repeatability", "diagnose", "whole_cameras", "score_test", "bounds",
    "calibration", "detectors", "moving", "hard_images", "marker_types", "next_station", "board_cells", "floors",
    "photographs", "real_boards", "turned_boards", "hand_motion",
]  # fmt: skip
BLIND_TRIALS = "blind_trials"
TRIALS = ROOT / "results/blind_trials"
TRIAL_COUNTS = "single: 174, pair: 60, none: 200, outside: 60, power: 87, whole: 60"
PHOTOGRAPHS = "../shared/real"
OF_PHOTOGRAPHS = ("photographs", "real_boards", "turned_boards", "hand_motion")
REAL_COUNTS = f", real: 200, photographs: {PHOTOGRAPHS}"
TRIALS_COMMAND = "snakemake --cores 2 blind_trials"
WEAK = "0.25"  # the strength, a column of power.csv


def run_script(name):
    """Run a benchmark; return whether it failed."""
    return subprocess.run([sys.executable, str(HERE / f"bench_{name}.py")], check=False).returncode != 0


def trial_counts(project=ROOT):
    """Return how many blind trials of each kind to run, those on real photographs only where these lie beside the project."""
    if (project / PHOTOGRAPHS).is_dir():
        return f"blind_trials={{{TRIAL_COUNTS}{REAL_COUNTS}}}"
    print(f"no trials on real photographs: there is no {PHOTOGRAPHS}", flush=True)
    return f"blind_trials={{{TRIAL_COUNTS}}}"


def run_blind_trials():
    """Run the blind trials and record their outcome; return whether they failed."""
    arguments = ["-m", "snakemake", "--quiet", "all", "--cores", "2", "blind_trials", "--config", trial_counts()]
    if subprocess.run([sys.executable, *arguments], cwd=ROOT, check=False).returncode != 0:
        return True
    print((TRIALS / "summary.md").read_text())
    record(trial_figures(TRIALS), TRIALS_COMMAND)
    return False


def summary_figure(row):
    """Return (what, figure, unit) of a row of a summary: a share as its counts, else its value; with its interval if it has one."""
    if pd.notna(row.hits):
        return row.what, f"{row.hits:.0f} of {row.number} ({row.low:.0f} to {row.high:.0f} %)", ""
    interval = "" if pd.isna(row.low) else f" ({as_text(row.low)} to {as_text(row.high)})"
    return row.what, as_text(row.value) + interval, row.unit


def trial_figures(folder):
    """Return [(what, figure, unit)] of an outcome's summary.csv and power.csv (scripts/trials/summarise_trials.py)."""
    figures = [summary_figure(row) for row in pd.read_csv(folder / "summary.csv").itertuples()]
    power = pd.read_csv(folder / "power.csv")
    if WEAK in power:
        figures.append(
            ("a quarter of the clear strength: named alone", f"{(power[WEAK] == 1).sum()} of {len(power)}", "")
        )
    return figures


def main(argv=None):
    """Run what is named; exit with 1 where any failed."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    known = [*SCRIPTS, BLIND_TRIALS]
    parser.add_argument("names", nargs="*", metavar="NAME", help=", ".join(known))
    names = parser.parse_args(argv).names
    for name in names:
        if name not in known:
            parser.error(f"no benchmark is called {name}; there are {', '.join(known)}")
    failed = []
    for name in names or known:
        print(f"\n## {name}\n", flush=True)
        if name in OF_PHOTOGRAPHS and not (ROOT / PHOTOGRAPHS).is_dir():
            print(f"left out: there is no {PHOTOGRAPHS}", flush=True)
            continue
        if run_blind_trials() if name == BLIND_TRIALS else run_script(name):
            failed.append(name)
    write_page()
    if failed:
        sys.exit(f"failed: {', '.join(failed)}")


if __name__ == "__main__":
    main()
