"""README is what a newcomer types: every command in it is run here as it stands, or as far as a test can go.

So are those of the pages on own campaigns and calibrations. A command of these pages that is not in COMMANDS, or one in
COMMANDS that they no longer have, fails.
"""

import os
import re
import shutil
import signal
import subprocess
import sys
import time
from pathlib import Path

import cv2
import pytest

from board_photographs import drawn, lay, photograph
from calibrations.formats import available_formats
from calibrations.lens import Calibration
from inputs.campaign import CalibrationBoard
from rig.targets import target_plate
from tiny_campaign import write_campaign
from workflow_runs import PROJECT

PAGES = ("README.md", "docs/clusters.md", "docs/own-campaign.md", "docs/paper.md", "docs/calibrations.md")
README = "\n\n".join((PROJECT / page).read_text(encoding="utf-8") for page in PAGES)
PROGRAMS = ("make", "snakemake", "source", "jupyter", "python", "dvc", "cp", "git", "uv", ".tools/bin/uv")
LONGEST_S = 120


def as_it_stands(place, command):
    """Run it."""
    return place.run(command)


def planned(place, command):
    """Run a long snakemake command as a dry run: it ends after the plan."""
    said = place.run(f"{command} -n")
    assert "Traceback" not in said
    return said


def compared(place, command):
    """Plan it with other photographs of the same board as the earlier campaign: the same ones are refused."""
    now = place.folder.parent / "photographs"
    earlier = shutil.copytree(now, place.folder.parent / "earlier")
    for k, file in enumerate(sorted(earlier.glob("*.png"))):
        cv2.imwrite(str(file), photograph(cv2.imread(str(file), cv2.IMREAD_GRAYSCALE), 100 + k))
    text = (now / "campaign.yaml").read_text().replace("name: photographs", "name: earlier")
    (earlier / "campaign.yaml").write_text(text)
    return planned(place, command.replace("path/to/earlier", str(earlier)))


def on_a_copy(place, command):
    """Run it on a copy of the photographs, which it makes a campaign of."""
    copy = shutil.copytree(place.folder.parent / "photographs", place.folder.parent / "copied", dirs_exist_ok=True)
    for written in ("campaign.yaml", "captures.csv", "markers.csv"):
        (copy / written).unlink(missing_ok=True)
    return place.run(command.replace("path/to/photographs", str(copy)))


def made(*steps):
    """Return what asks make for its steps, which must hold these words."""

    def check(place, command):
        said = place.run(command.replace("make", "make -n", 1))
        for step in steps:
            assert step in said
        return said

    return check


def another_remote(place, command):
    """Run `dvc remote add`, which opens no connection, and see that DVC took it."""
    place.run("dvc remote remove team || true")
    place.run(command)
    assert command.split()[-1].split("/")[-1] in place.run("dvc remote list")


def served(place, command):
    """Start Jupyter until it says that it listens."""
    options = "--no-browser --allow-root --port=0 --ServerApp.port_retries=50"
    log = place.folder / "jupyter.log"
    (place.folder / "results/frame/notebooks").mkdir(parents=True, exist_ok=True)
    with open(log, "w") as file:
        run = subprocess.Popen(
            ["bash", "-c", f"exec {command} {options}"],
            cwd=place.folder, env=place.environment, stdout=file, stderr=file, start_new_session=True,
        )  # fmt: skip
    try:
        end = time.monotonic() + LONGEST_S
        while "is running at" not in log.read_text() and run.poll() is None and time.monotonic() < end:
            time.sleep(0.2)
    finally:
        os.killpg(run.pid, signal.SIGKILL)
        run.wait()
    assert "is running at" in log.read_text(), log.read_text()[-2000:]


def without_results(place, command):
    """Adopting needs a diagnosis: before the first run it must say so, in one line."""
    said = place.run(command, status=1)
    assert "error: " in said and "Traceback" not in said


def by_slurm(place, command):
    """Plan with the profile for Slurm, where its plugin was fetched."""
    if not (PROJECT / ".tools/slurm").is_dir():
        pytest.skip("needs the plugin for Slurm: `make bench-slurm` fetches it")
    place.run(f"PYTHONPATH={PROJECT}/.tools/slurm {command.removesuffix(' -n')} -n")


