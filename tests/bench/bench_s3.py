"""Captures in an object store: ``python tests/bench/bench_s3.py``; `make bench-s3` sets up what it needs.

A tiny campaign goes to moto's server with `dvc push` and comes to another clone with `dvc pull`, where a run has the same
tables. Then an object is damaged, one is missing, the credentials are wrong, and the connection is cut: each has to be
named in one line by scripts/fetch_data.py. The number of cases named is recorded (record.py).
"""

import os
import re
import shutil
import subprocess
import sys
import tempfile
from pathlib import Path

ROOT = Path(__file__).resolve().parents[2]
sys.path[:0] = [str(ROOT / "scripts"), str(ROOT / "tests")]

import object_store
from record import record
from tiny_campaign import write_campaign
from verify_data import files_of
from workflow_runs import PARTS, detectors, numbers_of

TOOLS = Path(os.environ.get("TWINGAP_S3", ROOT / ".tools/s3"))
PACKAGES = (
    TOOLS.resolve() / f"lib/python{sys.version_info[0]}.{sys.version_info[1]}/site-packages"
)  # as if in the environment
LONGEST_S = 3600
CONFIG = ["campaign=data/raw/tiny", detectors(aruco={}, bart={}), "diagnose={candidates: [lens_blur]}"]
LINE = {
    "a damaged object": r"damaged on the remote: images/left/a\.png$",
    "a missing object": r"did not arrive: images/right/b\.png \(.*(not exist|Not Found|404)",
    "wrong credentials": r"did not arrive: .*(Access Key|credentials|Forbidden|signature|denied)",
    "a cut connection": r"did not arrive: .*(onnection|disconnected|closed|incomplete|not enough data)",
}


class Clone:
    """A git clone with DVC, in which commands run with the credentials of ``environment``."""

    def __init__(self, folder, environment):
        self.folder = Path(folder)
        path = f"{TOOLS.resolve() / 'bin'}:{os.environ['PATH']}"
        quiet = {
            "PATH": path,
            "GIT_CONFIG_GLOBAL": "/dev/null",
            "DVC_NO_ANALYTICS": "1",
            "PYTHONPATH": str(ROOT / "scripts"),
        }
        self.environment = environment | quiet

    def run(self, *command, status=0, **more):
        """Run a command; end the program where its exit status is another; return all that it said."""
        done = subprocess.run(
            [str(c) for c in command], cwd=self.folder, env=self.environment | more, text=True, check=False,
            stdout=subprocess.PIPE, stderr=subprocess.STDOUT, timeout=LONGEST_S,
        )  # fmt: skip
        if done.returncode != status:
            sys.exit(f"{' '.join(map(str, command))}: exit status {done.returncode}\n{done.stdout[-5000:]}")
        return done.stdout

    def fetch(self, address, **more):
        """Fetch the campaign anew from an address of the store, which fails; return the one line that says why."""
        self.run("dvc", "remote", "modify", "--local", "team", "endpointurl", address)
        for name in (".dvc/cache", ".dvc/tmp", "data/raw/tiny"):
            shutil.rmtree(self.folder / name, ignore_errors=True)
        fetch = (sys.executable, "scripts/fetch_data.py", "data/raw/tiny.dvc")
        said = self.run(*fetch, status=1, PYTHONPATH=str(PACKAGES), **more).strip()
        if "\n" in said or not said.startswith("error: "):
            sys.exit(f"not one line:\n{said[-3000:]}")
        return said


def make_project(clone, address):
    """Make a git repository of the workflow with a tiny campaign in it that DVC tracks and keeps in the store."""
    clone.folder.mkdir(parents=True)
    for name in PARTS:
        source = ROOT / name
        (shutil.copytree if source.is_dir() else shutil.copy)(source, clone.folder / name)
    (clone.folder / ".gitignore").write_text("/results/\n/.snakemake/\n__pycache__/\n")
    write_campaign(clone.folder / "data/raw/tiny")
    clone.run("git", "init", "-q")
    clone.run("dvc", "init", "-q")
    clone.run("dvc", "remote", "add", "--default", "team", f"s3://{object_store.BUCKET}/twingap")
    clone.run("dvc", "remote", "modify", "team", "endpointurl", address)
    clone.run("dvc", "add", "-q", "data/raw/tiny")
    clone.run("dvc", "push", "-q")
    clone.run("git", "add", ".")
    clone.run("git", "-c", "user.name=a", "-c", "user.email=a@b", "commit", "-qm", "A campaign")


def run_workflow(clone):
    """Run the workflow in a clone; return its numbers."""
    clone.run(sys.executable, "-m", "snakemake", "--cores", 2, "--config", *CONFIG, PYTHONPATH="")
    return numbers_of(clone.folder / "results/tiny")


def change(clone, address, step, md5, body=b"not what it was"):
    """Do something to an object in the store: ``put`` (other content) or ``delete``."""
    code = (
        f"import boto3; s3 = boto3.client('s3', endpoint_url={address!r}); "
        f"s3.{step}_object(Bucket={object_store.BUCKET!r}, Key='twingap/files/md5/{md5[:2]}/{md5[2:]}'"
        + (f", Body={body!r})" if step == "put" else ")")
    )
    clone.run("python", "-c", code)


def provoke(first, clone, address):
    """Return {case: the line that names it}; the store is whole again after each. DVC would not push again what it once pushed."""
    folder = first.folder / "data/raw/tiny"
    md5, said = files_of(folder), {}
    for case, step, name in (
        ("a damaged object", "put", "images/left/a.png"),
        ("a missing object", "delete", "images/right/b.png"),
    ):
        change(clone, address, step, md5[name])
        said[case] = clone.fetch(address)
        change(clone, address, "put", md5[name], (folder / name).read_bytes())
    said["wrong credentials"] = clone.fetch(address, AWS_ACCESS_KEY_ID="AKIAIOSFODNN7EXAMPLE")
    with object_store.cut_after(address, 2000) as cut:
        said["a cut connection"] = clone.fetch(cut)
    return said


def main():
    """Push, pull elsewhere, run; then what goes wrong."""
    with tempfile.TemporaryDirectory() as folder:
        folder = Path(folder)
        with object_store.serving(TOOLS.resolve() / "bin/python", folder) as (address, environment):
            first, clone = Clone(folder / "first", environment), Clone(folder / "clone", environment)
            make_project(first, address)
            first.run("git", "clone", "-q", first.folder, clone.folder)
            clone.run("dvc", "pull", "-q")
            same = files_of(first.folder / "data/raw/tiny") == files_of(clone.folder / "data/raw/tiny")
            one, two = run_workflow(first), run_workflow(clone)
            print(f"pushed, cloned, pulled: the same captures: {same}; run in both: {len(one)} files with numbers")
            said = provoke(first, clone, address)
    named = {case: bool(re.search(LINE[case], line, re.I)) for case, line in said.items()}
    for case, line in said.items():
        print(f"- {case}: {line}{'' if named[case] else '   NOT NAMED'}")
    differ = sum(one.get(name) != two.get(name) for name in one.keys() | two.keys())
    record(
        [
            (
                "captures pushed to S3 and pulled into another clone: files with numbers that differ",
                f"{differ} of {len(one)}",
                "files",
            ),
            ("what goes wrong with S3 and is named in one line", f"{sum(named.values())} of {len(named)}", "cases"),
        ],
        "make bench-s3",
    )
    sys.exit(0 if same and one and not differ and all(named.values()) else 1)


if __name__ == "__main__":
    main()
