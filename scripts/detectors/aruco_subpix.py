"""OpenCV's ArUco detector with its sub-pixel corner refinement."""

import cv2

from detectors._opencv import OpenCvDetector

PARAMETERS = {
    # Half side of the search window, pixels: wider averages noise, but reaches the marker's own bits.
    "window_px": 5,
    # The window as a share of a module, its upper limit: small markers get small windows.
    "relative_window": 0.3,
}


def make_detector(dictionaries, window_px=5, relative_window=0.3):
    """Return the detector; ValueError for a window that is not positive."""
    if window_px < 1 or relative_window <= 0:
        raise ValueError(f"window_px {window_px} and relative_window {relative_window} are to be positive")
    parameters = cv2.aruco.DetectorParameters()
    parameters.cornerRefinementMethod = cv2.aruco.CORNER_REFINE_SUBPIX
    parameters.cornerRefinementWinSize = window_px
    parameters.relativeCornerRefinmentWinSize = relative_window  # OpenCV's spelling
    return OpenCvDetector(dictionaries, parameters)
