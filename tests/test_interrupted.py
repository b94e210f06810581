"""A run that is killed in the middle of rendering goes on where it was and ends with the same tables."""

import os
import signal
import time

from tiny_campaign import SEEN_HEIGHTS_M, write_seen_campaign
from workflow_runs import copy_project, detectors, numbers_of, snakemake, start_snakemake

TABLES = [f"results/tiny/tables/{name}.csv" for name in ("table1", "table2", "ladder")]
CONFIG = (
    "diagnose={candidates: [lens_blur]}",
    detectors(aruco={}),
    "render={edge_samples: 256}",
)


def kill_while_rendering(project, arguments):
    """Start a run, kill all of its processes at once when a camera's first station is stored, return that camera."""
    run = start_snakemake(project, *arguments)
    try:
        end = time.monotonic() + 400
        stored = []
        while not stored and run.poll() is None and time.monotonic() < end:
            stored = list((project / "results/tiny/render").glob("*/h*.npz"))
            time.sleep(0.005)
    finally:
        if run.poll() is None:
            os.killpg(run.pid, signal.SIGKILL)
        run.wait()
    assert stored, f"the run ended with {run.returncode} before a station was stored"
    return stored[0].parent.name


def test_a_killed_run_goes_on_and_ends_with_the_same_tables(tmp_path):
    """Were a kill to lose stations, or half of a file to be taken for a whole one, nobody could trust a long run."""
    campaign = write_seen_campaign(tmp_path / "tiny")
    arguments = (*TABLES, "--cores", 2, "--config", f"campaign={campaign}", *CONFIG)
    killed, whole = copy_project(tmp_path / "killed"), copy_project(tmp_path / "whole")

    camera = kill_while_rendering(killed, arguments)
    render = killed / "results/tiny/render"
    kept = {path: path.stat().st_mtime_ns for path in (render / camera).glob("h*.npz")}
    assert 1 <= len(kept) < len(SEEN_HEIGHTS_M)
    assert not (render / f"{camera}.json").exists()

    status, said = snakemake(killed, *arguments)
    assert status == 1 and "--unlock" in said and "Traceback" not in said, said[-2000:]
    status, said = snakemake(killed, "--unlock", *arguments)
    assert status == 0, said[-2000:]
    status, said = snakemake(killed, *arguments)
    assert status == 0, said[-4000:]
    assert {path: path.stat().st_mtime_ns for path in kept} == kept
    rendered = (render / f"{camera}_timing.csv").read_text()
    assert not [path.stem for path in kept if f"{path.stem}," in rendered]

    status, said = snakemake(whole, *arguments)
    assert status == 0, said[-4000:]
    wanted, got = (numbers_of(project / "results/tiny") for project in (whole, killed))
    assert {f"results/tiny/{name}" for name in wanted} > set(TABLES)
    assert sorted(wanted) == sorted(got)
    assert [name for name in wanted if wanted[name] != got[name]] == []
