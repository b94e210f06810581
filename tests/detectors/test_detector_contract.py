"""What all detectors share: discovery, parameters, image check, both planar poses."""

import cv2
import numpy as np
import pytest

from detectors import contract
from rig.errors import InputError
from rig.geometry import camera_matrix, make_pose, project, transform
from rig.plates import code_cells, marker_corners_plate

ALL = ["aruco", "aruco_subpix", "aruco3", "bart"]


def marker_image(dictionary="DICT_5X5_1000", number=7, scale=8, border=30):
    """Return a frontal marker on white paper; its corners lie at border - 0.5 and border + 7 * scale - 0.5."""
    code = np.kron(code_cells(dictionary, number), np.ones((scale, scale), bool))
    image = np.pad(np.where(code, 220, 30), border, constant_values=220)
    return image.astype(np.uint8)


def frontal_corners(scale=8, border=30):
    a, b = border - 0.5, border + 7 * scale - 0.5
    return np.array([[a, a], [b, a], [b, b], [a, b]])


def test_a_detector_is_found_by_being_there():
    assert set(ALL) | {"apriltag"} <= set(contract.available())
    assert "contract" not in contract.available() and "_opencv" not in contract.available()


@pytest.mark.parametrize("name", ALL)
@pytest.mark.parametrize("dictionary", contract.DEFAULT_DICTIONARIES)
def test_every_detector_reads_both_dictionaries_in_opencvs_order(name, dictionary):
    image = marker_image(dictionary)
    for turn in range(4):
        (found,) = contract.make(name).detect(np.ascontiguousarray(np.rot90(image, -turn)))
        assert (found.dictionary, found.id) == (dictionary, 7)
        assert found.corners.dtype == np.float64
        assert np.abs(found.corners - np.roll(frontal_corners(), -turn, axis=0)).max() < 1.2


@pytest.mark.parametrize("name", ALL)
def test_every_form_of_one_image_gives_the_same_marker(name):
    """A wrong stride, channel order or bit depth would lose the marker or move it."""
    detector = contract.make(name)
    grey = marker_image()
    (expected,) = detector.detect(grey)
    colour = cv2.cvtColor(grey, cv2.COLOR_GRAY2BGR)
    wide = np.zeros((grey.shape[0], 2 * grey.shape[1]), np.uint8)
    wide[:, ::2] = grey
    forms = [colour, cv2.cvtColor(grey, cv2.COLOR_GRAY2BGRA), grey[:, :, None], grey.astype(np.uint16) * 257]
    forms += [wide[:, ::2], np.asfortranarray(grey), np.ascontiguousarray(colour[:, ::-1])[:, ::-1]]
    for form in forms:
        (found,) = detector.detect(form)
        assert found.id == expected.id and np.allclose(found.corners, expected.corners, atol=1e-9)


@pytest.mark.parametrize("name", ALL)
def test_bad_images_are_named_and_tiny_ones_are_empty(name):
    detector = contract.make(name)
    for bad in (None, np.zeros((0, 0), np.uint8), np.zeros((4, 4)), np.full((9, 9), np.nan, np.float32)):
        with pytest.raises(ValueError, match="image"):
            detector.detect(bad)
    for bad in (np.zeros((5, 5, 2), np.uint8), np.zeros(7, np.uint8), np.zeros((4, 4), bool)):
        with pytest.raises(ValueError, match="image"):
            detector.detect(bad)
    for size in ((1, 1), (1, 500), (500, 1), (2, 3), (7, 7), (20, 20)):
        assert detector.detect(np.full(size, 90, np.uint8)) == []


def test_unknown_names_and_values_are_one_message():
    with pytest.raises(InputError, match="allowed are.*bart"):
        contract.make("barts")
    with pytest.raises(InputError, match="DICT_5X5_1001"):
        contract.make("aruco", ["DICT_5X5_1001"])
    with pytest.raises(InputError, match=r"config\.yaml: detector bart has no parameter 'widnow_px'.*window_px"):
        contract.make("bart", parameters={"widnow_px": 3}, where="config.yaml")
    for wrong in ({"window_px": 3.5}, {"multi_scale": 1}, {"offset_dn": True}, {"contrast_dn": float("nan")}):
        with pytest.raises(InputError, match=next(iter(wrong))):
            contract.make("bart", parameters=wrong)
    with pytest.raises(InputError, match="otsu"):
        contract.make("bart", parameters={"threshold": "median"})


def test_for_sequences_a_trackers_parameters_are_known_too():
    """Fails if what only the tracker knows is refused, or if what nobody knows is let through."""
    contract.check_for_sequences({"aruco": {}, "bart": {"bridge_frames": 5, "threshold": "otsu"}}, "small.yaml")
    for detectors, words in (
        ({"nobody": {}}, "small.yaml: detectors: 'nobody' does not exist; allowed are .*aruco_subpix"),
        ({"bart": {"bridge": 3}}, "small.yaml: detectors.bart: .*'bridge'"),
        ({"aruco": {"bridge_frames": 5}}, "small.yaml: detectors.aruco: .*'bridge_frames'"),
    ):
        with pytest.raises(InputError, match=words):
            contract.check_for_sequences(detectors, "small.yaml: detectors")


def test_only_a_detector_with_a_tracker_has_one():
    """Fails if detectors without a tracker are started as one, or if BART's is not found by being there."""
    assert contract.tracker_of("aruco") is None
    assert "budget_ms" in contract.tracker_of("bart").TRACKER_PARAMETERS


def test_apriltag_reads_its_families_or_says_what_is_missing():
    pytest.importorskip("pupil_apriltags", reason="optional extra 'trackers' is not installed")
    cells = np.kron(code_cells("DICT_APRILTAG_36h11", 5), np.ones((10, 10)))
    image = np.pad(np.where(cells > 0, 220, 30), 40, constant_values=220).astype(np.uint8)
    found = contract.make("apriltag", ["DICT_APRILTAG_36h11"]).detect(image)
    assert [(d.dictionary, d.id) for d in found] == [("DICT_APRILTAG_36h11", 5)]
    reference = contract.make("aruco_subpix", ["DICT_APRILTAG_36h11"]).detect(image)
    assert np.abs(found[0].corners - reference[0].corners).max() < 0.5
    with pytest.raises(InputError, match="36h11"):
        contract.make("apriltag", ["DICT_5X5_1000"])


def test_both_planar_poses_come_with_their_errors():
    K = camera_matrix(800, 800, 319.5, 239.5)
    T = make_pose([2.6, 0.3, 0.1], [0.05, -0.02, 0.9])
    corners = project(K, np.eye(4), transform(T, marker_corners_plate(0.07)))
    poses = contract.estimate_poses(corners, 0.07, K)
    assert len(poses) == 2 and poses[0][2] < 1e-3 < poses[1][2]
    assert np.abs(make_pose(*poses[0][:2]) - T).max() < 1e-4
    assert contract.estimate_poses(np.full((4, 2), np.nan), 0.07, K) == []
    assert contract.estimate_poses(np.ones((4, 2)), 0.07, K) == []
