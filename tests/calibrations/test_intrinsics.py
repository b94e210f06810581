"""A camera's intrinsics may be a file of another program's, inside the campaign."""

import pytest
from cameras import LENSES

from calibrations.formats import available_formats
from calibrations.lens import Calibration
from inputs.campaign import load_campaign
from job_inputs import jobs_of
from rig.errors import InputError
from tiny_campaign import HEIGHT, WIDTH, write_campaign
from workflow_runs import copy_project, pretend

OWN = Calibration(WIDTH, HEIGHT, 51.5, 50.25, 30.75, 24.0, "opencv", LENSES["opencv", 4])


def with_file(name, drop=("fx", "fy", "cx", "cy")):
    """Return what makes campaign.yaml name a file for the camera left."""

    def describe(data):
        camera = data["cameras"]["left"]
        for key in drop:
            del camera[key]
        camera["intrinsics"] = name

    return describe


def lay(folder, text, name="left.yaml", **options):
    """Write a campaign whose camera left has its intrinsics in a file of this text."""
    write_campaign(folder, with_file(name, **options))
    (folder / "left.yaml").write_text(text)
    return folder


def test_a_file_takes_the_place_of_four_numbers(tmp_path):
    """Fails if the pinhole is not taken, or is taken half a pixel off from COLMAP's file."""
    for name in ("opencv", "ros", "kalibr", "colmap", "mrcal"):
        module = available_formats()[name]
        held = (
            OWN
            if ("opencv", 4) in module.HOLDS
            else Calibration(*list(OWN.__dict__.values())[:7], (*OWN.coefficients, 0.0))
        )
        camera = load_campaign(lay(tmp_path / name, module.write("left", held))).file.cameras["left"]
        assert (camera.fx, camera.fy, camera.cx, camera.cy) == (51.5, 50.25, 30.75, 24.0)


@pytest.mark.parametrize(("name", "size", "options", "message"), [
    ("left.yaml", (640, 480), {}, r"cameras.left.intrinsics: left.yaml is of images of 640 x 480"),
    ("../left.yaml", (WIDTH, HEIGHT), {}, "inside"),
    ("none.yaml", (WIDTH, HEIGHT), {}, "no such file"),
    ("left.yaml#cam3", (WIDTH, HEIGHT), {}, "no camera 'cam3'"),
    ("left.yaml", (WIDTH, HEIGHT), {"drop": ()}, "not both"),
])  # fmt: skip
def test_a_file_that_is_not_this_cameras_is_refused(tmp_path, name, size, options, message):
    """Fails if a calibration of another image size is used: everything would be off by a scale."""
    own = Calibration(*size, *list(OWN.__dict__.values())[2:8])
    folder = lay(tmp_path / "c", available_formats()["opencv"].write("left", own), name, **options)
    with pytest.raises(InputError, match=message):
        load_campaign(folder)


def test_the_workflow_takes_the_file_for_an_input(tmp_path):
    """Fails if a new calibration in the same file reruns nothing."""
    project, wanted = copy_project(tmp_path / "project"), "results/tiny/expand/markers.csv"
    lay(project / "c", available_formats()["opencv"].write("left", OWN))
    pretend(project, wanted, "--config", "campaign=c")
    _, inputs = jobs_of(project)[wanted]
    assert {"c/left.yaml", "scripts/calibrations/kalibr.py"} <= set(inputs)
