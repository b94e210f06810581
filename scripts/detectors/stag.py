"""STag's own decoder through the optional package stag-python (MIT): squares with a ring, refined by the ring's ellipse."""

import re

import numpy as np

from detectors.contract import Detection, grey_image

PARAMETERS = {
    # Wrong bits that are corrected: more reads blurred and hidden codes and raises the risk of a false id. -1: all that
    # the library's distance allows.
    "wrong_bits": -1,
}

NEEDS = {"stag": "stag-python"}
FAMILY = re.compile(r"STAG_HD(11|13|15|17|19|21|23)")
MIN_PX = 32  # of an image's shorter side: the library's smoothing needs some


class StagDetector:
    """stag-python behind the contract: one call a library of codes."""

    def __init__(self, library, families, wrong_bits):
        self.library, self.wrong_bits = library, wrong_bits
        self.distances = {name: int(FAMILY.fullmatch(name)[1]) for name in families}

    def detect(self, image):
        """Return the Detections of an image (grey or colour, see contract.grey_image)."""
        grey = grey_image(image)
        if min(grey.shape) < MIN_PX:
            return []
        found = []
        for name, distance in self.distances.items():
            corners, ids, _ = self.library.detectMarkers(grey, distance, self.wrong_bits)
            found += [
                Detection(name, int(i), np.asarray(c, np.float64).reshape(4, 2))
                for c, i in zip(corners, np.ravel(ids), strict=True)
            ]
        return found


def reads(family):
    """Return whether it reads a family of markers."""
    return FAMILY.fullmatch(family) is not None


def make_detector(dictionaries, wrong_bits=-1):
    """Return the detector; ValueError for more wrong bits than a library's distance allows."""
    import stag

    detector = StagDetector(stag, dictionaries, wrong_bits)
    for name, distance in detector.distances.items():
        if not -1 <= wrong_bits <= (distance - 1) // 2:
            raise ValueError(f"wrong_bits is -1 to {(distance - 1) // 2} for {name}, not {wrong_bits}")
    return detector
