"""Patches of a board: squares of known cells, whose black is the board's own."""

import numpy as np
import pytest

from inputs.campaign import CalibrationBoard
from rig.patches import board_patches, stacked
from rig.targets import target_plate

BOARDS = {
    "chessboard": {"type": "chessboard", "columns": 5, "rows": 4, "square_m": 0.03},
    "charuco": {
        "type": "charuco",
        "dictionary": "DICT_4X4_50",
        "columns": 5,
        "rows": 4,
        "square_m": 0.04,
        "marker_m": 0.03,
    },
    "aruco_grid": {
        "type": "aruco_grid",
        "dictionary": "DICT_4X4_50",
        "columns": 3,
        "rows": 2,
        "marker_m": 0.03,
        "gap_m": 0.01,
    },
}


def is_black(rectangles, x, y):
    """Return which of some points lie in one of rectangles (n, 4)."""
    x0, y0, x1, y1 = rectangles.T[..., None]
    return ((x > x0) & (x < x1) & (y > y0) & (y < y1)).any(axis=0)


@pytest.mark.parametrize("kind", BOARDS)
def test_a_patch_shows_the_boards_cells(kind):
    """Fails if a patch's black is turned, mirrored or shifted against the board that is printed and rendered."""
    board = CalibrationBoard.model_validate(BOARDS[kind])
    plate, patches = target_plate(board), board_patches(board, target_plate(board))
    rng = np.random.default_rng(1)
    for patch in patches:
        x, y = rng.uniform(-patch.half_patch, patch.half_patch, (2, 400)) + patch.centre[:, None]
        column = np.searchsorted(plate.x_m, x) - 1
        row = np.searchsorted(plate.y_m, y) - 1
        shown = is_black(patch.black, x - patch.centre[0], y - patch.centre[1])
        np.testing.assert_array_equal(shown, ~plate.white[row, column])
    assert len(patches) == {"chessboard": 6, "charuco": 3, "aruco_grid": 6}[kind]


@pytest.mark.parametrize("kind", BOARDS)
def test_a_patch_is_a_black_square_with_white_about_it(kind):
    """Fails if the corners by which a patch is found are not those of black on white."""
    board = CalibrationBoard.model_validate(BOARDS[kind])
    for patch in board_patches(board, target_plate(board)):
        h, d = patch.half_code, 1e-4
        a = h / 9  # between the lines of cells
        x, y = np.array([[a, h], [h, a], [a, -h], [-h, a]]).T
        assert is_black(patch.black, x * (1 - d / h), y * (1 - d / h)).all()
        assert not is_black(patch.black, x * (1 + d / h), y * (1 + d / h)).any()
        np.testing.assert_allclose(patch.corners.mean(axis=0)[:2], patch.centre)


def test_stacked_rectangles_cover_the_same():
    """Fails if rectangles that only touch by a part are made one."""
    apart = np.array([[0, 0, 1, 1], [0, 1, 1, 2], [1, 0, 2, 1], [0, 2, 2, 3], [0, 4, 1, 5]], float)
    one = stacked(apart)
    assert len(one) == 4
    x, y = np.random.default_rng(0).uniform(0, 5, (2, 500))
    np.testing.assert_array_equal(is_black(one, x, y), is_black(apart, x, y))
