"""Find a calibration board's points in a photograph; board frame: x right, y up, z out of the paper, in metres.

The origin is the lower left corner of the squares (of the lower left marker for a grid), which is the frame of
rig.targets.target_plate; OpenCV's boards have y down from the top left corner. Only the order of points is turned:
OpenCV's pixel convention (centre of the top-left pixel at (0, 0)) is ours.
"""

from dataclasses import dataclass

import cv2
import numpy as np

from rig.board_markers import charuco_board
from rig.errors import InputError
from rig.plates import aruco_dictionary

SUBPIX_WINDOW = (5, 5)
SUBPIX_STOP = (cv2.TERM_CRITERIA_EPS + cv2.TERM_CRITERIA_MAX_ITER, 40, 0.001)
MIN_POINTS = 8
MAX_OFF_LINE = 0.1  # of a square: corners of cut squares are 0.16 to 0.5 off
MAX_BENT = 0.2  # of a square, that a wide lens bends the ends of lines by
SHARPENED = 4.0  # strength of unsharp masking, where blurred markers are read
SHARPENED_WIDTH = 1 / 200  # its standard deviation, of the longer side
CHARUCO_OFFSET_PX = 0.5  # of the installed OpenCV's corners (opencv#25539, gone with pull request 28380)


@dataclass
class BoardPoints:
    """Points of a board found in one image.

    board    (n, 3) metres
    image    (n, 2) pixels
    markers  number of markers decoded
    inverted whether a chessboard's black and white are swapped against our board, whichever way it is turned
    """

    board: np.ndarray
    image: np.ndarray
    markers: int
    inverted: bool = False


def nothing_found(markers=0):
    """Return BoardPoints without a point."""
    return BoardPoints(np.zeros((0, 3)), np.zeros((0, 2)), markers)


def _y_up(points, height_m):
    """Turn OpenCV's board points (y down from the top left corner) into our frame."""
    out = np.array(points, float).reshape(-1, 3)
    out[:, 1] = height_m - out[:, 1]
    out[:, 2] = 0
    return out


