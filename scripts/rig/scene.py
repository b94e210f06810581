"""The nominal scene of a campaign from its expanded tables: plates of markers, or one calibration board."""

import json
from pathlib import Path

import cv2
import numpy as np

from effects.base import Scene
from rig import tables
from rig.campaign import Board
from rig.plates import aruco_dictionary, board_plate, code_cells, marker_plate


def load_scene(expand):
    """Return the effects.base.Scene of an expand folder."""
    expand = Path(expand)
    facts = json.loads((expand / "scene.json").read_text())
    if facts["target"]:
        plates = (target_plate(Board.model_validate(facts["target"])),)
    else:
        plates = tuple(marker_plate(m) for m in tables.read_table(expand / "markers.csv", tables.MARKERS).itertuples())
    r = facts["reflectance"]
    return Scene(plates, r["white"], r["black"], r["ground"], r["background"])


def _code_rectangles(dictionary, marker_id, x0, y0, side):
    """Return rectangles (n, 5) of a code whose lower left corner is at x0, y0: a black square, white modules on it."""
    cells = code_cells(dictionary, marker_id)
    module = side / len(cells)
    rectangles = [[x0, y0, x0 + side, y0 + side, 0]]
    for row, column in np.argwhere(cells):
        x, y = x0 + column * module, y0 + side - (row + 1) * module
        rectangles.append([x, y, x + module, y + module, 1])
    return rectangles


def target_plate(board):
    """Return the Plate of a board; its frame: x right, y up, origin at the lower left corner of the squares."""
    if board.type == "chessboard":
        nx, ny, square = board.columns + 1, board.rows + 1, board.square_m
        black = [
            [i * square, j * square, (i + 1) * square, (j + 1) * square, 0]
            for j in range(ny)
            for i in range(nx)
            if (i + (ny - 1 - j)) % 2 == 0
        ]
        return board_plate(np.array(black), nx, ny, square)
    if board.type == "charuco":
        return _charuco_plate(board)
    return _grid_plate(board)


def _charuco_plate(board):
    nx, ny, square = board.columns, board.rows, board.square_m
    cv_board = cv2.aruco.CharucoBoard((nx, ny), square, board.marker_m, aruco_dictionary(board.dictionary))
    cv_board.setLegacyPattern(board.legacy_pattern)
    corners = np.array(cv_board.getObjPoints())[..., :2]  # y down from the top left corner
    with_marker = {(round(c[:, 0].mean() / square - 0.5), round(c[:, 1].mean() / square - 0.5)) for c in corners}
    rectangles = [
        [i * square, (ny - 1 - j) * square, (i + 1) * square, (ny - j) * square, 0]
        for j in range(ny)
        for i in range(nx)
        if (i, j) not in with_marker
    ]
    for marker_id, c in zip(cv_board.getIds().ravel(), corners, strict=True):
        rectangles += _code_rectangles(
            board.dictionary, marker_id, c[:, 0].min(), ny * square - c[:, 1].max(), board.marker_m
        )
    return board_plate(np.array(rectangles, float), nx, ny, square)


def _grid_plate(board):
    pitch = board.marker_m + board.gap_m
    rectangles = []
    for j in range(board.rows):
        for i in range(board.columns):
            y0 = (board.rows - 1 - j) * pitch
            rectangles += _code_rectangles(board.dictionary, j * board.columns + i, i * pitch, y0, board.marker_m)
    return board_plate(np.array(rectangles, float), board.columns, board.rows, pitch)
