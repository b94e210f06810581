"""Run the real workflow in a copy of the project, so that tests neither see nor touch anybody's results."""

import shutil
import subprocess
import sys
from pathlib import Path

PROJECT = Path(__file__).resolve().parents[1]
PARTS = ("Snakefile", "rules", "scripts", "config", "envs", "profiles", "notebooks", "pyproject.toml")


def copy_project(folder):
    """Copy what the workflow consists of, without data and results, to ``folder`` and return it."""
    folder.mkdir(parents=True)
    for name in PARTS:
        source = PROJECT / name
        if source.is_dir():
            shutil.copytree(source, folder / name, ignore=shutil.ignore_patterns("__pycache__", "twins"))
        else:
            shutil.copy(source, folder / name)
    return folder


def snakemake(project, *arguments):
    """Run snakemake in ``project``; return (exit status, all that it said)."""
    command = [sys.executable, "-m", "snakemake", *map(str, arguments)]
    done = subprocess.run(command, cwd=project, capture_output=True, text=True, timeout=300, check=False)
    return done.returncode, done.stdout + done.stderr
