"""A camera with many captures is divided among jobs, and what comes out is what one job would have made."""

import re

import numpy as np
import pandas as pd
import pytest

import case_files
from join_detections import join_tables
from tiny_campaign import write_campaign
from workflow_runs import PROJECT, copy_project, detectors, planned, snakemake

THREE = detectors(aruco={}, aruco_subpix={}, bart={})
SLURM = PROJECT / ".tools/slurm"


@pytest.fixture(scope="module")
def project(tmp_path_factory):
    """Return (project, the argument that names a tiny campaign), nothing computed."""
    folder = tmp_path_factory.mktemp("batches")
    return copy_project(folder / "project"), f"campaign={write_campaign(folder / 'tiny')}"


def test_only_cameras_with_more_captures_than_a_batch_are_divided(project):
    """Fails if small campaigns pay for further jobs, or a batch has other than its number of captures."""
    folder, campaign = project
    plan = planned(folder, "--config", campaign, THREE, "batch=1")
    assert "observe_captures" not in plan and plan["observe_batch"] == 4 and plan["join_observations"] == 2
    assert "detect_captures" not in plan and plan["detect_batch"] == 12 and plan["join_detections"] == 6
    plan = planned(folder, "--config", campaign, THREE, "batch=2")
    assert plan["observe_captures"] == 2 and not {"observe_batch", "join_observations", "detect_batch"} & set(plan)


def test_what_was_measured_is_of_rules_that_there_are():
    """Fails if a rule was renamed or never measured and its jobs ask for what `other` says, or a row asks for nothing."""
    table = pd.read_csv(PROJECT / "config/resources.csv", index_col="rule")
    text = "".join(path.read_text() for path in sorted((PROJECT / "rules").glob("*.smk")))
    rules = {"other", "run_notebook", *re.findall(r"^ *rule (\w+)", text, re.M), *re.findall(r" as (\w+) with:", text)}
    assert set(table.index) <= rules and {"other", "detect_captures", "render_stations"} <= set(table.index)
    assert (table.mem_mb > 0).all() and (table.capture_s > 0).all()
    assert set(re.findall(r'(?:mem_mb|runtime)_of\("(\w+)"\)', text)) <= rules & set(table.index)


def test_slurm_profile_plans_the_same_jobs(project, monkeypatch):
    """Fails if the profile has a setting that Snakemake or its plugin does not know."""
    if not SLURM.is_dir():
        pytest.skip("needs the plugin for Slurm: `make bench-slurm` fetches it")
    folder, campaign = project
    monkeypatch.setenv("PYTHONPATH", str(SLURM))
    status, said = snakemake(folder, "-n", "--profile", "profiles/slurm", "--config", campaign, THREE)
    assert status == 0 and re.search(r"^detect_captures +6$", said, re.M), said[-3000:]


def test_joined_tables_are_those_of_one_job(tmp_path):
    """Fails if a value is read as a number and written with other digits, or captures of two parts change places."""
    header = "source,capture,x0,y0\n"
    whole = [
        *("real,007,0.1,2.50\n", "real,7,1e-300,\n", "real,7,0.30000000000000004,5\n"),
        *("twin,007,1.0,2\n", 'twin,"a, b",3.0,4\n'),
    ]
    (tmp_path / "1.csv").write_text(header + whole[0] + whole[3])
    (tmp_path / "2.csv").write_text(header + whole[1] + whole[2] + whole[4])
    join_tables([tmp_path / "1.csv", tmp_path / "2.csv"], tmp_path / "all.csv")
    assert (tmp_path / "all.csv").read_text() == header + "".join(whole)


def test_joined_observations_are_those_of_one_job(tmp_path):
    """Fails if parts are joined in another order or along another axis."""
    rng = np.random.default_rng(0)
    arrays = {"features": rng.normal(size=(5, 3, 9)), "measured": rng.random((5, 3)) < 0.5}
    for name, part in (("whole", slice(None)), ("0", slice(0, 2)), ("1", slice(2, None))):
        np.savez_compressed(tmp_path / f"{name}.npz", **{k: v[part] for k, v in arrays.items()})
    with open(tmp_path / "joined.npz", "wb") as file:
        case_files.join_observations([tmp_path / "0.npz", tmp_path / "1.npz"], file)
    assert (tmp_path / "joined.npz").read_bytes() == (tmp_path / "whole.npz").read_bytes()
