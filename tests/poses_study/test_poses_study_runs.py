"""The study of poses as a user types it: real runs in a copy of the project, and what is refused before any job."""

import csv

import pytest

from workflow_runs import copy_project, detectors, planned, snakemake

EXPERIMENT = ("experiment=config/experiments/paper.yaml", "campaign=null")
SMALL = "families: [DICT_4X4_50, tagStandard41h12], id: 3, poses: 6, draws: 2, batch: 4"


@pytest.fixture(scope="module")
def project(tmp_path_factory):
    """Return a project."""
    return copy_project(tmp_path_factory.mktemp("poses") / "project")


@pytest.mark.parametrize(
    ("study", "words"),
    [
        ("{poses: 0}", ["poses_study.poses", "'0'", "greater than or equal to 1"]),
        ("{draws: 1}", ["poses_study.draws", "greater than or equal to 2"]),
        ("{nearest_m: 2, farthest_m: 1}", ["poses_study.nearest_m: 2 is not below poses_study.farthest_m, 1"]),
        ("{steepest_deg: 90}", ["poses_study.steepest_deg", "less than or equal to 88"]),
        ("{families: [DICT_9X9]}", ["poses_study.families: 'DICT_9X9' is no family of markers"]),
        ("{families: [STAG_HD21]}", ["poses_study.families: none of", "reads markers of STAG_HD21; stag would"]),
        ("{id: 1000}", ["poses_study.id: DICT_5X5_1000 has the ids 0 to 999, not 1000"]),
        ("{trackers: {stags: {}}}", ["poses_study.trackers: 'stags' does not exist", "rapidtag"]),
        ("{trackers: {stag: {}}}", ["poses_study.trackers.stag: detector stag reads no markers of DICT_5X5_1000"]),
        ("{trackers: {aruco3: {sharp: 1}}}", ["poses_study.trackers.aruco3", "no parameter 'sharp'"]),
    ],
)
def test_a_study_that_nobody_can_do_ends_the_plan(project, study, words):
    """Fails if a study of no poses, of unknown markers or by a detector that reads none of them starts jobs."""
    settings = (*EXPERIMENT, detectors(aruco={}, bart={}), f"poses_study={study}")
    status, said = snakemake(project, "-n", "--cores", 1, "poses_study", "--config", *settings)
    assert status == 1 and "Traceback" not in said and "Job stats" not in said
    (line,) = [line for line in said.splitlines() if line.startswith("error: ")]
    assert all(word in line for word in words), line


def test_a_study_is_done_and_done_again_alike(project):
    """Fails if a family or a detector asked for is left out, if one looks that reads none, or if runs differ."""
    study = f"poses_study={{{SMALL}, trackers: {{apriltag: {{decimate: 1.0}}}}}}"
    settings = ("poses_study", "--config", *EXPERIMENT, detectors(aruco={}, bart={}), study)
    made = []
    for force in ((), ("--forceall",)):
        status, said = snakemake(project, "--cores", 1, *force, *settings)
        assert status == 0, said[-3000:]
        found = (project / "results/poses_study").rglob("*.*")
        kept = {".csv", ".png", ".html"}
        made.append({str(p.relative_to(project)): p.read_bytes() for p in found if p.suffix in kept})
    assert made[0] == made[1]
    with open(project / "results/poses_study/detectors.csv") as file:
        rows = {(row["dictionary"], row["detector"]): row for row in csv.DictReader(file)}
    assert set(rows) == {("DICT_4X4_50", "aruco"), ("DICT_4X4_50", "bart"), ("tagStandard41h12", "apriltag")}
    assert all((row["poses"], row["images"], row["id"]) == ("6", "12", "3") for row in rows.values())
    assert len(list((project / "results/poses_study/maps").glob("*/*.png"))) == 2 * 8
    more = study.replace("poses: 6", "poses: 10")
    assert planned(project, *settings[:-1], more)["study_poses"] == 4
