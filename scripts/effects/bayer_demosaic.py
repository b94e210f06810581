"""A colour mosaic: each pixel sees one colour, the others are interpolated from neighbours.

One parameter for each place that red can have in a block of 2 x 2, the share of that mosaic in the image (1 is a real
mosaic, of which a camera has one). Interpolation is bilinear, or to the share ``corrected`` that of Malvar, which adds the
Laplacian of the colour that was seen. Source: B. E. Bayer, US 3971065 (1976); Malvar, He and Cutler, "High-quality linear
interpolation for demosaicing of Bayer-patterned color images" (2004).
"""

import functools

import numpy as np

from effects.base import Parameter
from effects.noise_kernels import centred
from kernels import njit

STAGE, ORDER = "sensor", 30
AFFECTS = "intensity"
MAKES_COLOUR = True
RED = {"rggb": (0, 0), "grbg": (0, 1), "gbrg": (1, 0), "bggr": (1, 1)}  # row, column of red in the frame's first block
PARAMETERS = {
    name: Parameter(
        unit="1",
        lower=0.0,
        upper=1.0,
        null=0.0,
        matters=0.1,
        doc=f"share of the mosaic that begins with {name.upper()}",
    )
    for name in RED
} | {
    "corrected": Parameter(
        unit="1",
        lower=0.0,
        upper=1.0,
        null=0.0,
        matters=0.1,
        doc="share of Malvar's correction; nothing without a mosaic",
        auxiliary=True,
    )
}
STARTS = (dict.fromkeys(RED, 0.25) | {"corrected": 0.5},)
BRIGHTNESS = np.array([0.299, 0.587, 0.114])  # of red, green, blue in grey: ITU-R BT.601
SIDE, REACH = 16, 5  # pixels about one that is noisy, and to which its noise is followed


@njit(cache=True)
def _mirrored(index, size):
    # about the outermost pixel, so that the mosaic goes on beyond it
    return min(abs(index), 2 * (size - 1) - index)


@njit(cache=True)
def _mosaic(image, row, column):
    """Return what a mosaic whose red begins at row, column sees (rows + 4, columns + 4), two pixels more on each side."""
    h, w, _ = image.shape
    seen = np.empty((h + 4, w + 4), np.float32)
    for r in range(h + 4):
        y = _mirrored(r - 2, h)
        for c in range(w + 4):
            x = _mirrored(c - 2, w)
            colour = 1 if (y + row + x + column) % 2 else (0 if (y + row) % 2 == 0 else 2)
            seen[r, c] = image[y, x, colour]
    return seen


@njit(cache=True)
def demosaiced(image, row, column, corrected):
    """Return the image (rows, columns, 3) as a mosaic whose red begins at row, column shows it.

    What was not seen is the mean of the nearest neighbours that did, plus ``corrected`` times Malvar's Laplacian
    (He and Cutler's figure 2, gains 1/2, 5/8 and 3/4).
    """
    m = _mosaic(image, row, column)
    out = np.empty_like(image)
    for r in range(image.shape[0]):
        for c in range(image.shape[1]):
            y, x = r + 2, c + 2
            seen = m[y, x]
            beside, below = m[y, x - 1] + m[y, x + 1], m[y - 1, x] + m[y + 1, x]
            corners = m[y - 1, x - 1] + m[y - 1, x + 1] + m[y + 1, x - 1] + m[y + 1, x + 1]
            two_beside, two_below = m[y, x - 2] + m[y, x + 2], m[y - 2, x] + m[y + 2, x]
            red_row = (r + row) % 2 == 0
            if (r + row + c + column) % 2:
                in_row = beside / 2 + corrected * (5 * seen - corners - two_beside + two_below / 2) / 8
                in_column = below / 2 + corrected * (5 * seen - corners - two_below + two_beside / 2) / 8
                red, green, blue = (in_row, seen, in_column) if red_row else (in_column, seen, in_row)
            else:
                bend = corrected * (seen - (two_beside + two_below) / 4)
                green, other = (beside + below) / 4 + bend / 2, corners / 4 + 3 * bend / 4
                red, blue = (seen, other) if red_row else (other, seen)
            out[r, c, 0], out[r, c, 1], out[r, c, 2] = red, green, blue
    return out


def reach_px(p):
    """Return how far ``apply`` looks."""
    return 2


def apply(image, view, p, rng):
    """Sample the mosaics and interpolate them."""
    first = 0 if view.windows is not None else view.margin % 2
    return _seen_through(np.ascontiguousarray(image), p, first)


def _seen_through(image, p, first):
    """Return the image (rows, columns, 3) through the mosaics, whose first block begins ``first`` pixels before it."""
    out = image
    for name, (row, column) in RED.items():
        if p[name] != 0:
            shown = demosaiced(image, (row + first) % 2, (column + first) % 2, p["corrected"])
            out = out + np.float32(p[name]) * (shown - image)
    return out


def noise_kernel(p, noise_dn):
    """Return the kernel (odd, odd) of the power that grey noise has through the mosaics, the mean of a block's four places."""
    return _kernel(tuple(sorted(p.items())))


@functools.lru_cache(maxsize=256)
def _kernel(values):
    power = np.zeros((SIDE, SIDE))
    for row, column, colour in np.ndindex(2, 2, 3):
        noisy = np.zeros((SIDE, SIDE, 3), np.float32)
        noisy[SIDE // 2 + row, SIDE // 2 + column, colour] = 1
        power += np.abs(np.fft.fft2(_seen_through(noisy, dict(values), 0) @ BRIGHTNESS)) ** 2
    power /= 4 * (BRIGHTNESS**2).sum()
    return centred(np.fft.fftshift(np.fft.ifft2(np.sqrt(power)).real), 2 * REACH + 1)
