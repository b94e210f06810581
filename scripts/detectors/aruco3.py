"""OpenCV's ArUco3 mode: contours are sought in a smaller image, corners refined upwards (Romero-Ramirez 2018)."""

import cv2

from detectors._opencv import OpenCvDetector

PARAMETERS = {
    # Side in pixels to which the smallest marker is shrunk: smaller is faster and loses ids to the shrinking.
    "canonical_side_px": 32,
    # Smallest marker as a share of the image's longer side: larger is faster and blind to small markers.
    "smallest_ratio": 0.0,
}


def make_detector(dictionaries, canonical_side_px=32, smallest_ratio=0.0):
    """Return the detector; ValueError for values outside these limits."""
    if canonical_side_px < 8 or not 0 <= smallest_ratio <= 1:
        raise ValueError("canonical_side_px is at least 8, smallest_ratio in [0, 1]")
    parameters = cv2.aruco.DetectorParameters()
    parameters.useAruco3Detection = True
    parameters.minSideLengthCanonicalImg = canonical_side_px
    parameters.minMarkerLengthRatioOriginalImg = smallest_ratio
    parameters.cornerRefinementMethod = cv2.aruco.CORNER_REFINE_SUBPIX
    return OpenCvDetector(dictionaries, parameters)
