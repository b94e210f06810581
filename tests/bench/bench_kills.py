"""A run that is killed goes on: ``python tests/bench/bench_kills.py [--rounds 3] [--pulls 5] [--picture docs/nothing-lost.png]``.

In each round a tiny campaign's run is killed with -9 once in each stage, at a random moment of one of its jobs, and started
anew; `dvc pull` of the embedded campaign is killed as well. In the end all files with numbers have to be, byte for byte, those
of a run that nobody killed in a plainer path, and nothing half written may be left. The seed decides where in a job a kill falls; how
long jobs take is the machine's. Figures are recorded (record.py), the kills drawn on the run's time.
"""

import argparse
import os
import random
import shutil
import signal
import subprocess
import sys
import tempfile
import time
from pathlib import Path

ROOT = Path(__file__).resolve().parents[2]
sys.path[:0] = [str(ROOT / "scripts"), str(ROOT / "tests"), str(ROOT / "tests/bench")]

import yaml

from killed_runs import STAGES, finished, killed
from record import record
from tiny_campaign import write_seen_campaign
from workflow_runs import copy_project, detectors, numbers_of, snakemake

CONFIG = (
    "diagnose={candidates: [lens_blur]}", detectors(aruco={}), "render={edge_samples: 64}",
    "explore={captures: 1}",
)  # fmt: skip
ODD = "Jörg's Röhre, 50 %"  # a path that a careless command would break
PULLED = "data/raw/frame.dvc"


def one_camera(folder):
    """Lay the campaign down with one of its cameras, and return it."""
    campaign = write_seen_campaign(folder)
    table, described = campaign / "captures.csv", campaign / "campaign.yaml"
    table.write_text("".join(line for line in table.read_text().splitlines(keepends=True) if ",right," not in line))
    data = yaml.safe_load(described.read_text())
    del data["cameras"]["right"]
    described.write_text(yaml.safe_dump(data))
    return campaign


def kill_a_round(project, arguments, jobs, rng):
    """Kill a run once in each stage, and let it end; return [(stage, share of its job, whether it was still running)]."""
    kills = []
    for stage in STAGES:
        mine = [(start, end) for name, start, end in jobs if name == stage]
        number, share = rng.randrange(min(2, len(mine))), rng.random()
        start, end = mine[number]
        run, at = killed(project, arguments, stage, number, share * (end - start))
        kills.append((stage, number, share, at is not None))
        print(f"  {stage}, job {number}, at {share:.2f} of it: {'killed' if at else 'had ended'}", flush=True)
        if "LockException" in "".join(run.said):
            sys.exit("a run found a lock where there was none")
        if at is not None:
            status, said = snakemake(project, "--unlock", *arguments)
            if status:
                sys.exit(said[-3000:])
    run = finished(project, *arguments)
    if run.process.returncode:
        sys.exit("".join(run.said)[-3000:])
    return kills


def clone_without_data(folder):
    """Return a clone of the repository that has no captures yet."""
    subprocess.run(["git", "clone", "-q", str(ROOT), str(folder)], check=True)
    return folder


def pull(clone, delay_s=None):
    """Run `dvc pull`, killed after ``delay_s``; return its seconds, or None where it was killed."""
    command = [str(Path(sys.executable).with_name("dvc")), "pull", "--quiet", "--remote", "embedded", PULLED]
    start = time.monotonic()
    process = subprocess.Popen(command, cwd=clone, start_new_session=True)
    try:
        process.wait(delay_s)
    except subprocess.TimeoutExpired:
        os.killpg(process.pid, signal.SIGKILL)
        process.wait()
        return None
    if process.returncode:
        sys.exit(f"dvc pull ended with {process.returncode}")
    return time.monotonic() - start


