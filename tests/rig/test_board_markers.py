"""A board's markers as a table: where OpenCV's own drawing of the board has them."""

import cv2
import numpy as np
import pytest

from inputs.campaign import CalibrationBoard
from inputs.tables import MARKERS
from rig.board_markers import board_markers, charuco_board
from rig.plates import aruco_dictionary, code_cells

PX_PER_M = 4000
CHARUCO = {"type": "charuco", "dictionary": "DICT_4X4_50", "columns": 8, "rows": 6, "square_m": 0.04, "marker_m": 0.03}
BOARDS = {
    "charuco of today": CalibrationBoard(**CHARUCO),
    "charuco of before": CalibrationBoard(**CHARUCO, legacy_pattern=True),
    "grid": CalibrationBoard(
        type="aruco_grid", dictionary="DICT_6X6_1000", columns=4, rows=5, marker_m=0.0375, gap_m=0.005
    ),
    "tags": CalibrationBoard(
        type="apriltag_grid", dictionary="DICT_APRILTAG_36h11", columns=3, rows=2, marker_m=0.04, gap_m=0.01
    ),
}


def drawn(board):
    """Return OpenCV's drawing of a board as bool (rows, columns), True is white; row 0 is the highest y."""
    if board.type == "charuco":
        made, size = charuco_board(board), np.array([board.columns, board.rows]) * board.square_m
    else:
        dictionary = aruco_dictionary(board.dictionary)
        made = cv2.aruco.GridBoard((board.columns, board.rows), board.marker_m, board.gap_m, dictionary)
        size = np.array([board.columns, board.rows]) * (board.marker_m + board.gap_m) - board.gap_m
    return made.generateImage(tuple((size * PX_PER_M).round().astype(int).tolist())) > 127


@pytest.mark.parametrize("name", BOARDS)
def test_a_markers_place_and_turn_are_those_of_the_printed_board(name):
    """Fails if rows count from below, columns and rows are swapped, or the older pattern is not followed."""
    board, image = BOARDS[name], drawn(BOARDS[name])
    table = MARKERS.validate(board_markers(board))
    assert len(table) == board.columns * board.rows // (2 if board.type == "charuco" else 1)
    for m in table.itertuples():
        cells = code_cells(m.dictionary, m.id)
        steps = (np.arange(len(cells)) + 0.5) / len(cells) * m.code_m - m.code_m / 2
        column = ((m.x + steps) * PX_PER_M).astype(int)
        row = len(image) - 1 - ((m.y - steps) * PX_PER_M).astype(int)
        assert (image[np.ix_(row, column)] == cells).all(), m.id


def test_a_plate_is_the_white_around_its_code():
    """Fails if plates overlap their neighbours or are smaller than their codes."""
    assert board_markers(BOARDS["charuco of today"]).plate_m.unique() == pytest.approx([0.04])
    assert board_markers(BOARDS["grid"]).plate_m.unique() == pytest.approx([0.0425])


def test_a_board_of_squares_alone_has_no_marker():
    """Fails if a chessboard's table is no table, or lists something to detect."""
    chessboard = CalibrationBoard(type="chessboard", columns=6, rows=5, square_m=0.04)
    assert len(MARKERS.validate(board_markers(chessboard))) == 0
