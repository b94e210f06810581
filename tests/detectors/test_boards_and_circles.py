"""Boards and circle grids as objects of a rig: drawn as OpenCV draws them, found as one square with its corners in order."""

from types import SimpleNamespace

import cv2
import numpy as np
import pytest

from detectors import contract
from detectors.opencv_circles import upright
from effects.base import Scene, View
from effects.encoding import srgb_encode
from gap.predict.synthesis import Prints, coverages, shade
from markers.contract import count_of, drawing_of, marker_corners_world, marker_plate
from rig.errors import InputError
from rig.geometry import camera_matrix, project, station_pose

READ = {
    "CHARUCO_7X5_75_DICT_5X5_100": "opencv_boards",
    "CHARUCO_5X7_75_DICT_4X4_50": "opencv_boards",
    "GRID_4X3_20_DICT_APRILTAG_36h11": "opencv_boards",
    "CIRCLES_4X11_60": "opencv_circles",
}


def seen(family, rz, number, tilt=90):
    """Return (image, corners (4, 2)) of an object turned by rz radians, seen under a tilt."""
    y = 0.5 / np.tan(np.radians(tilt))
    place = {"x": 0.003, "y": y, "z": 0.0, "rx": 0.0, "ry": 0.0, "rz": rz}
    marker = SimpleNamespace(dictionary=family, id=number, code_m=0.2, plate_m=0.3, **place)
    T = station_pose(0.5, tilt)
    K = camera_matrix(750 / np.sin(np.radians(tilt)), 750 / np.sin(np.radians(tilt)), 199.5, 199.5)
    plate = marker_plate(marker)
    view = View(K, 400, 400, 0, T, "c", "a", "s")
    image = shade(Scene((plate,), 0.8, 0.05, 0.35, 0.3), view, *coverages(Prints((plate,)), view))
    return np.rint(255 * srgb_encode(image)).astype(np.uint8), project(K, T, marker_corners_world(marker))


@pytest.mark.parametrize("family", READ)
def test_an_object_is_found_whole_in_one_order(family):
    """Fails if a board is taken for another, turned, mirrored or measured from its edge instead of its square."""
    number = min(1, count_of(family) - 1)
    detector = contract.make(READ[family], [family])
    for turn, tilt in ((0, 90), (1, 90), (2, 90), (3, 90), (0, 55)):
        image, corners = seen(family, 0.15 + turn * np.pi / 2, number, tilt)
        (found,) = detector.detect(image)
        assert (found.dictionary, found.id) == (family, number)
        assert np.abs(found.corners - corners).max() < 0.6
    assert detector.detect(np.full((100, 100), 90, np.uint8)) == []


@pytest.mark.parametrize("family", ["CIRCLES_SYMMETRIC_6X4_50", "CIRCLES_SYMMETRIC_4X9_50"])
def test_a_symmetric_grid_is_found_upright(family):
    """Fails if its corners are mirrored, exchanged by a quarter turn, or if its top is not what is further up in the image."""
    detector = contract.make("opencv_circles", [family])
    for turn, tilt in ((0.15, 90), (-1.2, 90), (1.2, 90), (0.1, 55), (-0.6, 55)):
        image, corners = seen(family, turn, 0, tilt)
        (found,) = detector.detect(image)
        assert np.abs(found.corners - corners).max() < 0.6
        image, upside_down = seen(family, turn + np.pi, 0, tilt)
        (found,) = detector.detect(image)
        assert np.abs(found.corners - np.roll(upside_down, 2, axis=0)).max() < 0.6


def test_symmetric_grids_that_opencv_does_not_find_are_not_taken():
    """Fails if a rig with a grid whose sides are both odd, which OpenCV never finds, is let through to its jobs."""
    grids = ("CIRCLES_4X11_60", "CIRCLES_SYMMETRIC_6X5_60", "CIRCLES_SYMMETRIC_7X5_60", "DICT_4X4_50")
    assert [contract.reads("opencv_circles", family) for family in grids] == [True, True, False, False]


def test_corners_of_a_symmetric_grid_are_those_of_one_that_stands():
    """Fails if a mirrored order passes, or a grid that is upside down."""
    square = np.array([[2, 1], [8, 2], [7, 9], [1, 8]], float)
    for order in ([0, 1, 2, 3], [2, 3, 0, 1], [1, 0, 3, 2], [3, 2, 1, 0]):
        np.testing.assert_array_equal(upright(square[order]), square)


def test_a_circle_grid_is_found_beside_other_spots():
    """Fails if spots elsewhere in the image, such as another marker's bits, hide a grid."""
    image, corners = seen("CIRCLES_4X11_60", 0.1, 0, 55)
    other, _ = seen("STAG_HD21", 0.3, 2)
    both = np.concatenate([other, np.full((400, 10), 90, np.uint8), image], axis=1)
    (found,) = contract.make("opencv_circles", ["CIRCLES_4X11_60"]).detect(both)
    assert np.abs(found.corners - [410, 0] - corners).max() < 0.6


def test_a_board_hidden_in_part_is_still_found_and_a_rest_of_it_is_not():
    """Fails if a board needs all its markers, or if two of them are enough for corners far away from them."""
    family = "CHARUCO_7X5_75_DICT_5X5_100"
    image, corners = seen(family, 0.1, 1)
    half = image.copy()
    half[:, 205:] = 150
    (found,) = contract.make("opencv_boards", [family]).detect(half)
    assert np.abs(found.corners - corners).max() < 2
    rest = image.copy()
    rest[:, 130:] = rest[180:] = 150
    assert contract.make("opencv_boards", [family]).detect(rest) == []


def test_a_charuco_board_is_opencvs():
    """Fails if squares and markers are swapped, or if the second board has the first one's markers."""
    board = cv2.aruco.CharucoBoard(
        (7, 5), 1.0, 0.75, cv2.aruco.getPredefinedDictionary(cv2.aruco.DICT_5X5_100), np.arange(17, 34)
    )
    wanted = board.generateImage((1120, 800), marginSize=0) > 127
    drawing = drawing_of("CHARUCO_7X5_75_DICT_5X5_100", 1)
    x = (np.arange(1120) + 0.5) / 1120 - 0.5
    y = ((np.arange(800) + 0.5) / 800 - 0.5) * 5 / 7
    column, row = (np.searchsorted(drawing.lines, v) - 1 for v in (x, y))
    shown = drawing.white[row[:, None], column]
    assert (shown == wanted).mean() > 0.99
    assert drawing.white[0].all() and drawing.white[-1].all()


@pytest.mark.parametrize(
    "family",
    [
        *("CHARUCO_7X5_75_DICT_9X9", "CHARUCO_1X5_75_DICT_4X4_50", "GRID_4X3_DICT_4X4_50"),
        *("CIRCLES_4X10_60", "CIRCLES_SYMMETRIC_7X7_60", "CIRCLES_SYMMETRIC_11X11_60"),
    ],
)
def test_a_board_that_is_none_is_refused_by_name(family):
    """Fails if a misspelt board, or a grid whose ends cannot be told apart, is drawn all the same."""
    with pytest.raises(InputError, match=f"{family}.*CHARUCO_7X5"):
        count_of(family)
