"""Boards of OpenCV's markers as objects of a rig: ChArUco boards and grids, each id with markers of its own.

``CHARUCO_7X5_75_DICT_5X5_100``: 7 columns, 5 rows of squares, markers of 75 % of a square. ``GRID_4X3_20_DICT_APRILTAG_36h11``:
4 columns and 3 rows of markers, gaps of 20 % of a marker. Id k has the markers after those of k - 1.
"""

import re
from types import SimpleNamespace

import numpy as np

from markers.contract import Drawing
from rig.board_markers import board_markers
from rig.plates import aruco_dictionary
from rig.targets import target_plate

FAMILIES = "boards such as CHARUCO_7X5_75_DICT_5X5_100 and GRID_4X3_20_DICT_APRILTAG_36h11"
CORNERS = "those of the smallest square about the board's middle that holds all squares of a ChArUco board, all markers of a grid"
PATTERN = re.compile(r"(CHARUCO|GRID)_([1-9]\d?)X([1-9]\d?)_([1-9]\d?)_(DICT_\w+)")
MIN_COUNT = 2  # columns and rows


def board_of(family):
    """Return the description of a family's board as rig.board_markers has it, lengths in sides of its square; None for another.

    Besides: ``width`` and ``height`` of all that is printed, ``markers``, how many a board has.
    """
    parts = PATTERN.fullmatch(family)
    if parts is None:
        return None
    kind, columns, rows, percent, dictionary = parts[1], *map(int, parts.groups()[1:4]), parts[5]
    try:
        aruco_dictionary(dictionary)
    except (ValueError, TypeError):
        return None
    if min(columns, rows) < MIN_COUNT:
        return None
    share = percent / 100
    board = SimpleNamespace(
        columns=columns, rows=rows, dictionary=dictionary, legacy_pattern=False, square_m=None, gap_m=None
    )
    if kind == "CHARUCO":
        unit = 1 / max(columns, rows)
        board.type, board.square_m, board.marker_m = "charuco", unit, share * unit
        board.width, board.height, board.markers = columns * unit, rows * unit, columns * rows // 2
    else:
        unit = 1 / (max(columns, rows) * (1 + share) - share)
        board.type, board.marker_m, board.gap_m = "aruco_grid", unit, share * unit
        board.width, board.height = ((n * (1 + share) - share) * unit for n in (columns, rows))
        board.markers = columns * rows
    return board


def ids(family):
    """Return how many boards the dictionary's markers are enough for, None for another family."""
    board = board_of(family)
    return None if board is None else len(aruco_dictionary(board.dictionary).bytesList) // board.markers


def draw(family, number):
    """Return the Drawing: the board's cells about its middle, white beside a board that is not square."""
    board = board_of(family)
    plate = target_plate(board, number * board.markers)
    x, y = plate.x_m[1:-1] - board.width / 2, plate.y_m[1:-1] - board.height / 2
    printed_x, printed_y = (
        (v > -half - 1e-9) & (v < half + 1e-9) for v, half in ((x, board.width / 2), (y, board.height / 2))
    )
    x, y = x[printed_x], y[printed_y]
    lines = np.sort(np.concatenate([x, y, [-0.5, 0.5]]))
    lines = lines[np.concatenate([[True], np.diff(lines) > 1e-9])]
    middles = (lines[1:] + lines[:-1]) / 2
    column, row = np.searchsorted(x, middles) - 1, np.searchsorted(y, middles) - 1
    inside = ((row >= 0) & (row < len(y) - 1))[:, None] & ((column >= 0) & (column < len(x) - 1))
    first_x, first_y = np.flatnonzero(printed_x)[0] + 1, np.flatnonzero(printed_y)[0] + 1
    shown = plate.white[
        np.clip(row + first_y, 0, len(plate.white) - 1)[:, None], np.clip(column + first_x, 0, plate.white.shape[1] - 1)
    ]
    return Drawing(np.where(inside, shown, True)[::-1], lines)


def marker_places(family, number):
    """Return (ids (n,), corners (n, 4, 2)) of a board's markers in sides of its square, x right and y down from its middle."""
    board = board_of(family)
    table = board_markers(board)
    x, y = table.x.to_numpy() - board.width / 2, board.height / 2 - table.y.to_numpy()
    half = board.marker_m / 2
    corners = np.array([[-half, -half], [half, -half], [half, half], [-half, half]])
    return table.id.to_numpy() + number * board.markers, np.stack([x, y], axis=1)[:, None] + corners
