"""Repeatability and cost of the whole workflow: ``python tests/bench/bench_repeatability.py [--tiny]``.

Two full rebuilds in two copies of the project, with ``--cores 1`` and ``--cores 2``, have to give the same bytes in
every file that holds numbers and no times. Then, in the second copy, the seconds of a rebuild after a detector's edit
and of a run with nothing to do. Of the embedded campaign, or with ``--tiny`` of one that takes a minute. Figures are recorded
(record.py).
"""

import argparse
import sys
import tempfile
import time
from pathlib import Path

ROOT = Path(__file__).resolve().parents[2]
sys.path[:0] = [str(ROOT / "scripts"), str(ROOT / "tests")]

import pandas as pd

from record import record
from tiny_campaign import write_seen_campaign
from workflow_runs import copy_project, numbers_of, snakemake

LONGEST_S = 7200
DETECTOR = "scripts/detectors/aruco_subpix.py"
EDITED, NOTHING_TO_DO = "--cores 2, after a detector's edit", "--cores 2, nothing to do"


def timed(project, cores, config):
    """Run snakemake in a copy of the project and return its seconds; ends the program where the run fails."""
    start = time.perf_counter()
    status, said = snakemake(project, "--cores", cores, "--config", *config, timeout_s=LONGEST_S)
    if status:
        sys.exit(said[-5000:])
    return time.perf_counter() - start


def differing(first, second):
    """Return the sorted names of files that are not the same, or not there, on one of two sides."""
    return sorted(name for name in first.keys() | second.keys() if first.get(name) != second.get(name))


def measure(folder, campaign, more):
    """Print both tables; return how many files differed."""
    config, name = [f"campaign={campaign}", *more], campaign.name
    one, two = copy_project(folder / "one"), copy_project(folder / "two")
    seconds = {"full rebuild, --cores 1": timed(one, 1, config), "full rebuild, --cores 2": timed(two, 2, config)}
    first, second = (numbers_of(project / "results" / name) for project in (one, two))
    different = differing(first, second)
    rows = [
        [room, sum(n.split("/")[0] == room for n in first), sum(n.split("/")[0] == room for n in different)]
        for room in sorted({n.split("/")[0] for n in first | second})
    ]
    print(pd.DataFrame(rows, columns=["results/" + name, "files", "that differ"]).to_markdown(index=False))
    for file in different:
        print(f"- differs: {file}")
    edited = two / DETECTOR
    edited.write_text(edited.read_text().replace('"""', '"""Edited. ', 1))
    seconds[EDITED] = timed(two, 2, config)
    if differing(second, numbers_of(two / "results" / name)):
        sys.exit("a detector's edit in a comment changed a number")
    seconds[NOTHING_TO_DO] = timed(two, 2, config)
    full = seconds["full rebuild, --cores 2"]
    table = pd.DataFrame([[what, s, s / full] for what, s in seconds.items()], columns=["run", "s", "of the full one"])
    print("\n" + table.round(3).to_markdown(index=False), flush=True)
    files = f"{len(different)} of {len(first.keys() | second.keys())}"
    record(
        [
            ("two full rebuilds, --cores 1 and --cores 2: files with numbers that differ", files, "files"),
            ("full rebuild, --cores 2", full / 60, "min"),
            ("a detector's edit to the new report", seconds[EDITED] / full, "of a full rebuild"),
            ("a run with nothing to do", seconds[NOTHING_TO_DO], "s"),
            *bart_beside_aruco(two / "results" / name),
        ]
    )
    return len(different)


def bart_beside_aruco(results):
    """Return figures of Table 2: a camera's value by BART, and by ArUco in brackets; none where one is missing."""
    table = pd.read_csv(results / "tables/table2.csv").set_index(["algorithm", "camera"])
    if not {"aruco", "bart"} <= set(table.index.get_level_values("algorithm")):
        return []
    bart, aruco = table.loc["bart"], table.loc["aruco"]

    def cameras(column):
        return ", ".join(f"{c} {bart[column][c]:.1f} ({aruco[column][c]:.1f})" for c in bart.index)

    false_ids = f"{bart.false_ids.sum():.0f} ({aruco.false_ids.sum():.0f})"
    return [
        ("Table 2, coverage by BART (ArUco)", cameras("coverage_pct"), "%"),
        ("Table 2, precision by BART (ArUco)", cameras("precision_pct"), "%"),
        ("Table 2, false ids by BART (ArUco)", false_ids, "markers"),
    ]


def main():
    """Read the command line and measure."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--tiny", action="store_true", help="a tiny campaign and one candidate effect")
    tiny = parser.parse_args().tiny
    with tempfile.TemporaryDirectory() as folder:
        folder = Path(folder)
        campaign = write_seen_campaign(folder / "tiny") if tiny else ROOT / "data/raw/frame"
        sys.exit(1 if measure(folder, campaign, ["diagnose={candidates: [lens_blur]}"] if tiny else []) else 0)


if __name__ == "__main__":
    main()
