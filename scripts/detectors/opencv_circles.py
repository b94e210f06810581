"""Circle grids by OpenCV: blobs, their grid, one plane through their centres.

The centre of a disc's image is not the image of its centre: seen obliquely the corners lean, the more the larger the discs are.
"""

import cv2
import numpy as np

from detectors.contract import Detection, grey_image
from markers.circle_grid import PATTERN, centres_of

PARAMETERS = {
    # Smallest disc, square pixels: less finds farther grids and more clutter.
    "least_area_px": 20.0,
}


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
        if min(grey.shape) < 24:
            return []
        found = []
        for family in self.families:
            columns, rows = map(int, PATTERN.fullmatch(family).groups()[:2])
            seen, pixels = cv2.findCirclesGrid(
                grey, (columns, rows), flags=cv2.CALIB_CB_ASYMMETRIC_GRID, blobDetector=self.blobs
            )
            if seen:
                H, _ = cv2.findHomography(centres_of(family)[0], pixels.reshape(-1, 2))
                square = np.array([[[-0.5, -0.5], [0.5, -0.5], [0.5, 0.5], [-0.5, 0.5]]])
                found.append(Detection(family, 0, cv2.perspectiveTransform(square, H)[0]))
        return found


def reads(family):
    """Return whether it reads a family of markers."""
    return PATTERN.fullmatch(family) is not None


def make_detector(dictionaries, least_area_px=20.0):
    """Return the detector; ValueError for an area that is not positive."""
    if not least_area_px > 0:
        raise ValueError(f"least_area_px is positive, not {least_area_px}")
    return CircleGridDetector(dictionaries, least_area_px)
