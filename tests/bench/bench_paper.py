"""The paper at full size: ``python tests/bench/bench_paper.py``, after ``make paper``.

Records (record.py) what its jobs took by Snakemake's own measurements, results/paper/benchmarks/, and puts the study's tables
into docs/paper.md. CPU time does not count other programs on the machine; the clock's time is that of the jobs one after
another, of which a run on two cores does two at once.
"""

import argparse
import sys
from pathlib import Path

ROOT = Path(__file__).resolve().parents[2]
sys.path.insert(0, str(ROOT / "scripts"))

import pandas as pd

import job
from record import record

RESULTS = ROOT / "results/paper"
PAGE = ROOT / "docs/paper.md"
START, END = "<!-- generated: tables -->\n", "<!-- end of generated -->"
STUDY = ("study_twin", "summarise_study")
DETECTOR = "aruco"
# What runs again after an edit of one detector, besides its own jobs.
AFTER_DETECTION = ("aggregate_detections", "make_tables", "run_", "write_provenance", "build_report")


def jobs_of(results):
    """Return a row a job of a finished run: rule, job, seconds of CPU and clock, and memory, MiB."""
    folder = Path(results) / "benchmarks"
    rows = []
    for path in sorted(folder.rglob("*.tsv")):
        rule = path.relative_to(folder).parts[0].removesuffix(".tsv")
        last = pd.read_csv(path, sep="\t", na_values="-").iloc[-1]
        rows.append([rule, path.stem, last.cpu_time, last.s, last.max_rss])
    return pd.DataFrame(rows, columns=["rule", "job", "cpu_s", "wall_s", "mib"])


def figures_of(jobs):
    """Return [(what, figure, unit)] of the jobs of a run with its study."""
    run, study = jobs[~jobs.rule.isin(STUDY)], jobs[jobs.rule.isin(STUDY)]
    detector = jobs.job.str.endswith(f"_{DETECTOR}") & (jobs.rule == "detect_captures")
    again = jobs[detector | jobs.rule.str.startswith(AFTER_DETECTION)]
    return [
        ("the paper at full size, from nothing to the report: CPU time of all jobs", run.cpu_s.sum() / 60, "min"),
        ("the paper at full size, from nothing to the report: jobs one after another", run.wall_s.sum() / 60, "min"),
        ("the paper at full size: memory of its largest job", jobs.mib.max() / 1024, "GiB"),
        ("the paper at full size, after a detector's edit: CPU time of the jobs", again.cpu_s.sum() / 60, "min"),
        ("the paper at full size, after a detector's edit: jobs one after another", again.wall_s.sum() / 60, "min"),
        ("the paper at full size, study of the twins' effects: CPU time", study.cpu_s.sum() / 60, "min"),
    ]


def with_tables(page, tables):
    """Return the text of docs/paper.md with its generated part renewed."""
    head, _, rest = page.partition(START)
    return f"{head}{START}{tables}{END}{rest.partition(END)[2]}"


def main():
    """Read the command line, record the figures, renew the page."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.parse_args()
    job.set_up_log()
    with job.one_message():
        tables = (RESULTS / "study/study.md").read_text(encoding="utf-8")
        figures = figures_of(jobs_of(RESULTS))
        for what, value, unit in figures:
            print(f"{what}: {value:.3g} {unit}")
        record(figures)
        with job.write_atomically(PAGE) as file:
            file.write(with_tables(PAGE.read_text(encoding="utf-8"), tables))


if __name__ == "__main__":
    main()
