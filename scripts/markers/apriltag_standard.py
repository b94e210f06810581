"""AprilTag's tagStandard41h12: bits inside and outside its border, so that small tags hold more of them.

Nine by nine cells: a ring of 32 bits, a ring of black, a ring of white, nine bits. Source: Krogius, Haggenmiller, Olson:
Flexible layouts for fiducial tags (2019).
"""

import base64
import functools

import numpy as np

from markers._standard41h12_codes import CODES
from markers.contract import Drawing

FAMILY = "tagStandard41h12"
FAMILIES = FAMILY
CORNERS = (
    "the inner corners of the black ring, where it meets the white one; a ring of black and one of bits lie outside"
)
CELLS, BORDER = 9, 5  # cells of the whole tag; of the square that the border is the edge of
# Places of the bits that a turn does not hold in, the first the most significant: x to the right and y down from the border.
OUTER = [(x, -2) for x in range(-2, 6)]
INNER = [(1, 1), (2, 1)]


def _places():
    """Return the places (41, 2) of the bits: a quarter of them, thrice turned clockwise, and the middle."""
    places = []
    for turn in range(4):
        for x, y in OUTER + INNER:
            for _ in range(turn):
                x, y = BORDER - 1 - y, x
            places.append((x, y))
    return np.array([*places, (2, 2)])


@functools.cache
def _codes():
    return np.frombuffer(base64.b64decode(CODES), np.uint8).reshape(-1, 6)


def ids(family):
    """Return how many ids the family has, None for another."""
    return len(_codes()) if family == FAMILY else None


def draw(family, number):
    """Return the Drawing: the border's square is the code's, two rings of cells lie outside."""
    beyond = (CELLS - BORDER) // 2
    white = np.zeros((CELLS, CELLS), bool)
    white[beyond : beyond + BORDER, beyond : beyond + BORDER] = True
    places = _places() + beyond
    white[places[:, 1], places[:, 0]] = np.unpackbits(_codes()[number])[-len(places) :].astype(bool)
    return Drawing(white, (np.arange(CELLS + 1) - CELLS / 2) / BORDER)
