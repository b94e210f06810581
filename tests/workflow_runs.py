"""Run the real workflow in a copy of the project, so that tests neither see nor touch anybody's results."""

import shutil
import subprocess
import sys
from pathlib import Path

PROJECT = Path(__file__).resolve().parents[1]
PARTS = (
    *("Snakefile", "rules", "scripts", "config", "envs", "profiles", "notebooks", "pyproject.toml"),
    "tests/bench",  # blind trials are rules too
)


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


def numbers_of(results):
    """Return {path: bytes} of all files of a run that hold numbers and no times: what a second run has to repeat."""
    folders = ("expand", "register", "twin", "detect", "aggregate", "diagnosis", "tables")
    found = sorted(path for name in folders for path in (results / name).rglob("*") if path.is_file())
    return {str(p.relative_to(results)): p.read_bytes() for p in found if not p.stem.endswith("_timing")}
