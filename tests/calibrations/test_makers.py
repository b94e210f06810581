"""What is written is read by the programs that the formats are from, and projects there as it does here.

Needs the makers' own packages (`make makers`); a test of one that is not installed is skipped, and says so.
"""

import cv2
import numpy as np
import pytest
from cameras import SIZE, camera, rays

from calibrations.formats import available_formats, read_calibration
from calibrations.lens import project

FORMATS = available_formats()
POINTS = np.concatenate([rays(), np.ones((1000, 1))], axis=1)


def maker(name):
    """Import a maker's package, or skip in words."""
    return pytest.importorskip(name, reason=f"{name} is not installed: `make makers` installs it")


def path_of(tmp_path, name, calibration):
    """Return the path of a file in a format."""
    path = tmp_path / f"cameras{FORMATS[name].SUFFIX}"
    path.write_text(FORMATS[name].write("a_camera", calibration))
    return path


@pytest.mark.parametrize(("name", "matrix", "distortion"), [
    ("opencv", "camera_matrix", "distortion_coefficients"),
    ("opencv_camel", "cameraMatrix", "distCoeffs"),
])  # fmt: skip
@pytest.mark.parametrize("count", [5, 8, 12, 14])
def test_opencv_reads_its_yaml(tmp_path, name, matrix, distortion, count):
    """Fails if OpenCV's reader finds other numbers, or none, under the keys that its users ask for."""
    own = camera("opencv", count)
    file = cv2.FileStorage(str(path_of(tmp_path, name, own)), cv2.FILE_STORAGE_READ)
    K, coefficients = file.getNode(matrix).mat(), file.getNode(distortion).mat()
    theirs = cv2.projectPoints(POINTS[:, None], np.zeros(3), np.zeros(3), K, coefficients)[0].reshape(-1, 2)
    np.testing.assert_allclose(project(own, rays()), theirs, rtol=0, atol=1e-6)


@pytest.mark.parametrize("count", [0, 4, 5, 8, 12])
def test_mrcal_reads_and_projects(tmp_path, count):
    """Fails if mrcal, which reads the file in C, takes another model, order or pixel convention."""
    mrcal = maker("mrcal")
    own = camera("opencv", count)
    theirs = mrcal.cameramodel(str(path_of(tmp_path, "mrcal", own)))
    assert tuple(theirs.imagersize()) == SIZE
    np.testing.assert_allclose(project(own, rays()), mrcal.project(POINTS, *theirs.intrinsics()), rtol=0, atol=1e-6)
    theirs.write(str(tmp_path / "theirs.cameramodel"))
    back = read_calibration(tmp_path / "theirs.cameramodel")
    np.testing.assert_allclose(project(back, rays()), project(own, rays()), rtol=0, atol=1e-6)


@pytest.mark.parametrize(("lens", "count"), FORMATS["colmap"].HOLDS)
def test_colmap_reads_and_projects(tmp_path, lens, count):
    """Fails if COLMAP sees the image half a pixel off: its pixels' corners are at whole numbers."""
    pycolmap = maker("pycolmap")
    own = camera(lens, count)
    path_of(tmp_path, "colmap", own)
    for name in ("images.txt", "points3D.txt"):
        (tmp_path / name).write_text("")
    reconstruction = pycolmap.Reconstruction()
    reconstruction.read_text(str(tmp_path))
    theirs = reconstruction.cameras[1].img_from_cam(POINTS)
    np.testing.assert_allclose(project(own, rays()) + 0.5, np.array(theirs), rtol=0, atol=1e-6)
    reconstruction.write_text(str(tmp_path))
    back = read_calibration(tmp_path / "cameras.txt")
    np.testing.assert_allclose(project(back, rays()), project(own, rays()), rtol=0, atol=1e-6)


def lensfun_modifier(text, flags):
    """Return lensfun's own Modifier of the only lens in a text."""
    lensfunpy = maker("lensfunpy")
    database = lensfunpy.Database(xml=text, load_common=False, load_bundled=False)
    found = database.find_cameras("twingap", "a_camera")[0]
    lens = database.find_lenses(found, "twingap", "a_camera lens")[0]
    modifier = lensfunpy.Modifier(lens, found.crop_factor, *SIZE)
    focal = next(c for c in lens.calib_distortion).focal
    modifier.initialize(focal, 2.8, 10.0, pixel_format=np.float32, flags=getattr(lensfunpy.ModifyFlags, flags))
    return modifier


@pytest.mark.parametrize(("lens", "count"), [("poly3", 1), ("poly5", 2), ("ptlens", 3)])
def test_lensfun_distorts_alike(lens, count):
    """Fails if radii are in other units, or the middle elsewhere; lensfun computes in single precision."""
    own = camera(lens, count, aspect=1.0)
    modifier = lensfun_modifier(FORMATS["lensfun"].write("a_camera", own), "DISTORTION")
    ideal = (rays(200) * own.fx + [own.cx, own.cy]).round()  # one by one: along a line lensfun adds up its steps
    theirs = [modifier.apply_geometry_distortion(float(x), float(y), 1, 1)[0, 0] for x, y in ideal]
    np.testing.assert_allclose(project(own, (ideal - [own.cx, own.cy]) / own.fx), theirs, rtol=0, atol=1e-3)


def test_lensfun_separates_colours_and_darkens_alike():
    """Fails if red and blue change places, or the fall-off of light is taken for its correction."""
    own = camera("poly5", 2, aspect=1.0)
    own = type(own)(**own.__dict__ | {"red": 1.002, "blue": 0.997, "falloff": (-0.4, 0.1, -0.05)})
    text = FORMATS["lensfun"].write("a_camera", own)
    x, y = 1000.0, 50.0
    red, green, blue = lensfun_modifier(text, "TCA").apply_subpixel_distortion(x, y, 1, 1)[0, 0]
    centre = np.array([own.cx, own.cy])
    np.testing.assert_allclose(green, (x, y), atol=1e-3)
    np.testing.assert_allclose(red, centre + 1.002 * (np.array([x, y]) - centre), atol=1e-3)
    np.testing.assert_allclose(blue, centre + 0.997 * (np.array([x, y]) - centre), atol=1e-3)
    image = np.ones((SIZE[1], SIZE[0], 3), np.float32)
    assert lensfun_modifier(text, "VIGNETTING").apply_color_modification(image)
    r2 = ((x - centre[0]) ** 2 + (y - centre[1]) ** 2) / ((SIZE[0] - 1) ** 2 + (SIZE[1] - 1) ** 2) * 4
    assert 1 / image[int(y), int(x), 1] == pytest.approx(1 - 0.4 * r2 + 0.1 * r2**2 - 0.05 * r2**3, rel=5e-3)
