"""Other people's trackers behind the contract: what they read, in which order, and what is said where they are missing."""

from types import SimpleNamespace

import numpy as np
import pytest

from detectors import contract
from effects.base import Scene, View
from effects.encoding import srgb_encode
from gap.predict.synthesis import Prints, coverages, shade
from markers.contract import marker_corners_world, marker_plate
from rig.errors import InputError
from rig.geometry import camera_matrix, project, station_pose

READ = {
    "aruco_apriltag": ("DICT_5X5_1000", "DICT_APRILTAG_36h11"),
    "apriltag": ("DICT_APRILTAG_36h11", "DICT_APRILTAG_25h9", "DICT_APRILTAG_16h5", "tagStandard41h12"),
    "stag": ("STAG_HD13", "STAG_HD21"),
    "locus": ("DICT_4X4_50", "DICT_6X6_250", "DICT_APRILTAG_36h11", "DICT_ARUCO_MIP_36h12"),
    "rapidtag": ("DICT_4X4_50", "DICT_5X5_1000", "DICT_ARUCO_ORIGINAL", "DICT_APRILTAG_36h11"),
}
ALL = [(name, family) for name, families in READ.items() for family in families]


def seen(family, rz, number=5):
    """Return (image, corners (4, 2)) of a marker seen straight from above, turned by rz radians."""
    share = 0.55 if family.startswith("tagStandard") else 0.7
    marker = SimpleNamespace(
        dictionary=family, id=number, code_m=0.2 * share, plate_m=0.3, x=0.003, y=0.002, z=0.0, rx=0.0, ry=0.0, rz=rz
    )
    K, T = camera_matrix(400, 400, 99.5, 99.5), station_pose(0.5, 90)
    plate = marker_plate(marker)
    view = View(K, 200, 200, 0, T, "c", "a", "s")
    image = shade(Scene((plate,), 0.8, 0.05, 0.35, 0.3), view, *coverages(Prints((plate,)), view))
    return np.rint(255 * srgb_encode(image)).astype(np.uint8), project(K, T, marker_corners_world(marker))


@pytest.mark.parametrize(("name", "family"), ALL)
def test_a_tracker_reads_its_families_in_one_order(name, family):
    """Fails if corners come in another order, from another corner, or half a pixel off, or if an id is another's."""
    if name != "aruco_apriltag":
        pytest.importorskip(next(iter(contract.needs_of(name))), reason="optional extra 'trackers' is not installed")
    assert contract.reads(name, family)
    detector = contract.make(name, [family])
    for turn in range(4):
        image, corners = seen(family, 0.1 + turn * np.pi / 2)
        (found,) = detector.detect(image)
        assert (found.dictionary, found.id) == (family, 5) and found.corners.dtype == np.float64
        off = found.corners - corners
        assert np.abs(off).max() < 1.5
        assert np.abs(off.mean(axis=0)).max() < 0.3
    again = detector.detect(image)
    np.testing.assert_array_equal(again[0].corners, found.corners)
    assert detector.detect(np.full((40, 40), 90, np.uint8)) == []


def test_several_families_are_read_at_once():
    """Fails if of several families only the first is sought, as the package of AprilTag does by itself."""
    pytest.importorskip("pupil_apriltags", reason="optional extra 'trackers' is not installed")
    families = ("DICT_APRILTAG_16h5", "DICT_APRILTAG_36h11", "tagStandard41h12")
    detector = contract.make("apriltag", families)
    for family in families:
        assert {(d.dictionary, d.id) for d in detector.detect(seen(family, 0.2)[0])} >= {(family, 5)}


def test_what_nobody_reads_is_said_and_by_whom_it_would_be():
    """Fails if a family that no chosen tracker reads comes to a job, or if one that reads nothing is run all the same."""
    names = ["aruco", "bart", "stag"]
    assert contract.readers(names, ["STAG_HD21"], "x") == ["stag"]
    assert contract.readers(names, ["DICT_5X5_1000"], "x") == ["aruco", "bart"]
    assert contract.readers(names, [], "x") == names
    with pytest.raises(InputError, match="detectors: none of aruco, bart reads markers of STAG_HD21; stag would"):
        contract.readers(["aruco", "bart"], ["DICT_5X5_1000", "STAG_HD21"], "configuration: detectors")
    with pytest.raises(InputError, match="aruco reads no markers of STAG_HD21"):
        contract.make("aruco", ["STAG_HD21"])


@pytest.mark.parametrize(
    ("name", "package"), [("stag", "stag-python"), ("locus", "locus-tag"), ("rapidtag", "rapidtag")]
)
def test_a_missing_package_is_named_with_what_to_do(monkeypatch, name, package):
    """Fails if a tracker without its package ends in a traceback, or is only missed when its job runs."""
    monkeypatch.setattr(contract.importlib.util, "find_spec", lambda module: None)
    for check in (
        lambda: contract.check_packages(name, "config"),
        lambda: contract.make(name, ["DICT_4X4_50", "STAG_HD21"]),
    ):
        with pytest.raises(InputError, match=f"detector {name} needs the package {package}.*extra 'trackers'"):
            check()
    contract.check_packages("aruco", "config")
