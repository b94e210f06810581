"""Bad input through the real workflow: exit status 1, one message, no traceback, earlier results untouched."""

import pytest

from tiny_campaign import CAPTURES, lay_down
from workflow_runs import copy_project, snakemake


@pytest.fixture(scope="module")
def project(tmp_path_factory):
    """Return a copy of the project for all tests of this file."""
    return copy_project(tmp_path_factory.mktemp("project") / "a copy")


def refused(project, *arguments):
    """Run snakemake, hold it to exit status 1 without a traceback, and return its error lines."""
    status, said = snakemake(project, "--cores", 1, *arguments)
    assert status == 1, said
    assert "Traceback" not in said
    assert 'File "' not in said
    return [line for line in said.splitlines() if line.startswith("error: ")]


def test_a_bad_campaign_stops_before_any_job(project, tmp_path):
    """tests/rig/test_campaign.py has all the ways to be bad; this is what a user sees of one."""
    campaign = lay_down(tmp_path / "my campaign", captures=CAPTURES.replace("left_b,", "left_a,"))
    (message,) = refused(project, "--config", f"campaign={campaign}")
    assert "captures.csv, row 3, column capture: 'left_a' stands in row 2 too" in message
    assert not (project / "results").exists()


def test_a_bad_configuration_stops_before_any_job(project):
    (message,) = refused(project, "--config", "campaign=nowhere", "render={device: tpu}")
    assert "render.device is 'tpu'" in message


def test_a_truncated_capture_leaves_results_as_they_were(tmp_path):
    """Snakemake takes a failing job's earlier outputs away: captures are looked at before any job."""
    project, campaign = copy_project(tmp_path / "project"), lay_down(tmp_path / "my campaign")
    target = "results/tiny/expand/scene.json"
    arguments = (target, "--config", f"campaign={campaign}")
    status, said = snakemake(project, "--cores", 1, *arguments)
    assert status == 0, said
    before = (project / target).read_bytes()
    image = campaign / "images/left/b.png"
    image.write_bytes(image.read_bytes()[:-40])
    (message,) = refused(project, *arguments, "--forceall")
    assert "captures.csv, capture left_b, column image" in message
    assert "truncated" in message
    assert (project / target).read_bytes() == before
