"""The workflow through Slurm: ``python tests/bench/bench_slurm.py [--tiny] [--local FOLDER]``; `make bench-slurm` sets up
what it needs.

Two runs in two copies of the project, one on this machine alone, one with profiles/slurm through the sbatch of a Slurm of
one node (slurm_node.py), have to give the same bytes in every file that holds numbers and no times. Of the embedded
campaign, or with ``--tiny`` of one that takes minutes; ``--local`` takes a results folder of a run that was made before in
the place of the first. Figures are recorded (record.py).
"""

import argparse
import re
import subprocess
import sys
import tempfile
import time
from pathlib import Path

ROOT = Path(__file__).resolve().parents[2]
sys.path[:0] = [str(ROOT / "scripts"), str(ROOT / "tests")]

import slurm_node
from record import record
from tiny_campaign import write_seen_campaign
from workflow_runs import copy_project, numbers_of, snakemake

LONGEST_S = 7200
TINY = ["diagnose={candidates: [lens_blur]}"]


def run_here(project, config):
    """Run snakemake on this machine in a copy of the project; return its seconds; end the program where it fails."""
    start = time.perf_counter()
    status, said = snakemake(project, "--cores", 2, "--config", *config, timeout_s=LONGEST_S)
    if status:
        sys.exit(said[-5000:])
    return time.perf_counter() - start


def run_by_slurm(project, config, environment, log):
    """Run snakemake with profiles/slurm in a copy of the project; return (seconds, jobs that sbatch took).

    environment that talks to Slurm; log is the file for all that is said.
    """
    command = [sys.executable, "-m", "snakemake", "--profile", "profiles/slurm", "--config", *config]
    start = time.perf_counter()
    with open(log, "w") as file:
        done = subprocess.run(
            command, cwd=project, env=environment, stdout=file, stderr=file, timeout=LONGEST_S, check=False
        )
    said = log.read_text()
    if done.returncode:
        sys.exit(said[-8000:])
    return time.perf_counter() - start, len(re.findall(r"submitted with SLURM jobid", said))


def differing(first, second):
    """Return the sorted names of files that are not the same, or not there, on one of two sides."""
    return sorted(name for name in first.keys() | second.keys() if first.get(name) != second.get(name))


def main():
    """Read the command line, run both, compare."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--tiny", action="store_true", help="a tiny campaign and one candidate effect")
    parser.add_argument("--local", type=Path, metavar="FOLDER", help="results/NAME of a run on this machine")
    options = parser.parse_args()
    missing = slurm_node.missing_programs()
    if missing:
        sys.exit(
            f"error: {', '.join(missing)}: not installed; `make bench-slurm` installs Debian's slurm-wlm and munge"
        )
    with tempfile.TemporaryDirectory() as folder:
        folder = Path(folder)
        campaign = write_seen_campaign(folder / "tiny") if options.tiny else ROOT / "data/raw/frame"
        config = [f"campaign={campaign}", *(TINY if options.tiny else [])]
        here, there = folder / "here", copy_project(folder / "there")
        if options.local:
            reference = options.local
        else:
            print(f"on this machine: {run_here(copy_project(here), config) / 60:.1f} min", flush=True)
            reference = here / "results" / campaign.name
        with slurm_node.running(folder / "slurm") as environment:
            seconds, jobs = run_by_slurm(there, config, environment, folder / "slurm.log")
        first, second = numbers_of(reference), numbers_of(there / "results" / campaign.name)
    different = differing(first, second)
    for file in different:
        print(f"- differs: {file}")
    files = f"{len(different)} of {len(first.keys() | second.keys())}"
    print(f"through Slurm: {jobs} jobs by sbatch, {seconds / 60:.1f} min; {files} files with numbers differ")
    record(
        [
            ("a run through Slurm and one without: files with numbers that differ", files, "files"),
            ("a run through Slurm: jobs that sbatch took", jobs, "jobs"),
            ("a run through Slurm on one node of this machine's cores", seconds / 60, "min"),
        ],
        "make bench-slurm" + (" TINY=--tiny" if options.tiny else ""),
    )
    sys.exit(1 if different or not jobs else 0)


if __name__ == "__main__":
    main()
