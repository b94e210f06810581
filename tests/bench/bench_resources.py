"""What jobs take: ``python tests/bench/bench_resources.py results/frame`` writes config/resources.csv from a finished run.

Snakemake's own measurements of each job, results/NAME/benchmarks/, become a row a rule: the largest memory of its jobs
(``mem_mb``), and the largest CPU time a capture (``capture_s``); of a job of all cameras, of all their captures. CPU time:
on a busy machine the clock says more about the others. Rules that a run lacks keep their row.
"""

import argparse
import math
import sys
from pathlib import Path

ROOT = Path(__file__).resolve().parents[2]
sys.path.insert(0, str(ROOT / "scripts"))

import pandas as pd

import job

TABLE = ROOT / "config/resources.csv"
NOTEBOOKS = "run_notebook"  # all notebooks' rules ask for what the largest one takes
STEP_MB = 50


def measured(results):
    """Return a table by rule of a run's folder: mem_mb, capture_s."""
    counts = pd.read_csv(results / "expand/captures.csv").camera.value_counts().to_dict()
    rows = []
    for path in sorted((results / "benchmarks").rglob("*.tsv")):
        rule = path.relative_to(results / "benchmarks").parts[0].removesuffix(".tsv")
        rule = NOTEBOOKS if rule.startswith("run_") else rule
        mine = [n for camera, n in counts.items() if path.stem == camera or path.stem.startswith(f"{camera}_")]
        last = pd.read_csv(path, sep="\t", na_values="-").iloc[-1]
        captures = mine[0] if mine and path.parent.name == rule else sum(counts.values())
        rows.append([rule, last.max_rss, last.cpu_time / captures])
    table = pd.DataFrame(rows, columns=["rule", "mem_mb", "capture_s"]).groupby("rule").max()
    table["mem_mb"] = [STEP_MB * math.ceil(m / STEP_MB) for m in table.mem_mb.fillna(0)]
    return table


def main():
    """Read the command line, renew the table, print it."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("results", type=Path, help="a finished run's folder, such as results/frame")
    results = parser.parse_args().results
    job.set_up_log()
    with job.one_message():
        renew(results)


def renew(results):
    """Write the table anew with what a run's folder has, and print it."""
    new = measured(results).round(3)
    old = pd.read_csv(TABLE, index_col="rule") if TABLE.is_file() else new.iloc[:0]
    table = new.combine_first(old)[["mem_mb", "capture_s"]].sort_index().astype({"mem_mb": int})
    with job.write_atomically(TABLE) as file:
        table.to_csv(file, lineterminator="\n")
    print(table.to_markdown())


if __name__ == "__main__":
    main()
