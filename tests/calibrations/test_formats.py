"""Calibrations go out and come back the same, whatever the format; what a file can't be is one line."""

import cv2
import numpy as np
import pytest
from cameras import LENSES, SIZE, camera, rays

from calibrations.formats import available_formats, read_calibration
from calibrations.lens import Calibration, project
from export_camera import convert
from rig.errors import InputError

FORMATS = available_formats()
HELD = [(name, *model) for name, module in FORMATS.items() for model in module.HOLDS]
MATRIX = "{key}: !!opencv-matrix\n   rows: {rows}\n   cols: {columns}\n   dt: d\n   data: [{data}]\n"
OLD = """\
%YAML:1.0
calibration_Time: "Sun 22 Nov 2026"
image_Width: 640
image_Height: 480
board_Width: 9
flagValue: 0
Camera_Matrix: !!opencv-matrix
   rows: 3
   cols: 3
   dt: d
   data: [ 5.3591573396163199e+02, 0., 3.4228315473308373e+02, 0.,
       5.3591573396163199e+02, 2.3557082909788173e+02, 0., 0., 1. ]
Distortion_Coefficients: !!opencv-matrix
   rows: 5
   cols: 1
   dt: d
   data: [ -2.6637260909660682e-01, -3.8588898922304653e-02,
       1.7831947042852964e-03, -2.8122100441115472e-04, 2.3839153080878486e-01 ]
Avg_Reprojection_Error: 3.9259098975581364e-01
"""
KALIBR = """\
cam0:
  cam_overlaps: [1]
  camera_model: pinhole
  distortion_coeffs: [-0.294, 0.082, 0.0001, -0.0002]
  distortion_model: radtan
  intrinsics: [461.629, 460.152, 362.680, 246.049]
  resolution: [752, 480]
  rostopic: /cam0/image_raw
cam1:
  T_cn_cnm1:
  - [0.99, 0.0, 0.0, -0.11]
  - [0.0, 1.0, 0.0, 0.0]
  - [0.0, 0.0, 1.0, 0.0]
  - [0.0, 0.0, 0.0, 1.0]
  camera_model: pinhole
  distortion_coeffs: [-0.29, 0.08, 0.0003, -0.0001]
  distortion_model: radtan
  intrinsics: [460.5, 459.1, 378.4, 254.0]
  resolution: [752, 480]
"""
LENS = (
    "<lensdatabase><lens><maker>a</maker><model>m</model><cropfactor>{crop}</cropfactor><calibration>"
    '<distortion model="poly3" focal="{focal}" k1="-0.01"/></calibration></lens></lensdatabase>'
)


def written(tmp_path, name, calibration):
    """Return the path of a file in a format."""
    path = tmp_path / f"c{FORMATS[name].SUFFIX}"
    path.write_text(FORMATS[name].write("a_camera", calibration))
    return path


@pytest.mark.parametrize(("name", "lens", "count"), HELD)
def test_a_camera_comes_back_from_a_file_as_it_was(tmp_path, name, lens, count):
    """Fails if a format's fields change order, lose digits, or if half a pixel is added on one way only."""
    own = camera(lens, count, aspect=1.0 if "aspect" in getattr(FORMATS[name], "FIXED", ()) else 1.004)
    back = read_calibration(written(tmp_path, name, own), SIZE)
    np.testing.assert_allclose(project(back, rays()), project(own, rays()), rtol=0, atol=1e-9)
    assert (back.lens, (back.width, back.height)) == (own.lens, SIZE)


@pytest.mark.parametrize("name", FORMATS)
def test_one_format_is_not_taken_for_another(tmp_path, name):
    """Fails if a loose test of a text lets the wrong reader have it."""
    lens, count = FORMATS[name].HOLDS[0]
    text = written(tmp_path, name, camera(lens, count)).read_text()
    readers = {module.read for module in FORMATS.values() if module.is_one(text)}
    assert readers == {FORMATS[name].read}