def kill_pulls(folder, pulls, rng):
    """Kill `dvc pull` at random moments, each in a clone without captures, and fetch the rest; return [share of its time]."""
    clone = clone_without_data(folder / "clone")
    seconds = pull(clone)
    wanted = {p.relative_to(clone): p.read_bytes() for p in (clone / "data/raw/frame").rglob("*") if p.is_file()}
    shares = []
    for number in range(pulls):
        clone = clone_without_data(folder / f"clone {number}")
        share = rng.uniform(0.3, 1)  # before, DVC only starts
        if pull(clone, share * seconds) is None:
            shares.append(share)
        subprocess.run(
            [sys.executable, "scripts/fetch_data.py", PULLED, "--remote", "embedded", "--force"], cwd=clone, check=True
        )
        found = {p.relative_to(clone): p.read_bytes() for p in (clone / "data/raw/frame").rglob("*") if p.is_file()}
        if found != wanted:
            sys.exit(f"a pull that was killed after {share:.2f} of its time left other files")
        print(f"  dvc pull, after {share:.2f} of its time: same {len(found)} files", flush=True)
    return shares


def differing(wanted, got):
    """Return the names of files that are not the same, or not there, on one of two sides."""
    return sorted(name for name in wanted.keys() | got.keys() if wanted.get(name) != got.get(name))


def draw(jobs, kills, path):
    """Draw the jobs of a run that nobody killed on its time, a row a stage, and where kills fell in them."""
    import matplotlib

    matplotlib.use("Agg")
    import matplotlib.pyplot as plt

    figure, axes = plt.subplots(figsize=(9, 2.8), layout="constrained")
    names = list(STAGES)
    for name, start, end in jobs:
        if name in STAGES and end:
            axes.barh(names.index(name), end - start, left=start, height=0.62, color="#9ecae1", edgecolor="white")
    for stage, number, share, alive in kills:
        start, end = sorted((s, e) for name, s, e in jobs if name == stage)[number]
        if alive:
            axes.plot(
                start + share * (end - start), names.index(stage), "x", color="#D55E00", markersize=9, markeredgewidth=2
            )
    axes.set_yticks(range(len(names)), names)
    axes.invert_yaxis()
    axes.set_xlabel("seconds from the run's start")
    axes.set_title(
        f"{sum(k[3] for k in kills)} kills with -9 (crosses) in the jobs of a run: it goes on, with the same tables",
        fontsize=10,
    )
    axes.spines[["top", "right"]].set_visible(False)
    figure.savefig(path, dpi=130, metadata={"Software": None})


def main():
    """Read the command line, kill, compare, record."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--rounds", type=int, default=3, help="runs, each killed once in each of five stages")
    parser.add_argument("--pulls", type=int, default=5)
    parser.add_argument("--seed", default="kills")
    parser.add_argument("--picture", type=Path, default=ROOT / "docs/nothing-lost.png")
    given = parser.parse_args()
    rng, kills, different = random.Random(given.seed), [], set()
    with tempfile.TemporaryDirectory() as folder:
        folder = Path(folder)
        campaign = one_camera(folder / "tiny")
        arguments = ("--cores", 2, "--config", f"campaign={campaign}", *CONFIG)
        whole = copy_project(folder / "whole")
        run = finished(whole, *arguments)
        if run.process.returncode:
            sys.exit("".join(run.said)[-3000:])
        jobs = sorted((j for j in run.jobs.values() if j[0] and j[2]), key=lambda j: j[1])
        wanted = numbers_of(whole / "results/tiny")
        print(f"a run that nobody kills: {max(j[2] for j in jobs):.0f} s, {len(wanted)} files with numbers", flush=True)
        for number in range(given.rounds):
            project = copy_project(folder / f"{ODD} {number}")
            kills += kill_a_round(project, arguments, jobs, rng)
            different |= set(differing(wanted, numbers_of(project / "results/tiny")))
            different |= {str(p) for p in (project / "results").rglob(".unfinished.*")}
            print(f"round {number + 1}: {len(different)} files that differ or are half written so far", flush=True)
            shutil.rmtree(project)
        shares = kill_pulls(folder, given.pulls, rng)
        draw(jobs, kills, given.picture)
    count = sum(k[3] for k in kills) + len(shares)
    for name in sorted(different):
        print(f"- differs: {name}")
    record(
        [
            ("kills with -9 of a run and of `dvc pull`, at random moments of all stages", count, "kills"),
            ("files with numbers that differ after kills from those of a run that nobody killed", f"{len(different)} of {len(wanted)}",
             "files"),
        ]
    )  # fmt: skip
    sys.exit(bool(different))


if __name__ == "__main__":
    main()
