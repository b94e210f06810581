"""How plan, run and disk grow with captures: ``python tests/bench/bench_growth.py [--plan-only] [N ...]``.

Campaigns of tiny images that show no marker, a hundredth of their captures at stations of their own and the others repeats
of these. Planned by ``snakemake -n``; run to Tables 1 and 2, without a diagnosis, whose time is the search's and not the
captures'. Seconds are of CPU time, all processes of a run together: other programs do not count. Writes docs/growth.png and
records the figures (record.py).
"""

import argparse
import subprocess
import sys
import tempfile
from pathlib import Path

ROOT = Path(__file__).resolve().parents[2]
sys.path[:0] = [str(ROOT / "scripts"), str(ROOT / "tests")]

import cv2
import numpy as np
import pandas as pd

from record import TABLE, read_figures, record
from tiny_campaign import HEIGHT, WIDTH, write_campaign
from workflow_runs import copy_project, detectors

COUNTS = (100, 1_000, 10_000, 50_000)
MAX_RUN = 10_000
LONGEST_S = 20_000
TRIALS = 100
TABLES = ["results/tiny/tables/table1.csv", "results/tiny/tables/table2.csv"]
CONFIG = [detectors(aruco={}), "render={edge_samples: 16}"]
COMMAND = "python tests/bench/bench_growth.py"
PICTURE = ROOT / "docs/growth.png"


def write_large_campaign(folder, count):
    """Write a campaign of ``count`` captures by one camera to ``folder`` and return it; no two images are the same."""
    rows = ["capture,camera,height_m,tilt_deg,trial,image\n"]
    for k in range(count):
        height_m = 0.3 + 0.0001 * (k // TRIALS)
        rows.append(f"c{k:06d},left,{height_m:.4f},45,{k % TRIALS},images/left/{k:06d}.png\n")
    write_campaign(folder, only_left, captures="".join(rows))
    for path in (folder / "images").rglob("*.png"):
        path.unlink()
    rng = np.random.default_rng(1)
    for k in range(count):
        pixels = rng.integers(80, 120, (HEIGHT, WIDTH), dtype=np.uint8)
        cv2.imwrite(str(folder / f"images/left/{k:06d}.png"), pixels)
    return folder


def only_left(data):
    """Take the other camera out of the plain data of campaign.yaml."""
    del data["cameras"]["right"]


def measured(command, cwd):
    """Run a command in a process that measures it; return (CPU seconds, GiB of its largest process)."""
    code = (
        "import resource, subprocess, sys; "
        "done = subprocess.run(sys.argv[1:], stdout=subprocess.DEVNULL, stderr=subprocess.PIPE, text=True); "
        "used = resource.getrusage(resource.RUSAGE_CHILDREN); "
        "print(used.ru_utime + used.ru_stime, used.ru_maxrss / 2**20); "
        "sys.exit(done.stderr[-3000:] if done.returncode else 0)"
    )
    done = subprocess.run(
        [sys.executable, "-c", code, *command], cwd=cwd, capture_output=True, text=True, timeout=LONGEST_S, check=False
    )
    if done.returncode:
        sys.exit(done.stderr)
    return tuple(map(float, done.stdout.split()))


def disk_mib(folder):
    """Return what the files of a folder take, MiB."""
    return sum(path.stat().st_size for path in Path(folder).rglob("*") if path.is_file()) / 2**20


def measure(count, run):
    """Return [(what, figure, unit)] of a campaign of ``count`` captures; run False: of its plan alone."""
    with tempfile.TemporaryDirectory() as folder:
        project, campaign = copy_project(Path(folder) / "project"), write_large_campaign(Path(folder) / "tiny", count)
        snakemake = [sys.executable, "-m", "snakemake", "--cores", "2"]
        config = ["--config", f"campaign={campaign}", *CONFIG]
        seconds, gib = measured([*snakemake, "-n", "--quiet", "all", *config], project)
        figures = [
            ("so many tiny captures: CPU time of the plan", seconds, "s"),
            ("so many tiny captures: memory of the plan", gib, "GiB"),
        ]
        if run:
            seconds, _ = measured([*snakemake, *TABLES, *config], project)
            figures += [
                ("so many tiny captures: CPU time of a run to the tables", seconds, "s"),
                ("so many tiny captures: results on disk", disk_mib(project / "results/tiny"), "MiB"),
            ]
    return figures


def draw(table, path):
    """Draw the growth of what is in the table of figures to a PNG."""
    import matplotlib

    matplotlib.use("Agg")
    import matplotlib.pyplot as plt
    from matplotlib.ticker import LogLocator, NullFormatter

    mine = table[table.command.str.fullmatch(rf"{COMMAND} \d+")]
    counts = mine.command.str.split().str[-1].astype(int)
    figure, axes = plt.subplots(1, 3, figsize=(11, 3.2), layout="constrained")
    for axis, unit in zip(axes, ("s", "GiB", "MiB"), strict=True):
        for what in mine.what[mine.unit == unit].unique():
            chosen = mine.what == what
            points = pd.DataFrame({"n": counts[chosen], "y": mine.figure[chosen].astype(float)}).sort_values("n")
            axis.loglog(points.n, points.y, "o-", label=what.partition(": ")[2])
        axis.set(xlabel="captures", ylabel=unit, xlim=(counts.min() / 1.5, counts.max() * 1.5))
        axis.yaxis.set_major_locator(LogLocator(subs=(1, 2, 5)))
        axis.yaxis.set_major_formatter("{x:g}")
        axis.yaxis.set_minor_formatter(NullFormatter())
        axis.grid(alpha=0.3)
        if axis.lines:
            axis.legend(fontsize=8)
    figure.savefig(path, dpi=110)


def main():
    """Read the command line, measure, record, draw."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("counts", type=int, nargs="*", metavar="N", help=f"captures; without any {COUNTS}")
    parser.add_argument("--plan-only", action="store_true", help=f"no run; from {MAX_RUN + 1} captures on always so")
    options = parser.parse_args()
    for count in options.counts or COUNTS:
        figures = measure(count, count <= MAX_RUN and not options.plan_only)
        for what, value, unit in figures:
            print(f"{count}: {what}: {value:.3g} {unit}", flush=True)
        record(figures, f"{COMMAND} {count}")
    draw(read_figures(TABLE), PICTURE)


if __name__ == "__main__":
    main()
