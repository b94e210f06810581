"""ChArUco boards and grids of markers as objects by OpenCV: all that is seen of a board, one plane through it.

The corners are those of the board's square on that plane: a lens that bends lines is not taken out.
"""

import cv2
import numpy as np

from detectors._opencv import square_by
from detectors.contract import Detection, grey_image
from markers.board import board_of, ids, marker_places
from rig.plates import aruco_dictionary

PARAMETERS = {
    # Least number of a board's points that have to be seen: fewer read boards that are hidden in part, and scatter more.
    "least_points": 8,
    # Farthest that a point may lie from the plane of the others, pixels: more bears noise and bent lenses.
    "farthest_px": 3.0,
}
WINDOW = 0.4  # of what a marker leaves of its square: half the side of the window in which a corner is refined


class BoardDetector:
    """Markers of each dictionary, and the board each id belongs to; ChArUco boards by the corners between their squares."""

    def __init__(self, families, least_points, farthest_px):
        self.least_points, self.farthest_px = least_points, farthest_px
        parameters = cv2.aruco.DetectorParameters()
        parameters.cornerRefinementMethod = cv2.aruco.CORNER_REFINE_SUBPIX
        self.finders = {}
        for family in families:
            dictionary = aruco_dictionary(board_of(family).dictionary)
            self.finders[family] = cv2.aruco.ArucoDetector(dictionary, parameters)

    def detect(self, image):
        """Return the Detections of an image (grey or colour, see contract.grey_image)."""
        grey = grey_image(image)
        if min(grey.shape) < 8 or max(grey.shape) < 24:
            return []
        found = []
        for family, finder in self.finders.items():
            corners, seen, _ = finder.detectMarkers(grey)
            quads = dict(
                zip([] if seen is None else np.ravel(seen).tolist(), np.reshape(corners, (-1, 4, 2)), strict=True)
            )
            markers = board_of(family).markers
            for number in sorted({k // markers for k in quads} & set(range(ids(family)))):
                square = self._square(grey, family, number, quads)
                if square is not None:
                    found.append(Detection(family, number, square))
        return found

    def _square(self, grey, family, number, quads):
        """Return the corners (4, 2) of a board's square, None where too little of it is seen."""
        own, places = marker_places(family, number)
        known = [k for k, marker in enumerate(own) if marker in quads]
        flat = places[known].reshape(-1, 2)
        pixels = np.reshape([quads[own[k]] for k in known], (-1, 2)).astype(float)
        H = self._plane(flat, pixels)
        if H is not None and board_of(family).type == "charuco":
            flat, pixels = _saddles(grey, family, H)
            H = self._plane(flat, pixels)
        return None if H is None else square_by(H)

    def _plane(self, flat, pixels):
        """Return the homography from a board to the image, None where too few points agree with one."""
        if len(flat) < self.least_points:
            return None
        H, agree = cv2.findHomography(flat, pixels, cv2.RANSAC, self.farthest_px)
        return H if H is not None and agree.sum() >= self.least_points else None


def _saddles(grey, family, H):
    """Return (places (n, 2) on the board, pixels (n, 2)) of the corners between squares that lie inside the image."""
    board = board_of(family)
    x, y = np.meshgrid(np.arange(1, board.columns), np.arange(1, board.rows))
    flat = np.stack([x.ravel(), y.ravel()], axis=1) * board.square_m - np.array([board.width, board.height]) / 2
    pixels = cv2.perspectiveTransform(flat[None], H)[0]
    near = cv2.perspectiveTransform((flat + [board.square_m, 0])[None], H)[0]
    # the window keeps off the markers, which lie half the rest of a square away
    free = WINDOW * (1 - board.marker_m / board.square_m)
    half = np.floor(free * np.linalg.norm(near - pixels, axis=1).min()).clip(2, 7)
    inside = (pixels > half + 1).all(axis=1) & (pixels < np.array(grey.shape[::-1]) - half - 2).all(axis=1)
    if not inside.any():
        return flat[:0], pixels[:0]
    steps = (cv2.TERM_CRITERIA_EPS + cv2.TERM_CRITERIA_MAX_ITER, 40, 0.001)
    fine = cv2.cornerSubPix(
        grey, np.ascontiguousarray(pixels[inside], np.float32).reshape(-1, 1, 2), (int(half),) * 2, (-1, -1), steps
    )
    return flat[inside], fine[:, 0].astype(float)


def reads(family):
    """Return whether it reads a family of markers."""
    return board_of(family) is not None


def make_detector(dictionaries, least_points=8, farthest_px=3.0):
    """Return the detector; ValueError for values that make no sense."""
    if least_points < 4 or farthest_px <= 0:
        raise ValueError(f"least_points {least_points} is at least 4, farthest_px {farthest_px} positive")
    return BoardDetector(dictionaries, least_points, farthest_px)
