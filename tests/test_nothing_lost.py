"""What goes wrong around a run is one line, and afterwards the run goes on: docs/nothing-lost.md has the table.

tests/test_interrupted.py kills runs; the dear cases are in `make bench-kills`.
"""

import contextlib
import errno
import os
import signal
import subprocess
import sys
import time

import cv2
import pytest

import job
from full_disk import error_lines
from killed_runs import watch
from rig.errors import InputError
from run_guard import check_unchanged, check_writable, remove_unfinished, stamp
from tiny_campaign import write_campaign
from whole_folder import whole_folder
from workflow_runs import copy_project, detectors, snakemake

CONFIG = (
    detectors(aruco={}),
    "diagnose={candidates: [lens_blur]}",
    "render={edge_samples: 16}",
)
TARGET = "results/tiny/render/left.json"
READ_ONLY = 'mount --bind results results && mount -o remount,bind,ro results || exit 77; exec "$@"'


@pytest.fixture(scope="module")
def place(tmp_path_factory):
    """Return (project, campaign), whose paths have what paths may have."""
    folder = tmp_path_factory.mktemp("nothing lost") / 'Jörg\'s "Prüfstand", 50 % & co'
    return copy_project(folder / "Röhre 2"), write_campaign(folder / "meine Fotos, it's those")


def arguments_for(campaign, target=TARGET):
    """Return a short run's arguments."""
    return (target, "--cores", 1, "--config", f"campaign={campaign}", *CONFIG)


@contextlib.contextmanager
def standing_still(run, what):
    """Stop all of a run's processes when it says something, and let them go on at the end of the block."""
    end = time.monotonic() + 300
    while not any(what in line for line in list(run.said)) and run.process.poll() is None and time.monotonic() < end:
        time.sleep(0.005)
    assert run.process.poll() is None, "".join(run.said)[-3000:]
    os.killpg(run.process.pid, signal.SIGSTOP)
    try:
        yield
    finally:
        os.killpg(run.process.pid, signal.SIGCONT)


def test_a_capture_that_changes_under_way_is_named_and_measured_anew(place):
    """Fails if results of an old and a new capture are mixed in silence, or the next run leaves them so."""
    project, campaign = place
    capture = campaign / "images/left/a.png"
    run, thread = watch(project, *arguments_for(campaign))
    with standing_still(run, "Rendering the stations of left"):
        cv2.imwrite(str(capture), cv2.imread(str(capture), cv2.IMREAD_GRAYSCALE) ^ 1)
    run.process.wait(300)
    thread.join(10)
    said = "".join(run.said)
    (line,) = error_lines(said)
    assert run.process.returncode == 1 and "Traceback" not in said, said[-3000:]
    assert "images/left/a.png: written while the run was under way" in line and "--forcerun register_captures" in line
    before = (project / "results/tiny/register/left.csv").read_bytes()
    status, said = snakemake(project, *arguments_for(campaign))
    assert status == 0, said[-3000:]
    assert (project / "results/tiny/register/left.csv").read_bytes() != before


def test_a_second_run_in_the_same_folder_is_refused_and_harms_nothing(place):
    """Fails if two runs write the same files, or the second takes away what the first one made."""
    project, campaign = place
    target = "results/tiny/render/right.json"
    first, thread = watch(project, *arguments_for(campaign, target))
    with standing_still(first, "Rendering the stations of right"):
        status, said = snakemake(project, *arguments_for(campaign, target))
    assert status == 1 and "cannot be locked" in said and "Traceback" not in said, said[-2000:]
    first.process.wait(300)
    thread.join(10)
    assert first.process.returncode == 0 and (project / target).is_file(), "".join(first.said)[-3000:]


