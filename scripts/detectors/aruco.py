"""OpenCV's ArUco detector as it comes: default parameters, corners as the contours have them."""

import cv2

from detectors._opencv import OpenCvDetector

PARAMETERS = {}


def make_detector(dictionaries):
    """Return the detector."""
    return OpenCvDetector(dictionaries, cv2.aruco.DetectorParameters())
