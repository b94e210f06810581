"""Boards whose points fit but whose rows, type or lengths are others: one line; boards that are partly covered pass."""

import re

import cv2
import numpy as np
import pytest

from inputs.campaign import CalibrationBoard
from register import board_counts, boards
from register.board_checks import check_photographs
from seen_boards import embedded, photographs, refused
from shared_files import shared

GRID_OF_SQUARES = {"type": "aruco_grid", "columns": 4, "rows": 8, "gap_m": 0.006, "square_m": None}


@pytest.mark.parametrize(
    ("change", "count", "words"),
    [
        ({"rows": 4}, 7, "go on below the last of the described 4 rows: write rows: 5"),
        (
            {"rows": 6},
            21,
            "no photograph shows a marker below row 5, though the place of row 6 is in view: write rows: 5",
        ),
        ({"columns": 5}, 7, "a board of 4 columns and 5 rows, not 5 and 5: write columns: 4, rows: 5"),
        ({"gap_m": 0.02}, 7, "is 0.88 of the distance from one marker to the next in the photographs, and 0.65 in the"),
        (
            {"type": "charuco", "square_m": 0.06, "columns": 8},
            7,
            "a grid of markers: write type: aruco_grid, .*columns: 4",
        ),
    ],
)
def test_another_grid_is_said(change, count, words):
    """Fails if what fits the description's first rows passes, or if a wrong gap is told to be photographed from the sides."""
    images, board = photographs(embedded(), count)
    assert re.search(words, refused(images, board.model_copy(update=change)))


@pytest.mark.parametrize(
    ("change", "words"),
    [
        ({"rows": 9}, "below row 8, though the place of row 9 is in view: write rows: 8"),
        ({"rows": 7}, "write rows: 8"),
        ({"columns": 9}, "8 columns and 8 rows, not 9 and 8: write columns: 8, rows: 8"),
        ({"marker_m": 0.015}, r"if marker_m: 0.015 is right, square_m is 0.0204$"),
        (GRID_OF_SQUARES, "a ChArUco board: write type: charuco, dictionary: DICT_4X4_1000, columns: 8, rows: 8"),
    ],
)
def test_another_board_of_markers_in_squares_is_said(change, words):
    """Fails if a count that is wrong by one is called swapped, or if squares' markers, stretched, pass for a grid."""
    images, board = photographs(shared("real/charuco_lifecam_480"), 8)
    assert re.search(words, refused(images, board.model_copy(update=change)))


def test_a_shaken_camera_prints_no_smaller_markers():
    """Fails if markers that blur makes smaller in one direction pass for a print of another size."""
    images, board = photographs(shared("real/charuco_lifecam_480"), 8)
    checked({name: cv2.blur(image, (1, 5)) for name, image in images.items()}, board)


def without_last_row(image, board):
    """Return an image with a board's last row of markers painted over."""
    image, lay = image.copy(), board_counts.layout(board)
    for i, quad in board_counts.seen_markers(boards.grey_8bit(image), board.dictionary).items():
        if lay.places[i][1] == board.rows - 1:
            cv2.fillConvexPoly(image, quad.astype(np.int32), (90, 90, 90))
    return image


def checked(images, board):
    """Check photographs of a board; raises InputError where they are refused."""
    found = {name: boards.find_board(image, board) for name, image in images.items()}
    check_photographs(found, board, images.get, "here")


def test_a_row_that_is_covered_in_all_but_one_photograph_is_there():
    """Fails if a board that is partly covered is refused, or if what is covered in all photographs is not."""
    images, board = photographs(embedded(), 21)
    covered = {name: without_last_row(image, board) for name, image in images.items()}
    assert "write rows: 4, or uncover" in refused(covered, board)
    name = list(images)[1]
    checked(covered | {name: images[name]}, board)


@pytest.mark.parametrize(
    "folder", ["charuco_screen_wide", "charuco_lifecam_480", "charuco_lifecam_1280_old_pattern", "aruco6x6_gridboard"]
)
def test_boards_as_described_pass(folder):
    """Fails if a wide lens, a board that the frame cuts, or stray ids are taken for another board."""
    checked(*photographs(shared(f"real/{folder}"), 100))


def test_layouts_number_markers_as_opencv_does():
    """Fails if a place is of the row from below, or of a pattern's other squares."""
    images, board = photographs(shared("real/charuco_lifecam_480"), 1)
    places = board_counts.layout(board).places
    assert places[0] == (1, 0) and places[4] == (0, 1) and places[31] == (6, 7) and len(places) == 32
    seen = board_counts.seen_markers(boards.grey_8bit(next(iter(images.values()))), board.dictionary)
    assert np.allclose(board_counts.centre(np.array([[0, 0], [2, 0], [2, 2], [0, 2]], float)), [1, 1])
    assert board_counts.in_place(seen, board_counts.layout(board)) == set(seen)


def test_a_row_beyond_the_frame_is_believed():
    """Fails if a row that the frame cuts off in all photographs is called missing, or one that is in view is believed."""
    board = CalibrationBoard(type="aruco_grid", dictionary="DICT_4X4_50", columns=4, rows=5, marker_m=0.04, gap_m=0.01)
    places = board_counts.layout(board).places
    square = 20.0 * np.array([[-1, -1], [1, -1], [1, 1], [-1, 1]])
    seen = {i: square + [50 * column + 50, 50 * row + 50] for i, (column, row) in places.items() if row < 4}
    assert board_counts.rows_shown([(seen, (270, 300))] * 6, board) == 5
    assert board_counts.rows_shown([(seen, (300, 300))] * 6, board) == 4
