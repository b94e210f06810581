"""OpenCV's predefined dictionaries, AprilTag's 16h5, 25h9, 36h10 and 36h11 among them: a square frame of black about bits.

Source: OpenCV's module aruco (Garrido-Jurado et al. 2014); AprilTag (Olson 2011; Wang and Olson 2016).
"""

import cv2

from markers.contract import Drawing
from rig.plates import aruco_dictionary, code_cells

FAMILIES = "OpenCV's dictionaries, such as DICT_5X5_1000 or DICT_APRILTAG_36h11"
CORNERS = "the outer corners of the black frame"


def ids(family):
    """Return how many ids a dictionary has, None for what is none of OpenCV's."""
    if not family.startswith("DICT_") or not hasattr(cv2.aruco, family):
        return None
    return len(aruco_dictionary(family).bytesList)


def draw(family, number):
    """Return the Drawing: the bits and the frame of one module around them."""
    return Drawing(code_cells(family, number))


def opencv_dictionary(family):
    """Return the dictionary."""
    return aruco_dictionary(family)
