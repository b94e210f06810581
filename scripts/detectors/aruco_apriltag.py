"""OpenCV's ArUco detector with AprilTag's search and corners: quads by the gradient's clusters (Wang and Olson 2016).

It leaves AprilTag's convention in the corners, pixel centres at 0.5, against OpenCV's own: they are moved by half a pixel.
"""

from dataclasses import replace

import cv2

from detectors._opencv import OpenCvDetector

PARAMETERS = {
    # Factor by which the image is shrunk for the search of quads: larger is faster and misses small markers.
    "decimate": 0.0,
    # Standard deviation of the smoothing before the search, pixels: bears noise and loses small markers.
    "smoothing_px": 0.0,
}


class AprilTagCorners:
    """OpenCV's detector with its corners moved to OpenCV's convention."""

    def __init__(self, inner):
        self.inner = inner

    def detect(self, image):
        """Return the Detections of an image."""
        return [replace(found, corners=found.corners - 0.5) for found in self.inner.detect(image)]


def make_detector(dictionaries, decimate=0.0, smoothing_px=0.0):
    """Return the detector; ValueError for negative values."""
    if decimate < 0 or smoothing_px < 0:
        raise ValueError(f"decimate {decimate} and smoothing_px {smoothing_px} must not be negative")
    parameters = cv2.aruco.DetectorParameters()
    parameters.cornerRefinementMethod = cv2.aruco.CORNER_REFINE_APRILTAG
    parameters.aprilTagQuadDecimate = decimate
    parameters.aprilTagQuadSigma = smoothing_px
    return AprilTagCorners(OpenCvDetector(dictionaries, parameters))
