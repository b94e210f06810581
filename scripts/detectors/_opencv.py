"""OpenCV's own detector behind the contract, for the files that differ by its parameters alone."""

import cv2
import numpy as np

from detectors.contract import Detection, grey_image
from markers.contract import opencv_dictionary


def square_by(H):
    """Return the corners (4, 2) in pixels of the code's square, its side 1 and y down, by the homography of its plane."""
    square = np.array([[[-0.5, -0.5], [0.5, -0.5], [0.5, 0.5], [-0.5, 0.5]]])
    return cv2.perspectiveTransform(square, H)[0]


class OpenCvDetector:
    """``cv2.aruco.ArucoDetector`` for several dictionaries; the same code serves OpenCV 4 and 5.

    One call searches all dictionaries where OpenCV has it (4.12 and later): contours and quads, most of the
    work, are then found once. Ids are the same as with one call a dictionary.
    """

    def __init__(self, dictionaries, parameters):
        self.names = tuple(dictionaries)
        tables = [opencv_dictionary(name) for name in self.names]
        self.together = hasattr(cv2.aruco.ArucoDetector, "detectMarkersMultiDict")
        if self.together:
            self.detectors = [cv2.aruco.ArucoDetector(tables, parameters)]
        else:
            self.detectors = [cv2.aruco.ArucoDetector(table, parameters) for table in tables]

    def detect(self, image):
        """Return the Detections of an image (grey or colour, see contract.grey_image)."""
        grey = grey_image(image)
        if min(grey.shape) < 8 or max(grey.shape) < 24:
            return []  # smaller than any marker; OpenCV raises, or aruco3 shrinks it to nothing
        if self.together:
            corners, ids, _, which = self.detectors[0].detectMarkersMultiDict(grey)
            which = [] if ids is None else np.ravel(which)
        else:
            corners, ids, which = [], [], []
            for k, detector in enumerate(self.detectors):
                c, i, _ = detector.detectMarkers(grey)
                found = [] if i is None else np.ravel(i)
                corners, ids, which = [*corners, *c], [*ids, *found], [*which, *[k] * len(found)]
        ids = [] if ids is None else np.ravel(ids)
        return [
            Detection(self.names[int(k)], int(i), np.asarray(c, np.float64).reshape(4, 2))
            for c, i, k in zip(corners, ids, which, strict=True)
        ]
