"""AprilTag 3 through the optional package pupil-apriltags (BSD): reads AprilTag's families, not ArUco's.

Corners are moved by half a pixel to OpenCV's convention.
"""

import numpy as np

from detectors.contract import Detection, grey_image

PARAMETERS = {
    # Factor by which the image is shrunk for the search: larger is faster and misses small tags.
    "decimate": 2.0,
    # Threads of the library.
    "threads": 1,
}

NEEDS = {"pupil_apriltags": "pupil-apriltags"}
# What the library calls a family, and by how many quarters OpenCV draws it turned against AprilTag's own drawings.
FAMILIES = {
    "DICT_APRILTAG_16h5": ("tag16h5", 2),
    "DICT_APRILTAG_25h9": ("tag25h9", 2),
    "DICT_APRILTAG_36h11": ("tag36h11", 2),
    "tagStandard41h12": ("tagStandard41h12", 0),
}


def _leave_it(detector):
    """Free nothing: the package frees families before the detector that still looks at them, which breaks the heap."""


class AprilTagDetector:
    """pupil-apriltags behind the contract; a detector a family: the package takes one of several and leaves out the rest."""

    def __init__(self, library, families, decimate, threads):
        kept = type("Kept", (library.Detector,), {"__del__": _leave_it})
        self.detectors = {name: kept(FAMILIES[name][0], nthreads=threads, quad_decimate=decimate) for name in families}

    def detect(self, image):
        """Return the Detections of an image (grey or colour, see contract.grey_image)."""
        grey = grey_image(image)
        if min(grey.shape) < 8:
            return []  # smaller than any tag
        # The library counts corners the other way round from the lower left and puts pixel centres at 0.5.
        return [
            Detection(name, d.tag_id, np.roll(np.asarray(d.corners)[::-1], FAMILIES[name][1], axis=0) - 0.5)
            for name, detector in self.detectors.items()
            for d in detector.detect(grey)
        ]


def reads(family):
    """Return whether it reads a family of markers."""
    return family in FAMILIES


def make_detector(dictionaries, decimate=2.0, threads=1):
    """Return the detector; ValueError for values that make no sense."""
    import pupil_apriltags

    if decimate < 1 or threads < 1:
        raise ValueError(f"decimate {decimate} and threads {threads} are to be at least 1")
    return AprilTagDetector(pupil_apriltags, dictionaries, decimate, threads)
