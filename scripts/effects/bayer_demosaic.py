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
EIGHTH, QUARTER, HALF, THREE_QUARTERS, FIVE = (np.float32(x) for x in (0.125, 0.25, 0.5, 0.75, 5))
SIDE, REACH = 16, 5  # pixels about one that is noisy, and to which its noise is followed


@njit(cache=True)
def _mirrored(index, size):
    # about the outermost pixel, so that the mosaic goes on beyond it
    return min(abs(index), 2 * (size - 1) - index)


@njit(cache=True, nogil=True)
def _mosaic(image, row, column):
    """Return what a mosaic whose red begins at row, column sees (rows + 4, columns + 4), two pixels more on each side."""
    h, w, _ = image.shape
    seen = np.empty((h + 4, w + 4), np.float32)
    for r in range(h + 4):
        y = _mirrored(r - 2, h)
        other = 0 if (y + row) % 2 == 0 else 2
        for c in range(w):
            seen[r, c + 2] = image[y, c, 1 if (y + row + c + column) % 2 else other]
        for c in (0, 1, w + 2, w + 3):
            x = _mirrored(c - 2, w)
            seen[r, c] = image[y, x, 1 if (y + row + x + column) % 2 else other]
    return seen


@njit(cache=True, nogil=True)
def _mix_in(out, share, image, row, column, corrected):
    """Add to ``out`` a share of what a mosaic, whose red begins at row, column, makes of an image (rows, columns, 3).

    A colour that a pixel sees stays; one that it does not is the mean of the nearest neighbours that do, plus ``corrected``
    times Malvar's Laplacian (He and Cutler's figure 2, gains 1/2, 5/8 and 3/4).
    """
    m, corrected, share = _mosaic(image, row, column), np.float32(corrected), np.float32(share)
    for r in range(image.shape[0]):
        above_2, above, own, below, below_2 = m[r], m[r + 1], m[r + 2], m[r + 3], m[r + 4]
        of_row, of_column = (0, 2) if (r + row) % 2 == 0 else (2, 0)
        green = (r + row + column + 1) % 2  # the first column that sees it
        for c in range(green, image.shape[1], 2):
            seen, in_row, in_column = own[c + 2], own[c + 1] + own[c + 3], above[c + 2] + below[c + 2]
            two_beside, two_below = own[c] + own[c + 4], above_2[c + 2] + below_2[c + 2]
            bend = FIVE * seen - (above[c + 1] + above[c + 3] + below[c + 1] + below[c + 3])
            along = HALF * in_row + corrected * EIGHTH * (bend - two_beside + HALF * two_below)
            down = HALF * in_column + corrected * EIGHTH * (bend - two_below + HALF * two_beside)
            out[r, c, of_row] += share * (along - image[r, c, of_row])
            out[r, c, of_column] += share * (down - image[r, c, of_column])
        for c in range(1 - green, image.shape[1], 2):
            seen, corners = own[c + 2], above[c + 1] + above[c + 3] + below[c + 1] + below[c + 3]
            bend = corrected * (seen - QUARTER * (own[c] + own[c + 4] + above_2[c + 2] + below_2[c + 2]))
            near = QUARTER * (own[c + 1] + own[c + 3] + above[c + 2] + below[c + 2]) + HALF * bend
            far = QUARTER * corners + THREE_QUARTERS * bend
            out[r, c, 1] += share * (near - image[r, c, 1])
            out[r, c, of_column] += share * (far - image[r, c, of_column])


def reach_px(p):
    """Return how far ``apply`` looks."""
    return 2


def apply(image, view, p, rng):
    """Sample the mosaics and interpolate them."""
    first = 0 if view.windows is not None else view.margin % 2
    return _seen_through(np.ascontiguousarray(image), p, first)


def _seen_through(image, p, first):
    """Return the image (rows, columns, 3) through the mosaics, whose first block begins ``first`` pixels before it."""
    out = image.copy()
    for name, (row, column) in RED.items():
        if p[name] != 0:
            _mix_in(out, p[name], image, (row + first) % 2, (column + first) % 2, p["corrected"])
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
