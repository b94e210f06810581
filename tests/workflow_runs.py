"""Run the real workflow in a copy of the project, so that tests neither see nor touch anybody's results."""

import contextlib
import json
import re
import shutil
import subprocess
import sys
from pathlib import Path

from detectors import contract

PROJECT = Path(__file__).resolve().parents[1]
PARTS = (
    *("Snakefile", "rules", "scripts", "config", "envs", "profiles", "notebooks", "pyproject.toml"),
    "tests/bench",  # blind trials are rules too
)


def detectors(**wanted):
    """Return the setting of the configuration by which these detectors run, {name: parameters}, and no other."""
    chosen = dict.fromkeys(contract.available(), None) | wanted
    return f"detectors={json.dumps(chosen)}"


def copy_project(folder):
    """Copy what the workflow consists of, without data and results, to ``folder`` and return it."""
    folder.mkdir(parents=True)
    for name in PARTS:
        source = PROJECT / name
        if source.is_dir():
            # with __pycache__: numba would compile for a minute in every copy
            shutil.copytree(source, folder / name, ignore=shutil.ignore_patterns("twins"))
        else:
            shutil.copy(source, folder / name)
    return folder


def snakemake(project, *arguments, timeout_s=600):
    """Run snakemake in ``project``; return (exit status, all that it said)."""
    command = [sys.executable, "-m", "snakemake", *map(str, arguments)]
    done = subprocess.run(command, cwd=project, capture_output=True, text=True, timeout=timeout_s, check=False)
    return done.returncode, done.stdout + done.stderr


def start_snakemake(project, *arguments):
    """Start snakemake in ``project`` as a process group of its own, which can be killed as a whole."""
    command = [sys.executable, "-m", "snakemake", *map(str, arguments)]
    silent = {"stdout": subprocess.DEVNULL, "stderr": subprocess.DEVNULL}
    return subprocess.Popen(command, cwd=project, start_new_session=True, **silent)


def pretend(project, *arguments):
    """Have Snakemake take a run as done: all outputs are there, empty, and their inputs written down; no job runs."""
    status, said = snakemake(project, "--summary", "--forceall", *arguments)
    outputs = [project / path for path in re.findall(r"^(results/\S+)\t", said, re.M)]
    assert status == 0 and outputs, said[-3000:]
    for path in outputs:
        if path.suffix:
            path.parent.mkdir(parents=True, exist_ok=True)
            path.write_text("")
        else:
            path.mkdir(parents=True)
    status, said = snakemake(project, "--cores", 1, "--touch", "--forceall", *arguments)
    assert status == 0, said[-3000:]


def planned(project, *arguments):
    """Return {rule: number of jobs} that a run would start now."""
    status, said = snakemake(project, "-n", "--cores", 2, *arguments)
    assert status == 0, said[-4000:]
    if "Nothing to be done" in said:
        return {}
    table = said.split("Job stats:")[1].split("\n\n")[0]
    return {k: int(n) for k, n in re.findall(r"^(\w+) +(\d+)$", table, re.M) if k not in ("job", "total", "all")}


@contextlib.contextmanager
def edited(path, find, replace):
    """Replace text in a file, for a while."""
    old = path.read_text()
    assert find in old
    path.write_text(old.replace(find, replace, 1))
    try:
        yield
    finally:
        path.write_text(old)


def numbers_of(results):
    """Return {path: bytes} of all files of a run that hold numbers and no times: what a second run has to repeat."""
    folders = ("expand", "register", "twin", "detect", "aggregate", "diagnosis", "tables")
    found = sorted(path for name in folders for path in (results / name).rglob("*") if path.is_file())
    return {str(p.relative_to(results)): p.read_bytes() for p in found if not p.stem.endswith("_timing")}
