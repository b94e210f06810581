"""The markers of a calibration board as rows of the markers' table; board frame: x right, y up, in metres.

The origin is the lower left corner of the squares (of the lower left marker for a grid), as in inputs.scene.target_plate.
"""

import cv2
import numpy as np
import pandas as pd

from rig.plates import aruco_dictionary

COLUMNS = ["dictionary", "id", "code_m", "plate_m", "x", "y", "z", "rx", "ry", "rz"]


def charuco_board(board):
    """Return OpenCV's CharucoBoard of an inputs.campaign.CalibrationBoard; its y is down from the top left corner."""
    made = cv2.aruco.CharucoBoard(
        (board.columns, board.rows), board.square_m, board.marker_m, aruco_dictionary(board.dictionary)
    )
    made.setLegacyPattern(board.legacy_pattern)
    return made


def board_markers(board):
    """Return the markers' table of an inputs.campaign.CalibrationBoard; no row for a chessboard.

    A marker's plate is what is white around it: its square, or half the gap to its neighbours.
    """
    found = {"charuco": _charuco_markers, "chessboard": lambda board: ([], [], 0.0)}.get(board.type, _grid_markers)
    ids, centres, plate_m = found(board)
    rows = [
        [board.dictionary, int(k), board.marker_m, plate_m, *xy, *[0.0] * 4] for k, xy in zip(ids, centres, strict=True)
    ]
    return pd.DataFrame(rows, columns=COLUMNS)


def _charuco_markers(board):
    """Return (ids, centres (n, 2), side of the plates) of a ChArUco board."""
    made = charuco_board(board)
    centres = np.array(made.getObjPoints())[..., :2].mean(axis=1) / board.square_m  # float32
    columns, rows = np.floor(centres.T)
    return made.getIds().ravel(), np.stack([columns + 0.5, board.rows - rows - 0.5], 1) * board.square_m, board.square_m


def _grid_markers(board):
    """Return (ids, centres (n, 2), side of the plates) of a grid, numbered row by row from the top left."""
    pitch, ids = board.marker_m + board.gap_m, np.arange(board.columns * board.rows)
    rows, columns = ids // board.columns, ids % board.columns
    half = board.marker_m / 2
    return ids, np.stack([columns * pitch + half, (board.rows - 1 - rows) * pitch + half], axis=1), pitch
