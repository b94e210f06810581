"""What a change costs, asked of the real workflow with ``snakemake -n`` after one whole run of a tiny campaign.

The campaign shows no marker at all, which is a result (coverage 0) and no crash.
"""

import re

import pandas as pd
import pytest

from tiny_campaign import CAPTURES, write_campaign
from workflow_runs import copy_project, detectors, edited, planned, snakemake

CONFIG = (detectors(aruco={}, bart={}), "diagnose={candidates: [lens_blur]}", "render={edge_samples: 16}")


@pytest.fixture(scope="module")
def done(tmp_path_factory):
    """Return (project, campaign) after a whole run."""
    folder = tmp_path_factory.mktemp("reruns")
    project, campaign = copy_project(folder / "project"), write_campaign(folder / "tiny")
    status, said = snakemake(project, "--cores", 2, "--config", f"campaign={campaign}", *CONFIG)
    assert status == 0, said[-4000:]
    return project, campaign


def plan_of(done, *config):
    """Return {rule: number of jobs} that a run would start now."""
    project, campaign = done
    return planned(project, "--config", f"campaign={campaign}", *(config or CONFIG))


def test_a_whole_run_of_a_campaign_without_markers_is_a_result(done):
    """Coverage 0 must come out as 0, and the report must be there."""
    project, _ = done
    table = pd.read_csv(project / "results/tiny/tables/table1.csv")
    assert (table.coverage_pct.fillna(0) == 0).all()
    assert (project / "results/tiny/report/index.html").stat().st_size > 1000


def test_snakemakes_own_report_is_written(done):
    """Fails if a rule keeps Snakemake from telling of a finished run."""
    project, campaign = done
    status, said = snakemake(project, "--report", "report.zip", "--config", f"campaign={campaign}", *CONFIG)
    assert status == 0, said[-3000:]
    assert (project / "report.zip").stat().st_size > 10_000


def test_nothing_reruns_after_a_run_nor_after_touching(done):
    """A rule with an unstable parameter, or one that minds times, would plan jobs here."""
    project, campaign = done
    assert plan_of(done) == {}
    (project / "scripts/detectors/aruco.py").touch()
    (project / "notebooks/figure3.ipynb").touch()
    assert plan_of(done) == {}


def test_a_detectors_edit_reruns_that_detector_and_what_reads_it(done):
    """Renders, twin images or another detector in the plan would make detector work slow."""
    project, _ = done
    with edited(project / "scripts/detectors/aruco.py", '"""', '"""Edited. '):
        plan = plan_of(done)
    assert plan["detect_captures"] == 2
    assert {"aggregate_detections", "make_tables", "build_report"} <= set(plan)
    assert not {"render_stations", "expose_twin", "register_captures", "diagnose_camera"} & set(plan)


def test_a_detectors_parameter_reruns_that_detector(done):
    """A parameter that is no parameter of the rule would slip through."""
    plan = plan_of(done, detectors(aruco={}, bart={"multi_scale": False}), *CONFIG[1:])
    assert plan["detect_captures"] == 2
    assert "render_stations" not in plan


def test_a_notebooks_edit_reruns_it_and_the_report(done):
    """Tables in the plan would mean that a picture's colour costs minutes."""
    project, _ = done
    with edited(project / "notebooks/figure3.ipynb", "# ", "# Edited: "):
        plan = plan_of(done)
    assert plan == {"run_figure3": 1, "build_report": 1}


def test_a_new_capture_reruns_its_camera(done):
    """The other camera's renders and detections must stay."""
    _, campaign = done
    (campaign / "images/left/c.png").write_bytes((campaign / "images/right/b.png").read_bytes())
    with edited(campaign / "captures.csv", CAPTURES, CAPTURES + "left_c,left,0.3,45,2,images/left/c.png\n"):
        plan = plan_of(done)
    (campaign / "images/left/c.png").unlink()
    assert plan["register_captures"] == 1 and plan["detect_captures"] == 2 and plan["expose_twin"] == 1


def test_a_bumped_dependency_reruns_what_uses_it(done):
    """Snakemake sees no package upgrades: the lock's versions must be parameters."""
    project, _ = done
    lock = project / "envs/twingap.lock.txt"
    version = re.search(r"^papermill==[^ ]+", lock.read_text(), re.M).group(0)
    with edited(lock, version, "papermill==99.0"):
        plan = plan_of(done)
    assert {"run_overview", "run_tables", "build_report"} <= set(plan)
    assert not {"render_stations", "detect_captures"} & set(plan)
