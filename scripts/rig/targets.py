"""Plates of calibration boards: chessboard, ChArUco, grid of markers."""

from dataclasses import replace

import numpy as np

from rig.board_markers import board_markers
from rig.plates import board_plate, code_cells


def _code_rectangles(marker):
    """Return rectangles (n, 5) of a flat marker, a row of the markers' table: a black square, white modules on it."""
    cells = code_cells(marker.dictionary, marker.id)
    side, module = marker.code_m, marker.code_m / len(cells)
    x0, y0 = marker.x - side / 2, marker.y - side / 2
    rectangles = [[x0, y0, x0 + side, y0 + side, 0]]
    for row, column in np.argwhere(cells):
        x, y = x0 + column * module, y0 + side - (row + 1) * module
        rectangles.append([x, y, x + module, y + module, 1])
    return rectangles


def target_plate(board, first_id=0):
    """Return the Plate of a board; its frame: x right, y up, origin at the lower left corner of the squares.

    first_id  of its markers, which count up from there
    """
    markers = board_markers(board)
    markers["id"] += first_id
    codes = [rectangle for m in markers.itertuples() for rectangle in _code_rectangles(m)]
    if board.type == "chessboard":
        nx, ny, side = board.columns + 1, board.rows + 1, board.square_m
        squares = [(i, j) for j in range(ny) for i in range(nx) if (i + (ny - 1 - j)) % 2 == 0]
    elif board.type == "charuco":
        nx, ny, side = board.columns, board.rows, board.square_m
        with_marker = {(int(m.x // side), int(m.y // side)) for m in markers.itertuples()}
        squares = [(i, j) for j in range(ny) for i in range(nx) if (i, j) not in with_marker]
    else:
        nx, ny, side, squares = board.columns, board.rows, board.marker_m + board.gap_m, []
    black = [[i * side, j * side, (i + 1) * side, (j + 1) * side, 0] for i, j in squares]
    return board_plate(np.array(black + codes, float), nx, ny, side)


def inverted_plate(plate):
    """Return the Plate of a board whose black and white are swapped; the paper about it stays white."""
    white = plate.white.copy()
    white[1:-1, 1:-1] = ~white[1:-1, 1:-1]
    return replace(plate, white=white)
