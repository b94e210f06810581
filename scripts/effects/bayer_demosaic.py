"""A colour mosaic: each pixel sees one colour (RGGB), the others are interpolated from neighbours.

Bilinear interpolation; ``amount`` mixes with the full-colour image (1 is a real mosaic). Source: B. E. Bayer,
US 3971065 (1976); bilinear reference of Malvar, He and Cutler (2004).
"""

import cv2
import numpy as np

from effects.base import Parameter
from effects.filters import convolve

STAGE, ORDER = "sensor", 30
MAKES_COLOUR = True
PARAMETERS = {"amount": Parameter("1", 0.0, 1.0, 0.0, (1.0, 0.5), 0.1, "share of the mosaic in the image")}
CROSS = np.array([[0, 1, 0], [1, 4, 1], [0, 1, 0]]) / 4
SQUARE = np.array([[1, 2, 1], [2, 4, 2], [1, 2, 1]]) / 4


def apply(image, view, p, rng):
    """Sample the mosaic and interpolate it."""
    rows, columns = image.shape[:2]
    first = view.margin % 2  # the frame's top left pixel is red
    masks = np.zeros((rows, columns, 3), np.float32)
    masks[first::2, first::2, 0] = 1
    masks[1 - first :: 2, first::2, 1] = 1
    masks[first::2, 1 - first :: 2, 1] = 1
    masks[1 - first :: 2, 1 - first :: 2, 2] = 1
    seen = image * masks
    # mirrored about the outermost pixels, so that the mosaic goes on beyond them
    planes = [convolve(seen[..., c], SQUARE if c != 1 else CROSS, cv2.BORDER_REFLECT_101) for c in range(3)]
    return image + np.float32(p["amount"]) * (np.stack(planes, axis=-1) - image)
