"""A colour mosaic: each pixel sees one colour, the others are interpolated from neighbours.

One parameter for each place that red can have in a block of 2 x 2, the share of that mosaic in the image (1 is a real
mosaic, of which a camera has one). Interpolation is bilinear, or to the share ``corrected`` that of Malvar, which adds the
Laplacian of the colour that was seen. Source: B. E. Bayer, US 3971065 (1976); Malvar, He and Cutler, "High-quality linear
interpolation for demosaicing of Bayer-patterned color images" (2004).
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
} | {"corrected": Parameter("1", 0.0, 1.0, 0.0, (0.5,), 0.1, "share of Malvar's correction; nothing without a mosaic")}
CROSS = np.array([[0, 1, 0], [1, 4, 1], [0, 1, 0]]) / 4
SQUARE = np.array([[1, 2, 1], [2, 4, 2], [1, 2, 1]]) / 4


# Malvar, He and Cutler, figure 2: green where red or blue was seen; a colour beside its own in the row; across the block
GREEN = np.array([[0, 0, -1, 0, 0], [0, 0, 2, 0, 0], [-1, 2, 4, 2, -1], [0, 0, 2, 0, 0], [0, 0, -1, 0, 0]]) / 8
BESIDE = np.array([[0, 0, 0.5, 0, 0], [0, -1, 0, -1, 0], [-1, 4, 5, 4, -1], [0, -1, 0, -1, 0], [0, 0, 0.5, 0, 0]]) / 8
ACROSS = np.array([[0, 0, -1.5, 0, 0], [0, 2, 0, 2, 0], [-1.5, 0, 6, 0, -1.5], [0, 2, 0, 2, 0], [0, 0, -1.5, 0, 0]]) / 8


def masks_of(shape, row, column):
    """Return which pixels see red, green, blue (rows, columns, 3), float32, of a mosaic whose red begins at row, column."""
    masks = np.zeros((*shape, 3), np.float32)
    masks[row::2, column::2, 0] = 1
    masks[1 - row :: 2, column::2, 1] = 1
    masks[row::2, 1 - column :: 2, 1] = 1
    masks[1 - row :: 2, 1 - column :: 2, 2] = 1
    return masks


def _mirrored(plane, kernel):
    # about the outermost pixels, so that the mosaic goes on beyond them
    return convolve(plane, kernel, cv2.BORDER_REFLECT_101)


def bilinear(image, masks):
    """Return the image as its mosaic shows it, neighbours of each colour averaged."""
    seen = image * masks
    return np.stack([_mirrored(seen[..., c], SQUARE if c != 1 else CROSS) for c in range(3)], axis=-1)


def malvar(image, masks, row):
    """Return the image as its mosaic shows it, interpolated with the Laplacian of the colour seen; red in rows ``row``."""
    mosaic = (image * masks).sum(axis=2)
    red_rows = np.zeros(mosaic.shape, np.float32)
    red_rows[row::2] = 1
    green, across, in_row, in_column = (_mirrored(mosaic, k) for k in (GREEN, ACROSS, BESIDE, BESIDE.T))
    is_red, is_green, is_blue = (masks[..., c] for c in range(3))
    red = is_red * mosaic + is_blue * across + is_green * np.where(red_rows, in_row, in_column)
    blue = is_blue * mosaic + is_red * across + is_green * np.where(red_rows, in_column, in_row)
    return np.stack([red, is_green * mosaic + (1 - is_green) * green, blue], axis=-1)


def apply(image, view, p, rng):
    """Sample the mosaics and interpolate them."""
    first = view.margin % 2
    out = image
    for name, (row, column) in RED.items():
        if p[name] == 0:
            continue
        row, column = (row + first) % 2, (column + first) % 2
        masks = masks_of(image.shape[:2], row, column)
        shown = bilinear(image, masks)
        if p["corrected"]:
            shown = shown + np.float32(p["corrected"]) * (malvar(image, masks, row) - shown)
        out = out + np.float32(p[name]) * (shown - image)
    return out
