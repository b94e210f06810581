"""Circle grids by OpenCV: blobs, their grid, one plane through their centres.

The centre of a disc's image is not the image of its centre: seen obliquely the corners lean, the more the larger the discs are.
Of the two ways in which a symmetric grid may lie, the one is taken whose top is further up in the image: a plate that lies
more than a quarter turn from upright is told half a turn off.
"""

import cv2
import numpy as np

from detectors._opencv import square_by
from detectors.contract import Detection, grey_image
from markers.circle_grid import centres_of, grid_of

PARAMETERS = {
    # Smallest disc, square pixels: less finds farther grids and more clutter.
    "least_area_px": 20.0,
}
MIN_PX, MAX_PAPERS = 24, 8  # side of an image or paper; bright regions that are looked at


class CircleGridDetector:
    """cv2.findCirclesGrid, one grid a family."""

    def __init__(self, families, least_area_px):
        self.families = families
        parameters = cv2.SimpleBlobDetector_Params()
        parameters.minArea, parameters.maxArea = least_area_px, 1e7
        parameters.minDistBetweenBlobs = 2.0
        self.blobs = cv2.SimpleBlobDetector_create(parameters)

    def detect(self, image):
        """Return the Detections of an image (grey or colour, see contract.grey_image)."""
        grey = grey_image(image)
        if min(grey.shape) < MIN_PX:
            return []
        papers = _papers(grey)
        return [found for family in self.families if (found := self._find(grey, papers, family)) is not None]

    def _find(self, grey, papers, family):
        """Return the Detection of a family's grid on one of the papers (boxes), None where none shows it."""
        columns, rows, _, alike = grid_of(family)
        kind = cv2.CALIB_CB_SYMMETRIC_GRID if alike else cv2.CALIB_CB_ASYMMETRIC_GRID
        for x, y, width, height in papers:
            part = np.ascontiguousarray(grey[y : y + height, x : x + width])
            seen, pixels = cv2.findCirclesGrid(part, (columns, rows), flags=kind, blobDetector=self.blobs)
            if seen:
                H, _ = cv2.findHomography(centres_of(family)[0], pixels.reshape(-1, 2) + [x, y])
                return Detection(family, 0, upright(square_by(H)) if alike else square_by(H))
        return None


def upright(corners):
    """Return the corners (4, 2) of what looks alike upside down, not mirrored, its top side further up than its bottom side."""
    (ax, ay), (bx, by) = corners[1] - corners[0], corners[3] - corners[0]
    if ax * by - ay * bx < 0:
        corners = corners[[1, 0, 3, 2]]
    return corners if corners[:2, 1].sum() < corners[2:, 1].sum() else np.roll(corners, 2, axis=0)


def _papers(grey):
    """Return the boxes (x, y, width, height) in which a grid is sought: the image, then each bright region, the largest first.

    OpenCV gives up where other dark spots lie about: a grid has a paper of its own.
    """
    _, bright = cv2.threshold(grey, 0, 255, cv2.THRESH_BINARY + cv2.THRESH_OTSU)
    _, _, stats, _ = cv2.connectedComponentsWithStats(bright)
    boxes = [tuple(map(int, s[:4])) for s in sorted(stats[1:].tolist(), key=lambda s: -s[cv2.CC_STAT_AREA])]
    large = [box for box in boxes if min(box[2:]) >= MIN_PX]
    return [(0, 0, grey.shape[1], grey.shape[0]), *large[:MAX_PAPERS]]


def reads(family):
    """Return whether it reads a family of markers: OpenCV finds no symmetric grid whose sides are both odd."""
    columns, rows, _, alike = grid_of(family) or (1, 1, None, True)
    return not (alike and columns % 2 and rows % 2)


def make_detector(dictionaries, least_area_px=20.0):
    """Return the detector; ValueError for an area that is not positive."""
    if not least_area_px > 0:
        raise ValueError(f"least_area_px is positive, not {least_area_px}")
    return CircleGridDetector(dictionaries, least_area_px)