def grey_8bit(image):
    """Return an image (H, W) or (H, W, 3), 8 or 16 bits, as uint8 (H, W)."""
    grey = image if image.ndim == 2 else cv2.cvtColor(image, cv2.COLOR_BGR2GRAY)
    return (grey // 257).astype(np.uint8) if grey.dtype == np.uint16 else grey


def aruco_detector(dictionary):
    """Return OpenCV's detector of a dictionary's markers, corners to a fraction of a pixel."""
    parameters = cv2.aruco.DetectorParameters()
    parameters.cornerRefinementMethod = cv2.aruco.CORNER_REFINE_SUBPIX
    return cv2.aruco.ArucoDetector(aruco_dictionary(dictionary), parameters)


def sharpened(grey):
    """Return an image (H, W) of 8 bits less its blurred self (unsharp masking): markers that blur has closed come apart."""
    blurred = cv2.GaussianBlur(grey, (0, 0), SHARPENED_WIDTH * max(grey.shape))
    return cv2.addWeighted(grey, 1 + SHARPENED, blurred, -SHARPENED, 0)


def number_of(ids):
    """Return how many ids (n, 1) OpenCV gives, which gives None where there are none."""
    return 0 if ids is None else len(ids)


def _find_charuco(grey, board):
    """Return the BoardPoints of a ChArUco board; of a blurred one markers are read in the sharpened image, corners found in the
    photograph itself.
    """
    cv_board = charuco_board(board)
    # As they come, corners end a tenth of a pixel from where they would settle.
    parameters = cv2.aruco.DetectorParameters()
    _, parameters.cornerRefinementMaxIterations, parameters.cornerRefinementMinAccuracy = SUBPIX_STOP
    detector = cv2.aruco.CharucoDetector(cv_board, detectorParams=parameters)
    looks = [detector.detectBoard(grey)]
    if number_of(looks[0][1]) < MIN_POINTS:
        read, read_ids, _ = cv2.aruco.ArucoDetector(cv_board.getDictionary(), parameters).detectMarkers(sharpened(grey))
        if len(read):
            looks.append(detector.detectBoard(grey, markerCorners=read, markerIds=read_ids))
    corners, ids, _, marker_ids = max(looks, key=lambda look: number_of(look[1]))
    found = number_of(marker_ids)
    if not number_of(ids):
        return nothing_found(found)
    points = np.array(cv_board.getChessboardCorners())[np.ravel(ids)]
    image = np.reshape(corners, (-1, 2)).astype(float) - CHARUCO_OFFSET_PX
    return BoardPoints(_y_up(points, board.rows * board.square_m), image, found)


def _chessboard_points(board):
    i, j = np.meshgrid(np.arange(board.columns), np.arange(board.rows))
    s = board.square_m
    return np.stack([(i + 1) * s, (board.rows - j) * s, 0 * i], axis=-1).reshape(-1, 3).astype(float)


def _ordered_chessboard(grey, board, corners):
    """Return BoardPoints of a chessboard's corners, turned so that black squares lie where our board has them.

    The finders start at any of the board's corners, as its colours need not tell which way is up; our board has
    a black square at the top left. Where no turn brings black to black, the board is ``inverted``.
    """
    grid = np.reshape(corners, (board.rows, board.columns, 2)).astype(float)
    if np.cross([*(grid[0, -1] - grid[0, 0]), 0], [*(grid[-1, 0] - grid[0, 0]), 0])[2] < 0:
        grid = grid[:, ::-1]  # numbered as in a mirror
    turned = [np.rot90(grid, k) for k in range(4)]
    turned = [g for g in turned if g.shape == grid.shape]
    right = next((g for g in turned if _black_is_black(grey, g)), None)
    grid = turned[0] if right is None else right
    whole = whole_corners(grid, grey.shape).ravel()
    return BoardPoints(_chessboard_points(board)[whole], grid.reshape(-1, 2)[whole], 0, inverted=right is None)


def whole_corners(grid, shape):
    """Return which corners (rows, columns) of a grid (rows, columns, 2), pixels, are those of whole squares in a frame
    (height, width): all but outer ones whose squares the frame cuts and that lie elsewhere than their lines go on. OpenCV
    takes the corners of what is left of such squares.
    """
    whole, size = np.ones(grid.shape[:2], bool), np.array(shape[1::-1])
    for turns in range(4):
        g, w = np.rot90(grid, turns), np.rot90(whole, turns)  # a view: what is set in it is set in ``whole``
        if len(g) > 3:
            expected = 3 * g[1] - 3 * g[2] + g[3]  # perspective is smooth
            side = np.linalg.norm(g[1] - g[2], axis=1, keepdims=True)
            off = (g[0] - expected) / side
            bent = np.median(off, axis=0)  # a lens bends the ends of all lines alike
            off -= bent if np.linalg.norm(bent) < MAX_BENT else 0.0
            beyond = 2 * expected - g[1]
            is_cut = ((beyond < -0.5) | (beyond > size - 0.5)).any(1)
            w[0] &= ~is_cut | (np.linalg.norm(off, axis=1) < MAX_OFF_LINE)
    return whole


def _black_is_black(grey, grid):
    """Return whether squares of even row + column, the top left one of the whole board being (0, 0), are the darker."""
    centres = (grid[:-1, :-1] + grid[1:, :-1] + grid[:-1, 1:] + grid[1:, 1:]) / 4  # of squares (1, 1), (1, 2), ...
    x = np.clip(centres[..., 0].round().astype(int), 0, grey.shape[1] - 1)
    y = np.clip(centres[..., 1].round().astype(int), 0, grey.shape[0] - 1)
    even = np.add.outer(np.arange(x.shape[0]), np.arange(x.shape[1])) % 2 == 0
    value = grey[y, x].astype(float)
    return value[even].mean() < value[~even].mean() if (~even).any() else True


def _find_chessboard(grey, board):
    size = (board.columns, board.rows)
    flags = cv2.CALIB_CB_ADAPTIVE_THRESH + cv2.CALIB_CB_NORMALIZE_IMAGE
    found, corners = cv2.findChessboardCorners(grey, size, flags=flags)
    if not found:
        return nothing_found()
    corners = cv2.cornerSubPix(grey, corners, SUBPIX_WINDOW, (-1, -1), SUBPIX_STOP)
    return _ordered_chessboard(grey, board, corners)


def find_chessboard_by_sectors(image, board):
    """Return the BoardPoints of OpenCV's sector-based chessboard finder (Duda and Frese 2018)."""
    grey = grey_8bit(image)
    found, corners = cv2.findChessboardCornersSB(grey, (board.columns, board.rows))
    return _ordered_chessboard(grey, board, corners) if found else nothing_found()


def _find_grid(grey, board):
    corners, ids, _ = aruco_detector(board.dictionary).detectMarkers(grey)
    pitch, side = board.marker_m + board.gap_m, board.marker_m
    height = board.rows * pitch - board.gap_m
    points, pixels = [], []
    for quad, marker in zip(corners, [] if ids is None else np.ravel(ids), strict=True):
        if marker < board.columns * board.rows:
            x, y = (marker % board.columns) * pitch, (marker // board.columns) * pitch
            points.append([[x, y, 0], [x + side, y, 0], [x + side, y + side, 0], [x, y + side, 0]])
            pixels.append(quad.reshape(4, 2))
    if not points:
        return nothing_found()
    return BoardPoints(_y_up(points, height), np.array(pixels, float).reshape(-1, 2), len(points))


def find_board(image, board):
    """Return the BoardPoints of an image (H, W) or (H, W, 3); empty where the board is not seen."""
    finder = {"charuco": _find_charuco, "chessboard": _find_chessboard}.get(board.type, _find_grid)
    return finder(grey_8bit(image), board)


def check_legacy_pattern(images, board, where):
    """Raise InputError where markers decode, no corner is found, and the other legacy flag finds corners.

    where  file and key of the board's description, for the message
    """
    if board.type != "charuco":
        return
    other = board.model_copy(update={"legacy_pattern": not board.legacy_pattern})
    for image in images:
        if find_board(image, board).markers >= 4 and len(find_board(image, other).image) >= MIN_POINTS:
            said = ("false", "the legacy pattern") if other.legacy_pattern else ("true", "the pattern of today")
            raise InputError(
                f"{where}: legacy_pattern is {said[0]} but the photographs show {said[1]} (all markers are read, no "
                f"corner fits; boards printed before OpenCV 4.6 have the legacy pattern): set it to "
                f"{str(other.legacy_pattern).lower()}"
            )
