"""Find a calibration board's points in a photograph; board frame: x right, y up, origin at the lower left corner."""

from dataclasses import dataclass

import cv2
import numpy as np

from rig.errors import InputError
from rig.plates import aruco_dictionary

SUBPIX_WINDOW = (5, 5)
SUBPIX_STOP = (cv2.TERM_CRITERIA_EPS + cv2.TERM_CRITERIA_MAX_ITER, 40, 0.001)
LEAST_POINTS = 8


@dataclass
class BoardPoints:
    """Points of a board found in one image: board (n, 3) metres, image (n, 2) pixels, number of markers decoded."""

    board: np.ndarray
    image: np.ndarray
    markers: int


def _y_up(points, height_m):
    """Turn OpenCV's board points (y down from the top left corner) into our frame."""
    out = np.array(points, float).reshape(-1, 3)
    out[:, 1] = height_m - out[:, 1]
    out[:, 2] = 0
    return out


def _grey(image):
    grey = image if image.ndim == 2 else cv2.cvtColor(image, cv2.COLOR_BGR2GRAY)
    return (grey // 257).astype(np.uint8) if grey.dtype == np.uint16 else grey


def _aruco_detector(dictionary):
    parameters = cv2.aruco.DetectorParameters()
    parameters.cornerRefinementMethod = cv2.aruco.CORNER_REFINE_SUBPIX
    return cv2.aruco.ArucoDetector(aruco_dictionary(dictionary), parameters)


def charuco_board(board):
    """Return OpenCV's CharucoBoard of a board's description."""
    made = cv2.aruco.CharucoBoard(
        (board.columns, board.rows), board.square_m, board.marker_m, aruco_dictionary(board.dictionary)
    )
    made.setLegacyPattern(board.legacy_pattern)
    return made


def _find_charuco(grey, board):
    cv_board = charuco_board(board)
    corners, ids, _, marker_ids = cv2.aruco.CharucoDetector(cv_board).detectBoard(grey)
    found = 0 if marker_ids is None else len(marker_ids)
    if ids is None or not len(ids):
        return BoardPoints(np.zeros((0, 3)), np.zeros((0, 2)), found)
    points = np.array(cv_board.getChessboardCorners())[np.ravel(ids)]
    return BoardPoints(_y_up(points, board.rows * board.square_m), np.reshape(corners, (-1, 2)).astype(float), found)


def _chessboard_points(board):
    i, j = np.meshgrid(np.arange(board.columns), np.arange(board.rows))
    s = board.square_m
    return np.stack([(i + 1) * s, (board.rows - j) * s, 0 * i], axis=-1).reshape(-1, 3).astype(float)


def _find_chessboard(grey, board):
    size = (board.columns, board.rows)
    flags = cv2.CALIB_CB_ADAPTIVE_THRESH + cv2.CALIB_CB_NORMALIZE_IMAGE
    found, corners = cv2.findChessboardCorners(grey, size, flags=flags)
    if not found:
        return BoardPoints(np.zeros((0, 3)), np.zeros((0, 2)), 0)
    corners = cv2.cornerSubPix(grey, corners, SUBPIX_WINDOW, (-1, -1), SUBPIX_STOP)
    return BoardPoints(_chessboard_points(board), corners.reshape(-1, 2).astype(float), 0)


def find_chessboard_by_sectors(image, board):
    """Return the BoardPoints of OpenCV's sector-based chessboard finder."""
    found, corners = cv2.findChessboardCornersSB(_grey(image), (board.columns, board.rows))
    if not found:
        return BoardPoints(np.zeros((0, 3)), np.zeros((0, 2)), 0)
    return BoardPoints(_chessboard_points(board), corners.reshape(-1, 2).astype(float), 0)


def _find_grid(grey, board):
    corners, ids, _ = _aruco_detector(board.dictionary).detectMarkers(grey)
    pitch, side = board.marker_m + board.gap_m, board.marker_m
    height = board.rows * pitch - board.gap_m
    points, pixels = [], []
    for quad, marker in zip(corners, [] if ids is None else np.ravel(ids), strict=True):
        if marker < board.columns * board.rows:
            x, y = (marker % board.columns) * pitch, (marker // board.columns) * pitch
            points.append([[x, y, 0], [x + side, y, 0], [x + side, y + side, 0], [x, y + side, 0]])
            pixels.append(quad.reshape(4, 2))
    if not points:
        return BoardPoints(np.zeros((0, 3)), np.zeros((0, 2)), 0)
    return BoardPoints(_y_up(points, height + board.gap_m), np.array(pixels, float).reshape(-1, 2), len(points))


def find_board(image, board):
    """Return the BoardPoints of an image (H, W) or (H, W, 3); empty where the board is not seen."""
    finder = {"charuco": _find_charuco, "chessboard": _find_chessboard}.get(board.type, _find_grid)
    return finder(_grey(image), board)


def check_legacy_pattern(images, board):
    """Raise InputError where markers decode, no corner is found, and the other legacy flag finds corners."""
    if board.type != "charuco":
        return
    other = board.model_copy(update={"legacy_pattern": not board.legacy_pattern})
    for image in images:
        if find_board(image, board).markers >= 4 and len(find_board(image, other).image) >= LEAST_POINTS:
            is_, was = ("true", "false") if other.legacy_pattern else ("false", "true")
            raise InputError(
                f"target.legacy_pattern is {was}, but the photographs show the board with legacy_pattern: {is_} "
                "(markers are read, no corners fit; boards printed before OpenCV 4.6 have the legacy pattern)"
            )