def told(place, command):
    """A measurement takes hours: see that it takes this command line."""
    assert "usage: " in place.run(f"{command} --help")


def after_a_run(place, command):
    """It needs finished results: test_reruns has them."""
    assert '"--report"' in (PROJECT / "tests/test_reruns.py").read_text()


def installed(place, command):
    """An installation needs the network: see that make puts the program there, and that what is locked has hashes."""
    assert f"UV := {command.split()[0]}" in (PROJECT / "Makefile").read_text()
    for lock in re.findall(r"-r (\S+)", command):
        text = (PROJECT / lock).read_text()
        assert text.count("--hash=sha256:") >= len(re.findall(r"^\S+==", text, re.M)) > 0


# What README has -> how it is tried. Those that change the folder come in README's order.
COMMANDS = {
    "make": made("venv", "dvc pull", "snakemake --cores 2", "results/frame/report/index.html"),
    "make test": made("-m pytest"),
    "make picture": made("docs/picture.png"),
    "source .venv/bin/activate": as_it_stands,
    "snakemake -n": as_it_stands,
    "snakemake --cores 2": planned,
    "snakemake --cores 2 diagnose": planned,
    "jupyter lab results/frame/notebooks": served,
    "python scripts/adopt_effect.py hp325": without_results,
    "snakemake --unlock": as_it_stands,
    "make paper": made("all twin_study --config experiment=config/experiments/paper.yaml", "docs/paper.png"),
    "make board": made("print_board.py charuco", "print_board.py rig config/rigs/ladders.yaml"),
    "make makers": made("--group makers"),
    "python scripts/print_board.py charuco --columns 6 --rows 8 --square-mm 30 --out prints/mine.pdf": as_it_stands,
    "python scripts/print_board.py markers path/to/folder/markers.csv": as_it_stands,
    "python scripts/start_campaign.py path/to/photographs --marker-mm 50": on_a_copy,
    "python scripts/start_campaign.py path/to/photographs --square-mm 25": as_it_stands,
    "snakemake --cores 2 --config campaign=path/to/photographs": planned,
    "snakemake --cores 2 diagnose --config campaign=path/to/photographs baseline=path/to/earlier": compared,
    "python scripts/export_camera.py hp325 --format opencv": without_results,
    "python scripts/export_camera.py hp325 --format twin_camera": without_results,
    "python scripts/export_camera.py path/to/calibration.yaml --format colmap": as_it_stands,
    "snakemake --cores 2 --config campaign=path/to/folder": planned,
    "snakemake --cores 2 --config campaign=data/raw/aruco6x6_gridboard": planned,
    "snakemake --cores 2 --config experiment=config/experiments/paper.yaml": planned,
    "snakemake --cores 2 twin_study --config experiment=config/experiments/paper.yaml": planned,
    "python tests/bench/bench_paper.py": told,
    "dvc remote add --default team s3://bucket/twingap": another_remote,
    "dvc remote modify team endpointurl https://s3.example.org": as_it_stands,
    "dvc remote add --default team ssh://user@host/path/twingap": another_remote,
    "dvc remote add --default team /mnt/share/twingap": another_remote,
    "dvc push": as_it_stands,
    "cp -r path/to/folder data/raw/ && dvc add data/raw/folder && dvc push": as_it_stands,
    "dvc pull": as_it_stands,
    "dvc pull --remote embedded data/raw/frame.dvc": as_it_stands,
    "python scripts/fetch_data.py data/raw/frame.dvc": as_it_stands,
    "make environment": made("--require-hashes"),
    ".tools/bin/uv pip install --no-deps -r envs/slurm.lock.txt": installed,
    "snakemake --profile profiles/slurm -n": by_slurm,
    "snakemake --profile profiles/slurm": by_slurm,
    "snakemake --profile profiles/slurm --config batch=100": by_slurm,
    "snakemake --report report.zip": after_a_run,
    "python tests/bench/bench_resources.py results/frame": without_results,
    "python tests/bench/bench_growth.py": told,
    "make bench-slurm": made("slurm-wlm munge", "bench_slurm.py"),
    "make bench-slurm TINY=--tiny": made("bench_slurm.py --tiny"),
    "make bench-s3": made("bench_s3.py"),
    ".tools/bin/uv pip install -r envs/s3.lock.txt": installed,
    '.tools/bin/uv pip install "dvc[ssh]"': installed,
}


