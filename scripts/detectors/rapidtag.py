"""RapidTag through the optional package rapidtag (Apache-2.0): OpenCV's method written anew in Rust."""

import numpy as np

from detectors.contract import Detection, grey_image
from markers.contract import opencv_dictionary

PARAMETERS = {
    # Corners refined to parts of a pixel, as OpenCV's window search does; False leaves them at whole pixels, faster.
    "subpixel": True,
    # Half side of the search window, pixels: wider averages noise, but reaches the marker's own bits.
    "window_px": 5,
}

NEEDS = {"rapidtag": "rapidtag"}
MIN_PX, MIN_LONG_PX = 8, 24  # of an image's shorter and longer side


class RapidTagDetector:
    """rapidtag behind the contract: one call a dictionary."""

    def __init__(self, library, families, parameters):
        self.library, self.families, self.parameters = library, families, parameters

    def detect(self, image):
        """Return the Detections of an image (grey or colour, see contract.grey_image)."""
        grey = grey_image(image)
        if min(grey.shape) < MIN_PX or max(grey.shape) < MIN_LONG_PX:
            return []
        found = []
        for name in self.families:
            corners, ids = self.library.detect_markers(grey, name, self.parameters)
            found += [
                Detection(name, int(i), np.asarray(c, np.float64).reshape(4, 2))
                for c, i in zip(corners, ids, strict=True)
            ]
        return found


def reads(family):
    """Return whether it reads a family of markers: those that OpenCV ships."""
    return family.startswith("DICT_") and opencv_dictionary(family) is not None


def make_detector(dictionaries, subpixel=True, window_px=5):
    """Return the detector; ValueError for a window that is not positive."""
    import rapidtag

    if window_px < 1:
        raise ValueError(f"window_px is positive, not {window_px}")
    parameters = rapidtag.DetectorParameters()
    parameters.corner_refinement_method = rapidtag.CORNER_REFINE_SUBPIX if subpixel else rapidtag.CORNER_REFINE_NONE
    parameters.corner_refinement_win_size = window_px
    return RapidTagDetector(rapidtag, dictionaries, parameters)
