"""The embedded photographs of a board with markers through the real workflow: registered, detected, counted, drawn."""

import json
import shutil

import pandas as pd
import pytest
import yaml

from seen_boards import embedded
from workflow_runs import copy_project, detectors, snakemake

NAME = "aruco6x6_gridboard"
EACH = 3  # every third photograph: seven, which a test can render
FOCAL_PX = 809  # OpenCV's calibration of all 21
TARGETS = ("tables/table1.csv", "report/figure3.html", "report/figure4.html")


@pytest.fixture(scope="module")
def results(tmp_path_factory):
    """Return the results' folder of a run on some of the photographs, up to tables and figures."""
    folder = tmp_path_factory.mktemp("photographs")
    project, campaign = copy_project(folder / "project"), folder / "campaign"
    shutil.copytree(embedded(), campaign)
    captures = pd.read_csv(embedded() / "captures.csv", dtype=str).iloc[::EACH]
    captures.to_csv(campaign / "captures.csv", index=False)
    targets = [f"results/{NAME}/{path}" for path in TARGETS]
    options = ("--config", f"campaign={campaign}", "render={edge_samples: 16}", detectors(aruco={}, aruco_subpix={}))
    status, said = snakemake(project, "--cores", 2, *targets, *options)
    assert status == 0, said[-4000:]
    return project / "results" / NAME


def test_photographs_of_unknown_poses_and_intrinsics_are_registered(results):
    """Fails if a hand-held board's camera or its poses are guessed, or a photograph is lost."""
    table = pd.read_csv(results / f"register/{NAME}.csv")
    assert len(table) == 7 and set(table.status) == {"registered"}
    assert table.rms_px.max() < 1 and table.tz.between(0.1, 2).all()
    record = json.loads((results / f"register/{NAME}.json").read_text())
    assert record["fx"] == record["fy"] == pytest.approx(FOCAL_PX, rel=0.03)


def test_a_boards_markers_are_counted_and_compared_like_a_rigs(results):
    """Fails if a board has "no markers to detect", or if its markers lie elsewhere in the twin than in the photographs."""
    board = yaml.safe_load((embedded() / "campaign.yaml").read_text())["target"]
    markers = pd.read_csv(results / "expand/markers.csv")
    assert len(markers) == board["columns"] * board["rows"] and set(markers.dictionary) == {board["dictionary"]}
    (row,) = pd.read_csv(results / "tables/table1.csv").to_dict("records")
    assert row["n_captures"] == 7 and 130 <= row["n_markers"] <= 140
    assert row["coverage_pct"] > 95 and row["coverage_twin_pct"] > 95 and row["precision_pct"] > 95
    assert row["delta_rotation_deg"] < 3 and row["delta_distance_cm"] < 0.5
    assert len(pd.read_csv(results / "tables/table2.csv")) == 2
    false_ids = pd.read_parquet(results / "aggregate/false_ids.parquet")
    assert len(false_ids) == 0


@pytest.mark.parametrize("page", ["figure3", "figure4"])
def test_figures_are_drawn_of_a_board(results, page):
    """Fails if a page of a board says that there is nothing to map or to compare."""
    text = (results / f"report/{page}.html").read_text(encoding="utf-8")
    assert text.count("data:image/png;base64,") >= 2 and "so there" not in text