def commands_of(text):
    """Return the commands of a Markdown text: lines of fenced blocks, and code in running text and comments."""
    fenced = "".join(re.findall(r"^```\n(.*?)^```", text, re.M | re.S))
    running = re.sub(r"^```.*?^```", "", text, flags=re.M | re.S)
    found = [" ".join(code.split()) for code in re.findall(r"`([^`]+)`", running)]
    for line in fenced.splitlines():
        command, _, comment = line.partition(" #")
        found += [command.strip(), comment.removeprefix(" needs:").strip()]
    return [f for f in dict.fromkeys(found) if f.split()[:1] and f.split()[0] in PROGRAMS and f not in ("dvc", "git")]


class Place:
    """A fresh clone with an environment, in which commands run; the words that stand for paths are replaced."""

    def __init__(self, folder):
        self.folder = folder / "twingap"
        self.words = {
            "path/to/folder": folder / "folder",
            "path/to/photographs": folder / "photographs",
            "path/to/calibration.yaml": folder / "calibration.yaml",
            "/mnt/share/twingap": folder / "share/twingap",
        }
        path = f"{Path(sys.executable).parent}:{os.environ['PATH']}"
        self.environment = os.environ | {"PATH": path, "GIT_CONFIG_GLOBAL": "/dev/null"}

    def run(self, command, status=0):
        """Run a command, hold it to an exit status, and return all that it said."""
        for word, path in self.words.items():
            command = command.replace(word, str(path))
        done = subprocess.run(
            ["bash", "-c", command], cwd=self.folder, env=self.environment, text=True, check=False,
            stdout=subprocess.PIPE, stderr=subprocess.STDOUT, timeout=LONGEST_S,
        )  # fmt: skip
        assert done.returncode == status, f"{command}\n{done.stdout[-3000:]}"
        return done.stdout


@pytest.fixture(scope="module")
def place(tmp_path_factory):
    """Return a clone with today's files, the embedded campaign fetched, and a campaign of one's own beside it."""
    if not (PROJECT / ".git").exists():
        pytest.skip("needs a clone: DVC works in git repositories")
    folder = tmp_path_factory.mktemp("readme")
    place = Place(folder)
    subprocess.run(["git", "clone", "-q", str(PROJECT), str(place.folder)], check=True)
    listed = subprocess.run(
        ["git", "ls-files", "-m", "-o", "--exclude-standard"], cwd=PROJECT, capture_output=True, text=True, check=True
    )
    for name in listed.stdout.splitlines():
        if (PROJECT / name).is_file():
            (place.folder / name).parent.mkdir(parents=True, exist_ok=True)
            shutil.copy2(PROJECT / name, place.folder / name)
    (place.folder / ".venv").symlink_to(Path(sys.prefix))
    write_campaign(folder / "folder")
    board = CalibrationBoard(
        type="charuco", dictionary="DICT_5X5_100", columns=7, rows=10, square_m=0.025, marker_m=0.01875
    )
    lay(folder / "photographs", drawn(target_plate(board)), 5)
    camera = Calibration(640, 480, 500.0, 500.0, 320.0, 240.0, "opencv", (-0.1, 0.01, 0.0, 0.0))
    (folder / "calibration.yaml").write_text(available_formats()["opencv"].write("mine", camera))
    place.run("dvc pull --quiet --remote embedded data/raw/frame.dvc data/raw/aruco6x6_gridboard.dvc")
    return place


def test_every_command_of_readme_is_tried():
    assert sorted(commands_of(README)) == sorted(COMMANDS)


@pytest.mark.parametrize("command", COMMANDS)
def test_a_command_of_readme_works(place, command):
    COMMANDS[command](place, command)


def test_links_of_the_documentation_lead_somewhere():
    """A newcomer follows them."""
    for page in [PROJECT / "README.md", PROJECT / "config/README.md", *sorted((PROJECT / "docs").glob("*.md"))]:
        for link in re.findall(r"\]\(([^)#]+)[^)]*\)", page.read_text(encoding="utf-8")):
            assert "://" in link or (page.parent / link).exists(), f"{page.name}: {link}"
