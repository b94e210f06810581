"""What a full disk does in each stage. Run by bench_mishaps.py within ``unshare -rm``: it mounts a small disk of its own.

    python tests/bench/full_disk.py FOLDER CAMPAIGN STAGE...

A copy of the project lies on a disk of some hundred MiB; when a stage's job begins, a file takes all the room that is left. The run
has to end with one line; when there is room again, the next run has to go on. Prints JSON: {stage: [exit status, lines that say
error, whether there was a traceback, exit status of the next run]}.
"""

import json
import os
import subprocess
import sys
import time
from pathlib import Path

ROOT = Path(__file__).resolve().parents[2]
sys.path[:0] = [str(ROOT / "scripts"), str(ROOT / "tests"), str(ROOT / "tests/bench")]

from killed_runs import watch
from workflow_runs import copy_project, detectors

DISK_MIB = 700
TARGETS = {
    "render": "results/tiny/render/left.json",
    "expose": "results/tiny/twin/left",
    "detect": "results/tiny/detect/left/aruco.csv",
    "diagnose": "results/tiny/diagnosis/left.json",
    "notebooks": "results/tiny/report/overview.html",
}
CONFIG = (
    detectors(aruco={}),
    "diagnose={candidates: [lens_blur]}",
    "render={edge_samples: 16}",
)


def fill(path):
    """Take all the room that the disk has."""
    with open(path, "wb", buffering=0) as file:
        for block in (1 << 20, 1 << 12, 1):
            try:
                while True:
                    file.write(b"\0" * block)
            except OSError:
                pass


def error_lines(said):
    """Return the lines of what a run said that begin with ``error: ``."""
    return [line.strip() for line in said.splitlines() if line.startswith("error: ")]


def main(folder, campaign, *stages):
    """Fill the disk in each stage's first job, free it, go on."""
    disk = Path(folder) / "disk"
    disk.mkdir()
    if subprocess.run(["mount", "-t", "tmpfs", "-o", f"size={DISK_MIB}m", "tmpfs", str(disk)], check=False).returncode:
        sys.exit(77)
    project, filler, told = copy_project(disk / "project"), disk / "filler", {}
    os.environ["PYTHONDONTWRITEBYTECODE"] = "1"
    for stage in stages:
        arguments = (TARGETS[stage], "--cores", 1, "--config", f"campaign={campaign}", *CONFIG)
        run, thread = watch(project, *arguments)
        while run.process.poll() is None and not run.begun(stage):
            time.sleep(0.005)
        fill(filler)
        run.process.wait()
        thread.join(10)
        said = "".join(run.said)
        filler.unlink()
        again, thread = watch(project, *arguments)
        again.process.wait()
        thread.join(10)
        errors = error_lines(said)
        told[stage] = [run.process.returncode, errors, "Traceback" in said, again.process.returncode]
        if "Traceback" in said or again.process.returncode or not errors:
            print(said[-6000:], "".join(again.said)[-3000:], file=sys.stderr)
    print(json.dumps(told))


if __name__ == "__main__":
    main(*sys.argv[1:])