@pytest.mark.parametrize("lens_count", [("opencv", 5), ("opencv", 14), ("fisheye", 4)])
def test_projection_is_opencv_s(lens_count):
    """Fails if coefficients are handed over in another order."""
    own = camera(*lens_count)
    points = np.concatenate([rays(), np.ones((1000, 1))], axis=1)[:, None]
    functions = {"opencv": cv2.projectPoints, "fisheye": cv2.fisheye.projectPoints}
    theirs = functions[own.lens](points, np.zeros(3), np.zeros(3), own.K, np.array(own.coefficients))[0]
    np.testing.assert_allclose(project(own, rays()), theirs.reshape(-1, 2), atol=1e-9)


def test_opencv_s_old_capitals_and_layout_are_read(tmp_path):
    """Fails if files of the sample program before OpenCV 3, which lie about everywhere, are refused."""
    (tmp_path / "old.yml").write_text(OLD)
    found = read_calibration(tmp_path / "old.yml")
    assert (found.width, found.height, found.cx) == (640, 480, pytest.approx(342.28315473308373, abs=1e-12))
    assert found.coefficients[4] == pytest.approx(0.23839153080878486, abs=1e-15)


def test_json_of_opencv_is_read(tmp_path):
    """Fails if FileStorage's other format, which OpenCV writes for .json, is refused."""
    file = cv2.FileStorage(str(tmp_path / "c.json"), cv2.FILE_STORAGE_WRITE)
    for key, value in (("image_width", 640), ("image_height", 480), ("camera_matrix", camera("opencv", 0).K)):
        file.write(key, value)
    file.release()
    assert read_calibration(tmp_path / "c.json").fx == 901.25


def test_one_of_several_cameras_is_chosen(tmp_path):
    """Fails if the first camera of a stereo pair is taken in silence."""
    path = tmp_path / "camchain.yaml"
    path.write_text(KALIBR)
    with pytest.raises(InputError, match=r"has cam0, cam1; choose one: .*camchain.yaml#cam0"):
        read_calibration(path)
    assert read_calibration(f"{path}#cam1").fx == 460.5
    with pytest.raises(InputError, match="no camera 'cam2'"):
        read_calibration(f"{path}#cam2")


def test_a_lens_database_needs_the_images_size(tmp_path):
    """Fails if millimetres become pixels without a size, or by the wrong edge: 36 mm across are 1280 pixels or so."""
    path = tmp_path / "lens.xml"
    path.write_text(LENS.format(crop=1.5, focal=24))
    with pytest.raises(InputError, match="has no size of images"):
        read_calibration(path)
    found = read_calibration(path, (1500, 1000))
    # of 23.5 mm sensors a 24 mm lens has about 1500 pixels of focal length
    assert found.fx == pytest.approx(1500, rel=2e-3)


