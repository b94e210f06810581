"""A colour mosaic: each pixel sees one colour, the others are interpolated from neighbours.

Bilinear interpolation; one parameter for each place that red can have in a block of 2 x 2, the share of that mosaic in
the image (1 is a real mosaic, of which a camera has one). Source: B. E. Bayer, US 3971065 (1976); bilinear reference of
Malvar, He and Cutler, "High-quality linear interpolation for demosaicing of Bayer-patterned color images" (2004).
"""

import cv2
import numpy as np

from effects.base import Parameter
from effects.filters import convolve

STAGE, ORDER = "sensor", 30
MAKES_COLOUR = True
RED = {"rggb": (0, 0), "grbg": (0, 1), "gbrg": (1, 0), "bggr": (1, 1)}  # row, column of red in the frame's first block
PARAMETERS = {
    name: Parameter("1", 0.0, 1.0, 0.0, (0.25,), 0.1, f"share of the mosaic that begins with {name.upper()}")
    for name in RED
}
CROSS = np.array([[0, 1, 0], [1, 4, 1], [0, 1, 0]]) / 4
SQUARE = np.array([[1, 2, 1], [2, 4, 2], [1, 2, 1]]) / 4


def interpolated(image, row, column):
    """Return the image as a mosaic shows it whose red pixels begin at array row and column (0 or 1)."""
    masks = np.zeros((*image.shape[:2], 3), np.float32)
    masks[row::2, column::2, 0] = 1
    masks[1 - row :: 2, column::2, 1] = 1
    masks[row::2, 1 - column :: 2, 1] = 1
    masks[1 - row :: 2, 1 - column :: 2, 2] = 1
    seen = image * masks
    # mirrored about the outermost pixels, so that the mosaic goes on beyond them
    planes = [convolve(seen[..., c], SQUARE if c != 1 else CROSS, cv2.BORDER_REFLECT_101) for c in range(3)]
    return np.stack(planes, axis=-1)


def apply(image, view, p, rng):
    """Sample the mosaics and interpolate them."""
    first = view.margin % 2
    out = image
    for name, (row, column) in RED.items():
        if p[name]:
            out = out + np.float32(p[name]) * (interpolated(image, (row + first) % 2, (column + first) % 2) - image)
    return out