def test_results_that_can_not_be_written_are_said_before_any_job(place):
    """Fails if a run computes first, ends in a traceback, or takes anything away; or if a plan alone is refused."""
    project, campaign = place
    target = "results/tiny/twin/left"
    (project / "results/tiny").mkdir(parents=True, exist_ok=True)
    before = {p: p.read_bytes() for p in (project / "results").rglob("*") if p.is_file()}

    def read_only(*more):
        command = [sys.executable, "-m", "snakemake", *map(str, arguments_for(campaign, target)), *more]
        return subprocess.run(
            ["unshare", "-rm", "sh", "-c", READ_ONLY, "sh", *command], cwd=project, capture_output=True, text=True, check=False
        )  # fmt: skip

    done = read_only()
    if done.returncode in (77, 127) or "unshare" in done.stderr:
        pytest.skip("needs the right to mount (unshare -rm)")
    (line,) = error_lines(said := done.stdout + done.stderr)
    assert done.returncode == 1 and "can't be written to" in line and "Traceback" not in said, said[-3000:]
    assert {p: p.read_bytes() for p in (project / "results").rglob("*") if p.is_file()} == before
    assert read_only("-n").returncode == 0


def test_a_table_without_room_is_named_and_nothing_half_written_is_left(tmp_path):
    """Fails if "no space left" names no file, or the old table is gone."""
    (tmp_path / "table.csv").write_text("old\n")
    with pytest.raises(OSError) as error, job.write_atomically(tmp_path / "table.csv"):
        raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))
    assert error.value.filename == str(tmp_path / "table.csv")
    assert [p.name for p in tmp_path.iterdir()] == ["table.csv"] and (tmp_path / "table.csv").read_text() == "old\n"


def test_a_folder_is_whole_or_as_it_was(tmp_path):
    """Fails if images of two runs get mixed, of a killed one, or of one that failed."""
    out = tmp_path / "left"
    with whole_folder(out) as folder:
        (folder / "a.png").write_text("1")
    (tmp_path / f"{job.UNFINISHED}left.1").mkdir()
    (tmp_path / f"{job.UNFINISHED}left.1/b.png").write_text("of a killed job")
    with pytest.raises(ZeroDivisionError), whole_folder(out) as folder:
        (folder / "b.png").write_text("2")
        raise ZeroDivisionError
    assert [p.relative_to(tmp_path).as_posix() for p in sorted(tmp_path.rglob("*"))] == ["left", "left/a.png"]
    with pytest.raises(OSError) as error, whole_folder(out):
        raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))
    assert error.value.filename == str(out)
    with whole_folder(out) as folder:
        (folder / "c.png").write_text("3")
    assert [p.name for p in out.iterdir()] == ["c.png"]


def test_what_killed_jobs_left_is_removed_and_nothing_else(tmp_path):
    """Fails if half-written files stay for ever, or a result goes with them."""
    for name in (f"tables/{job.UNFINISHED}table1.csv.x.csv", f"twin/{job.UNFINISHED}left.7/a.png", "tables/table1.csv"):
        (tmp_path / name).parent.mkdir(parents=True, exist_ok=True)
        (tmp_path / name).write_text("1")
    remove_unfinished(tmp_path)
    assert [p.relative_to(tmp_path).as_posix() for p in tmp_path.rglob("*") if p.is_file()] == ["tables/table1.csv"]


def test_files_that_are_gone_or_written_are_named(tmp_path):
    """Fails if a capture that vanished, or one of the same size that was written again, passes."""
    paths = [tmp_path / name for name in "abc"]
    for path in paths:
        path.write_text("1")
    stamps = {str(path): stamp(path) for path in paths}
    check_unchanged(stamps)
    os.utime(paths[0], ns=(1, 1))
    paths[1].unlink()
    with pytest.raises(InputError) as error:
        check_unchanged(stamps)
    assert all(f"/{name}" in str(error.value) for name in "ab") and "/c" not in str(error.value)


def test_a_folder_that_is_not_there_yet_is_judged_by_the_one_it_will_be_in(tmp_path):
    """Fails if a first run, which has no results folder, is refused."""
    check_writable(tmp_path / "results/tiny")
