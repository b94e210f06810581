"""Boards as plates are what OpenCV draws, cell by cell."""

import cv2
import numpy as np
import pytest

from inputs.campaign import CalibrationBoard
from rig.plates import aruco_dictionary
from rig.targets import target_plate

PIXELS = 70  # a square; divisible by the modules of a 5 x 5 code


def drawn(plate, pixels_per_m, width, height):
    """Return the plate's colours (height, width) at pixel centres, row 0 at the top, the board without its rim."""
    x = (np.arange(width) + 0.5) / pixels_per_m
    y = (height - np.arange(height) - 0.5) / pixels_per_m
    column = np.searchsorted(plate.x_m, x) - 1
    row = np.searchsorted(plate.y_m, y) - 1
    return plate.white[row[:, None], column[None, :]]


@pytest.mark.parametrize("legacy", [False, True])
@pytest.mark.parametrize("size", [(5, 4), (6, 7), (5, 7), (4, 6)])
def test_charuco_is_opencvs(size, legacy):
    """Were the legacy flag or a row's direction wrong, the twin's board would be another than the photograph's."""
    columns, rows = size
    board = CalibrationBoard(
        type="charuco",
        dictionary="DICT_5X5_1000",
        columns=columns,
        rows=rows,
        square_m=0.07,
        marker_m=0.049,
        legacy_pattern=legacy,
    )
    made = cv2.aruco.CharucoBoard(size, 0.07, 0.049, aruco_dictionary("DICT_5X5_1000"))
    made.setLegacyPattern(legacy)
    width, height = columns * 100, rows * 100
    wanted = made.generateImage((width, height), marginSize=0) > 127
    got = drawn(target_plate(board), 100 / 0.07, width, height)
    assert (got != wanted).mean() < 0.02  # OpenCV rounds modules to whole pixels
    middles = np.s_[50::100, 50::100]
    assert np.array_equal(got[middles], wanted[middles])
    centres = np.s_[5::10, 5::10]
    inner = cv2.erode(wanted.astype(np.uint8), np.ones((5, 5))) | (
        1 - cv2.dilate(wanted.astype(np.uint8), np.ones((5, 5)))
    )
    assert (got == wanted)[inner.astype(bool)].all() and got[centres].any()


def test_chessboard_and_grid_are_read_back():
    """Were a grid mirrored or a chessboard of another size, OpenCV would not read them from a drawing of the plate."""
    grid = CalibrationBoard(type="aruco_grid", dictionary="DICT_5X5_1000", columns=3, rows=2, marker_m=0.07, gap_m=0.02)
    plate = target_plate(grid)
    scale, shift = 1000, 0.03
    x = (np.arange(330) + 0.5) / scale - shift
    y = 0.21 - (np.arange(240) + 0.5) / scale
    inside = [(v > g[0]) & (v < g[-1]) for v, g in ((x, plate.x_m), (y, plate.y_m))]
    column, row = (np.clip(np.searchsorted(g, v) - 1, 0, len(g) - 2) for v, g in ((x, plate.x_m), (y, plate.y_m)))
    image = np.where(inside[1][:, None] & inside[0][None, :], plate.white[row[:, None], column[None, :]], True)
    corners, ids, _ = cv2.aruco.ArucoDetector(aruco_dictionary("DICT_5X5_1000")).detectMarkers(
        image.astype(np.uint8) * 255
    )
    assert sorted(ids.ravel()) == [0, 1, 2, 3, 4, 5]
    for quad, marker in zip(corners, ids.ravel(), strict=True):
        left, top = (marker % 3) * 0.09 + shift, 0.21 - ((1 - marker // 3) * 0.09 + 0.07)
        assert np.abs(quad.reshape(4, 2)[0] - [left * scale, top * scale]).max() < 2
    chess = target_plate(CalibrationBoard(type="chessboard", columns=6, rows=4, square_m=0.03))
    image = np.kron(chess.white[::-1], np.ones((40, 40))).astype(np.uint8) * 255
    assert cv2.findChessboardCorners(image, (6, 4))[0]
