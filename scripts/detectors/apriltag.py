"""AprilTag 3 through the optional package pupil-apriltags (BSD): reads AprilTag families, not ArUco's.

Here as the third party of the bench; corners are moved by half a pixel to OpenCV's convention.
"""

import numpy as np

from detectors.contract import Detection, grey_image
from rig.errors import InputError

PARAMETERS = {
    # Factor by which the image is shrunk for the search: larger is faster and misses small tags.
    "decimate": 2.0,
    # Threads of the library.
    "threads": 1,
}

FAMILIES = {
    "DICT_APRILTAG_16h5": "tag16h5",
    "DICT_APRILTAG_25h9": "tag25h9",
    "DICT_APRILTAG_36h11": "tag36h11",
}


class AprilTagDetector:
    """pupil-apriltags behind the contract."""

    def __init__(self, library, families, decimate, threads):
        self.names = {FAMILIES[name]: name for name in families}
        self.detector = library.Detector(" ".join(self.names), nthreads=threads, quad_decimate=decimate)

    def detect(self, image):
        """Return the Detections of an image (grey or colour, see contract.grey_image)."""
        grey = grey_image(image)
        if min(grey.shape) < 8:
            return []  # smaller than any tag
        found = self.detector.detect(grey)
        # The library counts corners the other way round from another corner and puts pixel centres at 0.5.
        return [
            Detection(
                self.names[d.tag_family.decode()],
                d.tag_id,
                np.roll(np.asarray(d.corners)[::-1], 2, axis=0) - 0.5,
            )
            for d in found
        ]


def make_detector(dictionaries, decimate=2.0, threads=1):
    """Return the detector.

    Raises InputError where the package is missing, ValueError where no dictionary is one of its families.
    """
    try:
        import pupil_apriltags
    except ImportError:
        raise InputError(
            "detector apriltag needs the package pupil-apriltags: install the optional extra 'bench'"
        ) from None
    families = [name for name in dictionaries if name in FAMILIES]
    if not families:
        raise ValueError(f"reads {', '.join(FAMILIES)} only, not {', '.join(dictionaries)}")
    return AprilTagDetector(pupil_apriltags, families, decimate, threads)
