"""STag: a black square with a white disc in it, and 48 discs of bits in that: a border of lines and one of a ring.

Source: Benligiray, Topal, Akinlar: STag, a stable fiducial marker system (2019). Bits are drawn as the discs that the
decoder looks at; the authors' own printing program also fills the gaps between neighbouring black ones.
"""

import base64
import functools

import numpy as np

from markers._stag_codes import CODES
from markers.contract import Drawing

FAMILIES = f"STag's libraries {', '.join(f'STAG_HD{distance}' for distance in CODES)}"
CORNERS = "the outer corners of the black square"
RING, BITS = 0.4, 0.7  # radius of the white disc; by what the places of bits are scaled: sides of the square
BIT = 0.0624 * BITS  # radius of a bit's disc: those of neighbours just do not touch
# Of twelve of the 48 places, the densest packing of as many discs in one: radius and angle (rad); the others are these turned.
PLACES = (
    (0.088363142525988, 0.785398163397448), (0.206935928182607, 0.459275804122858), (0.206935928182607, 1.111520522672039),
    (0.313672146827381, 0.200579720495241), (0.327493143484516, 0.591687617505840), (0.327493143484516, 0.979108709289057),
    (0.313672146827381, 1.370216606299656), (0.437421957035861, 0.145724938287167), (0.437226762361658, 0.433363129825345),
    (0.430628029742607, 0.785398163397448), (0.437226762361658, 1.137433196969552), (0.437421957035861, 1.425071388507730),
)  # fmt: skip


@functools.cache
def _codes(family):
    distance = int(family.removeprefix("STAG_HD"))
    return np.frombuffer(base64.b64decode(CODES[distance]), np.uint8).reshape(-1, 6)


@functools.cache
def _places():
    """Return the centres (48, 2) of the bits."""
    radius, angle = np.array(PLACES).T
    angle = (angle + np.pi / 2 * np.arange(4)[:, None]).ravel()
    return BITS * np.tile(radius, 4)[:, None] * np.stack([np.cos(angle), np.sin(angle)], axis=1)


def ids(family):
    """Return how many ids a library has, None for what is none."""
    return len(_codes(family)) if family in {f"STAG_HD{distance}" for distance in CODES} else None


def draw(family, number):
    """Return the Drawing: one black cell, a white disc, a black disc for each bit that is set."""
    bits = np.unpackbits(_codes(family)[number])[::-1].astype(bool)  # the last bit is that of the first place
    centres = _places()[bits]
    black = np.column_stack([centres, np.full(len(centres), BIT), np.zeros(len(centres))])
    return Drawing(np.zeros((1, 1), bool), discs=np.concatenate([[[0, 0, RING, 1]], black]))