ENTITIES = '<!DOCTYPE a [<!ENTITY x "1.5"><!ENTITY y SYSTEM "file:///etc/passwd">]>' + LENS.format(crop="&x;", focal=24)
WRONG = {
    "entities.xml": (ENTITIES, "XML entities are not read"),
    "laughs.xml": (
        "<!DOCTYPE a [<!ENTITY a 'ha'><!ENTITY b '&a;&a;&a;&a;&a;&a;&a;&a;'><!ENTITY c '&b;&b;&b;&b;&b;&b;&b;&b;'>]>"
        + LENS.format(crop="&c;", focal=24),
        "XML entities are not read",
    ),
    "encoding.xml": ('<?xml version="1.0" encoding="utf-7"?>' + LENS.format(crop=1, focal=24), "not XML"),
    "unknown.xml": ('<?xml version="1.0" encoding="nope"?>' + LENS.format(crop=1, focal=24), "not XML"),
    "red.txt": ("1 \x1b[31mPINHOLE 640 480 1 2 3 4\n", "no calibration in a known format"),
    "nul.txt": ("1 PINHOLE 640 480 1\0 2 3 4\n", "could not convert"),
    "high.yaml": (OLD.replace("image_Height: 480", f"image_Height: {'9' * 400}"), "height is 9999"),
    "nul.yaml": ("camera_matrix: !!opencv-matrix\n\0", "special characters are not allowed"),
    "broken.xml": ("<lensdatabase><lens>", "not XML"),
    "crop.xml": (LENS.format(crop="big", focal=24), "cropfactor is 'big'"),
    "code.cameramodel": (
        "{'lensmodel': __import__('os').system('touch /tmp/never'), 'intrinsics': [], 'imagersize': []}",
        "not the Python dict",
    ),
    "deep.cameramodel": ("lensmodel imagersize intrinsics" + "[" * 100_000, "not the Python dict"),
    "splined.cameramodel": (
        "{'lensmodel': 'LENSMODEL_SPLINED_STEREOGRAPHIC_order=3_Nx=30_Ny=18_fov_x_deg=150', 'intrinsics': [1],"
        " 'imagersize': [10, 10]}",
        "LENSMODEL_SPLINED_STEREOGRAPHIC",
    ),
    "omni.yaml": (KALIBR.replace("pinhole", "omni") + "\n", "has cam0, cam1|camera_model is 'omni'"),
    "tags.yaml": ("cam0: !!python/object/apply:os.system [ls]\n# camera_model", "could not determine a constructor"),
    "alias.yaml": ("cam0: &a {camera_model: pinhole}\ncam1: *a\n", "aliases"),
    "zero.yaml": (
        "image_width: 640\nimage_height: 480\ndistortion_model: plumb_bob\ndistortion_coefficients: {data: [0,0,0,0,0]}\n"
        "camera_matrix: {rows: 3, cols: 3, data: [0,0,0,0,0,0,0,0,0]}\n",
        "not calibrated",
    ),
    "seven.yaml": (OLD.replace("Distortion_Coefficients", "x").replace("5.3591573396163199e+02, 0.,", "5.3e2, 1.5,"), "skew"),
    "nan.yaml": (OLD.replace("3.4228315473308373e+02", ".nan"), "9 numbers are needed"),
    "wide.yaml": (OLD.replace("640", ".inf"), "width is inf"),
    "words.yaml": (OLD.replace("3.4228315473308373e+02", "middle"), "9 numbers are needed"),
    "thin.txt": ("1 THIN_PRISM_FISHEYE 640 480 1 2 3 4\n", "THIN_PRISM_FISHEYE"),
    "few.txt": ("1 OPENCV 640 480 500 500 320 240\n", "4 parameters; OPENCV has 8"),
    "text.txt": ("1 PINHOLE 640 480 a b c d\n", "could not convert"),
    "none.txt": ("hello\n", "no calibration in a known format"),
}  # fmt: skip


@pytest.mark.parametrize("name", WRONG)
def test_what_no_file_of_its_format_can_be_is_one_line(tmp_path, name):
    """Fails if a hostile or broken file is read, run, or ends in a traceback."""
    text, message = WRONG[name]
    (tmp_path / name).write_text(text)
    with pytest.raises(InputError, match=message) as error:
        read_calibration(tmp_path / name, SIZE)
    assert str(tmp_path) in str(error.value) and str(error.value).isprintable()


@pytest.mark.parametrize(
    ("lens", "coefficients"),
    [("opencv", (1e3, -50.0, 0.3, 1e-9, 1e3)), ("fisheye", (5.0, 5.0, 1e3, -0.5)), ("ptlens", (0.3, 1e-9, 5.0))],
)
def test_a_lens_without_rays_can_not_be_converted(lens, coefficients):
    """Fails if a calibration that folds the image ends in a traceback of the solver, or is fitted to nothing."""
    calibration = Calibration(640, 480, 1.0, 9e6, -9e6, 9e6, lens, coefficients)
    with pytest.raises(InputError, match="takes rays to .* of its frame only"):
        convert(calibration, "a", FORMATS["colmap"], 0.5)


def test_every_lens_of_the_tests_is_there():
    """Fails if a format comes to hold a model that no test writes."""
    assert {model for module in FORMATS.values() for model in module.HOLDS} <= set(LENSES)
