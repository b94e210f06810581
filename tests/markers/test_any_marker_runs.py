"""Markers of any type the whole way through the workflow, and what is refused before any job: real runs in a copy."""

import csv

import pytest

from workflow_runs import copy_project, detectors, snakemake

CAMERA = "width: 480\nheight: 360\nfov_deg: 60\nfov_axis: horizontal\n"
EXPERIMENT = "name: mixed\ncameras: {small: small.yaml}\nrig: mixed.yaml\nheights_m: [0.3]\ntilts_deg: [45]\n"
RIG = """ladders:
  - {dictionary: STAG_HD21, plates: 1, columns_x_m: [-0.13], first_y_m: 0.3, step_y_m: 0.2, code_m: 0.09, plate_m: 0.12}
  - {dictionary: tagStandard41h12, first_id: 2000, plates: 1, columns_x_m: [0.0], first_y_m: 0.3, step_y_m: 0.2,
     code_m: 0.06, plate_m: 0.12}
  - {dictionary: CIRCLES_4X7_60, plates: 1, columns_x_m: [0.14], first_y_m: 0.3, step_y_m: 0.2, code_m: 0.11, plate_m: 0.13}
"""
TRACKERS = {"stag": {}, "apriltag": {"decimate": 1.0}, "opencv_circles": {}, "aruco": {}}
SETTINGS = ("experiment=config/experiments/mixed.yaml", "campaign=null", detectors(**TRACKERS))
REFERENCE = "aggregate={reference_detector: stag}"


@pytest.fixture(scope="module")
def project(tmp_path_factory):
    """Return a project with a designed rig of three types of markers."""
    project = copy_project(tmp_path_factory.mktemp("any") / "project")
    for folder, name, text in (
        ("cameras", "small", CAMERA),
        ("experiments", "mixed", EXPERIMENT),
        ("rigs", "mixed", RIG),
    ):
        (project / f"config/{folder}/{name}.yaml").write_text(text)
    return project


def refused(project, *arguments):
    """Return the one line with which a plan ends."""
    status, said = snakemake(project, "-n", "--cores", 1, *arguments)
    assert status == 1 and "Traceback" not in said and "Job stats" not in said
    (line,) = [line for line in said.splitlines() if line.startswith("error: ")]
    return line


def test_every_type_goes_to_the_tables(project):
    """Fails if a type is not drawn by Blender, not found by its tracker or in no table, or if one that reads none runs."""
    target = "results/mixed/tables/table2.csv"
    status, said = snakemake(project, "--cores", 1, target, "--config", *SETTINGS, REFERENCE)
    assert status == 0, said[-3000:]
    found = {}
    for tracker in ("stag", "apriltag", "opencv_circles"):
        with open(project / f"results/mixed/detect/small/{tracker}.csv") as file:
            found[tracker] = {(row["dictionary"], int(row["id"])) for row in csv.DictReader(file)}
    assert found["stag"] == {("STAG_HD21", 0)}
    assert found["apriltag"] == {("tagStandard41h12", 2000)}
    assert found["opencv_circles"] == {("CIRCLES_4X7_60", 0)}
    assert not (project / "results/mixed/detect/small/aruco.csv").exists()
    with open(project / target) as file:
        rows = {row["algorithm"]: row for row in csv.DictReader(file)}
    assert set(rows) == set(found) and all(row["false_ids_twin"] == "0" for row in rows.values())
    with open(project / "results/mixed/tables/table2_by_type.csv") as file:
        by_type = {(row["algorithm"], row["dictionary"]): row for row in csv.DictReader(file)}
    assert set(by_type) == {(tracker, family) for tracker, ((family, _),) in found.items()}
    assert all(float(row["coverage_twin_pct"]) == 100 for row in by_type.values())
    with open(project / "results/mixed/tables/table1_by_type.csv") as file:
        assert {(row["algorithm"], row["dictionary"]) for row in csv.DictReader(file)} == set(by_type)


@pytest.mark.parametrize(
    ("trackers", "reference", "words"),
    [
        (TRACKERS, "aruco", ["aggregate.reference_detector", "aruco reads none of the rig's", "STAG_HD21", "apriltag"]),
        (
            TRACKERS | {"stag": None},
            "apriltag",
            ["configuration: detectors: none of", "STAG_HD21; stag would"],
        ),
        (TRACKERS | {"stags": {}}, "apriltag", ["'stags' does not exist", "rapidtag"]),
    ],
)
def test_markers_that_nobody_reads_end_the_plan(project, trackers, reference, words):
    """Fails if a rig's markers that no chosen tracker reads, or a reference that reads none, come to a job."""
    chosen = (detectors(**trackers), f"aggregate={{reference_detector: {reference}}}")
    line = refused(project, "--config", *SETTINGS[:2], *chosen)
    assert all(word in line for word in words), line


@pytest.mark.parametrize(
    ("study", "words"),
    [
        ("{families: [DICT_9X9]}", ["id_study.families: 'DICT_9X9' is no family of markers", "DICT_5X5_1000"]),
        ("{families: [GRID_2X2_20_DICT_4X4_50]}", ["id_study.families: none of", "opencv_boards would"]),
        ("{views: 0}", ["id_study.views"]),
    ],
)
def test_a_study_that_nobody_can_do_ends_the_plan(project, study, words):
    """Fails if a study of unknown families, or of ones that nobody reads, starts jobs."""
    line = refused(project, "id_study", "--config", *SETTINGS, REFERENCE, f"id_study={study}")
    assert all(word in line for word in words), line


def test_a_study_is_done_and_done_again_alike(project):
    """Fails if the study's tables or pictures are missing, or differ from run to run."""
    study = "id_study={families: [DICT_4X4_50], ids: 4, views: 4, batch: 2}"
    settings = ("--config", *SETTINGS, REFERENCE, study)
    made = []
    for force in ((), ("--forceall",)):
        status, said = snakemake(project, "--cores", 1, "id_study", *force, *settings)
        assert status == 0, said[-3000:]
        files = sorted((project / "results/id_study").glob("*.*"))
        made.append({path.name: path.read_bytes() for path in files})
    assert made[0] == made[1]
    assert set(made[0]) == {"ids.csv", "families.csv", "confusions.csv", "distances.csv", "report.html"}
    assert len(made[0]["ids.csv"].splitlines()) == 1 + 4 and b"data:image/png" in made[0]["report.html"]
