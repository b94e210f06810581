"""Locus through the optional package locus-tag (MIT or Apache-2.0): a few families of ArUco's and AprilTag's.

Corners are moved by half a pixel to OpenCV's convention.
"""

import numpy as np

from detectors.contract import Detection, grey_image

PARAMETERS = {
    # The package's own settings: "standard", "high_accuracy" (slower, finer corners) or "render_tag" (exact edges).
    "profile": "standard",
    # Threads of the library.
    "threads": 1,
}

NEEDS = {"locus": "locus-tag"}
FAMILIES = {
    "DICT_4X4_50": "ArUco4x4_50",
    "DICT_4X4_100": "ArUco4x4_100",
    "DICT_6X6_250": "ArUco6x6_250",
    "DICT_ARUCO_MIP_36h12": "ArUcoMip36h12",
    "DICT_APRILTAG_16h5": "AprilTag16h5",
    "DICT_APRILTAG_36h11": "AprilTag36h11",
}
MIN_PX = 16  # of an image's shorter side


class LocusDetector:
    """locus-tag behind the contract: a detector a family, as its findings do not say which they are of."""

    def __init__(self, library, families, profile, threads):
        self.detectors = {
            name: library.Detector(
                profile=profile, threads=threads, families=[getattr(library.TagFamily, FAMILIES[name])]
            )
            for name in families
        }

    def detect(self, image):
        """Return the Detections of an image (grey or colour, see contract.grey_image)."""
        grey = grey_image(image)
        if min(grey.shape) < MIN_PX:
            return []
        found = []
        for name, detector in self.detectors.items():
            batch = detector.detect(grey)
            # The library puts pixel centres at 0.5.
            found += [
                Detection(name, int(i), np.asarray(c, np.float64) - 0.5)
                for i, c in zip(batch.ids, batch.corners, strict=True)
            ]
        return found


def reads(family):
    """Return whether it reads a family of markers."""
    return family in FAMILIES


def make_detector(dictionaries, profile="standard", threads=1):
    """Return the detector; ValueError for settings that the package does not know."""
    import locus

    try:
        return LocusDetector(locus, dictionaries, profile, threads)
    except (ValueError, FileNotFoundError) as error:
        raise ValueError(f"profile {profile!r}: {error}") from None
