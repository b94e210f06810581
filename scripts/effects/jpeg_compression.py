"""JPEG compression of the finished image.

``loss`` is 100 minus libjpeg's quality. Colour is stored with half the resolution (4:2:0) or, to the share
``full_colour``, in full (4:4:4). Between two qualities and two ways of colour the images are mixed, so that a fit has a
slope. Source: ITU-T T.81, libjpeg's tables. The frame is compressed without the margin, so that blocks lie as in the camera.

The expected image is not rounded before it is compressed: noise carries levels between whole numbers into a block's
mean, and a coarse table makes much of half a level. Where a block's mean lies within the noise's reach of half a step,
repeats fall on either side: the expected level lies between (the mean of a dithered quantiser; Widrow and Kollar,
"Quantization Noise", 2008).
"""

import functools
import io
import math

import cv2
import numpy as np
from numba import njit
from PIL import Image

from effects.base import Parameter
from effects.encoding import mean_of_clipped
from effects.filters import frame_of

STAGE, ORDER = "processing", 60
AFFECTS = "intensity"
MIXES_CHANNELS = True  # brightness has less noise than the channels it comes from
PARAMETERS = {
    "loss": Parameter(
        unit="1", lower=0.0, upper=95.0, null=0.0, matters=3.0, doc="100 minus the quality", discrete=True
    ),
    "full_colour": Parameter(
        unit="1",
        lower=0.0,
        upper=1.0,
        null=0.0,
        matters=0.5,
        doc="share of 4:4:4 instead of 4:2:0; nothing in grey images",
        prior_sd=0.5,
        auxiliary=True,
    ),
}
STARTS = tuple({"loss": loss} for loss in (5.0, 25.0, 45.0, 60.0, 70.0, 80.0))
BLOCK = 8
MIDDLE = np.float32(128)
# ITU-T T.871: Y, Cb, Cr of red, green, blue
TO_YCC = np.array([[0.299, 0.587, 0.114], [-0.168736, -0.331264, 0.5], [0.5, -0.418688, -0.081312]], np.float32)
BRIGHTNESS_NOISE = float(np.linalg.norm(TO_YCC[0]))  # over that of the channels, which are independent
COLOUR_NOISE = float(np.linalg.norm(TO_YCC[1]))  # of Cb; Cr has 7 % more
SAMPLING = {False: cv2.IMWRITE_JPEG_SAMPLING_FACTOR_420, True: cv2.IMWRITE_JPEG_SAMPLING_FACTOR_444}
NO_NOISE = 1e-6
ROUNDING_DN = 12**-0.5  # standard deviation of what rounding to whole levels adds
TO_RGB = np.linalg.inv(TO_YCC).astype(np.float32)


def compressed(pixels, quality, full_colour):
    """Return uint8 pixels (H, W, 1 or 3; red first) after JPEG at a whole quality, 0..100, colour stored in full or half."""
    colour = pixels.shape[2] == 3
    options = [cv2.IMWRITE_JPEG_QUALITY, quality, cv2.IMWRITE_JPEG_SAMPLING_FACTOR, SAMPLING[full_colour]]
    _, data = cv2.imencode(".jpg", pixels[..., ::-1] if colour else pixels, options)
    back = cv2.imdecode(data, cv2.IMREAD_COLOR if colour else cv2.IMREAD_GRAYSCALE)
    return back[..., ::-1] if colour else back[..., None]


@functools.cache
def tables(quality):
    """Return the codec's own quantisation tables (brightness, colour), each (8, 8) float32, read from a file's head."""
    grey = np.full((BLOCK, BLOCK, 3), int(MIDDLE), np.uint8)
    _, data = cv2.imencode(".jpg", grey, [cv2.IMWRITE_JPEG_QUALITY, quality])
    with Image.open(io.BytesIO(data)) as image:
        brightness, colour = (image.quantization[k] for k in (0, 1))
    return tuple(np.reshape(table, (BLOCK, BLOCK)).astype(np.float32) for table in (brightness, colour))


def _cosines():
    k = np.arange(BLOCK)
    basis = np.sqrt(2 / BLOCK) * np.cos(np.pi * (2 * k[None] + 1) * k[:, None] / (2 * BLOCK))
    basis[0] /= np.sqrt(2)
    return basis.astype(np.float32)


COSINES = _cosines()
COSINES_BACK = np.ascontiguousarray(COSINES.T)
SQRT_2 = math.sqrt(2)


def quantised(plane, table, noise):
    """Return the mean of a plane (rows, columns) float32 about 0 after its blocks' coefficients are rounded to the table.

    ``noise``, white, is its standard deviation in the plane's units, a number or (rows, columns).
    """
    low, high, share = _by_blocks(_filled_up(plane), _noise_of_blocks(noise, plane.shape), table)
    rows, columns = plane.shape
    return (low + _spread_out(share) * (high - low))[:rows, :columns]


def mean_decoded(plane, table, noise, colours):
    """Return the mean levels (rows, columns, 1 or 3) of a decoded image whose brightness about 0 is quantised, under noise.

    ``colours`` (2 or 0, rows, columns) are its decoded planes of colour. Blocks' means may lie on either of two steps: each is
    decoded, as a decoder rounds, and then they are mixed.
    """
    low, high, share = _by_blocks(_filled_up(plane), _noise_of_blocks(noise, plane.shape), table)
    return _decoded(low, high, share, colours, plane.shape, TO_RGB)


@njit(cache=True, nogil=True)
def _decoded(low, high, share, colours, shape, to_rgb):
    rows, columns = shape
    out = np.empty((rows, columns, 3 if len(colours) else 1), np.float32)
    for r in range(rows):
        for c in range(columns):
            upper = share[r // BLOCK, c // BLOCK]
            for k in range(out.shape[2]):
                colour = np.float32(0.0)
                for n in range(len(colours)):
                    colour += to_rgb[k, n + 1] * colours[n, r, c]
                below = _whole(low[r, c] + MIDDLE + colour)
                out[r, c, k] = below + upper * (_whole(high[r, c] + MIDDLE + colour) - below)
    return out


@njit(cache=True, nogil=True)
def _whole(value):
    """Return a level rounded as the decoder does: halves go up."""
    return min(max(np.floor(value + np.float32(0.5)), np.float32(0.0)), np.float32(255.0))


@njit(cache=True, nogil=True)
def _brightness_and_colours(image, to_ycc):
    """Return Y - 128, Cb, Cr (3, rows, columns) of an image (rows, columns, 3), red first."""
    rows, columns = image.shape[:2]
    out = np.empty((3, rows, columns), np.float32)
    for r in range(rows):
        for c in range(columns):
            for k in range(3):
                total = np.float32(0.0)
                for n in range(3):
                    total += to_ycc[k, n] * image[r, c, n]
                out[k, r, c] = total - MIDDLE if k == 0 else total
    return out


def _noise_of_blocks(noise, shape):
    """Return the noise (block rows, block columns) of a plane's blocks: of uneven noise a block's mean variance counts."""
    if np.ndim(noise):
        return np.sqrt(_means(_filled_up(noise) ** 2, BLOCK)).astype(np.float32)
    return np.full((-(-shape[0] // BLOCK), -(-shape[1] // BLOCK)), noise, np.float32)


@njit(cache=True, nogil=True)
def _by_blocks(plane, noise, table):
    """Return (plane with the lower of two steps of its blocks' means, with the upper one, probability of the upper one).

    plane (rows, columns) of whole blocks, noise and probability (block rows, block columns). An orthonormal transform leaves
    white noise as it is: of all other coefficients the mean of the two steps is taken.
    """
    low, high = np.empty_like(plane), np.empty_like(plane)
    share = np.empty(noise.shape, np.float32)
    block, half = np.empty((BLOCK, BLOCK), np.float32), np.empty((BLOCK, BLOCK), np.float32)
    for i in range(noise.shape[0]):
        for j in range(noise.shape[1]):
            at = plane[i * BLOCK : (i + 1) * BLOCK, j * BLOCK : (j + 1) * BLOCK]
            _transformed(at, COSINES, half, block)
            sd = max(noise[i, j], np.float32(NO_NOISE))
            for u in range(BLOCK):
                for v in range(BLOCK):
                    steps = block[u, v] / table[u, v]
                    lower = np.floor(steps)
                    d = (steps - lower - 0.5) * table[u, v] / sd
                    upper = 0.0 if d < -6.0 else (1.0 if d > 6.0 else 0.5 * math.erfc(-d / SQRT_2))
                    if u == 0 and v == 0:
                        share[i, j] = upper
                        block[u, v] = lower * table[u, v]
                    else:
                        block[u, v] = (lower + upper) * table[u, v]
            _transformed(block, COSINES_BACK, half, low[i * BLOCK : (i + 1) * BLOCK, j * BLOCK : (j + 1) * BLOCK])
            for u in range(i * BLOCK, (i + 1) * BLOCK):
                for v in range(j * BLOCK, (j + 1) * BLOCK):
                    high[u, v] = low[u, v] + table[0, 0] / np.float32(BLOCK)
    return low, high, share


@njit(cache=True, nogil=True)
def _transformed(block, basis, half, out):
    """Write basis @ block @ basis.T, all (8, 8), to ``out``."""
    for u in range(BLOCK):
        for c in range(BLOCK):
            total = np.float32(0.0)
            for r in range(BLOCK):
                total += basis[u, r] * block[r, c]
            half[u, c] = total
    for u in range(BLOCK):
        for v in range(BLOCK):
            total = np.float32(0.0)
            for c in range(BLOCK):
                total += half[u, c] * basis[v, c]
            out[u, v] = total


def _filled_up(plane, side=BLOCK):
    rows, columns = plane.shape
    if rows % side == columns % side == 0:
        return np.ascontiguousarray(plane)
    return np.pad(plane, ((0, -rows % side), (0, -columns % side)), mode="edge")


def _means(plane, side):
    """Return the means of a plane's squares of ``side`` pixels, of which it has whole ones."""
    return plane.reshape(plane.shape[0] // side, side, -1, side).mean((1, 3))


def _spread_out(blocks):
    return np.repeat(np.repeat(blocks, BLOCK, axis=0), BLOCK, axis=1)


def expected(image, quality, full_colour, noise_dn):
    """Return the mean grey levels (H, W, 1 or 3) float32 that ``compressed`` gives of an image, not rounded, under noise.

    ``noise_dn``, a number or (H, W, 1 or 3), is the standard deviation in each of three channels: brightness has less.
    """
    brightness, colour = tables(quality)
    of_channels = _of_all_channels(noise_dn)
    noise = BRIGHTNESS_NOISE * of_channels
    if image.shape[2] == 1:
        no_colours = np.empty((0, *image.shape[:2]), np.float32)
        return mean_decoded(image[..., 0] - MIDDLE, brightness, noise, no_colours)
    y, *chroma = _brightness_and_colours(np.ascontiguousarray(image), TO_YCC)
    stored = quantised if full_colour else _stored_in_half
    return mean_decoded(y, brightness, noise, np.stack([stored(p, colour, COLOUR_NOISE * of_channels) for p in chroma]))


def _of_all_channels(noise_dn):
    """Return a noise, a number or (H, W, C), as a number or (H, W)."""
    return np.sqrt((noise_dn**2).mean(axis=2)) if np.ndim(noise_dn) else noise_dn


def _stored_in_half(plane, table, noise):
    """Return a plane of colour whose fours of pixels are one, and which is interpolated back."""
    even = _filled_up(plane, 2)
    noise = np.sqrt(_means(_filled_up(noise, 2) ** 2, 2)) / 2 if np.ndim(noise) else noise / 2
    half = quantised(_means(even, 2), table, noise)
    back = cv2.resize(half, even.shape[::-1], interpolation=cv2.INTER_LINEAR)
    return back[: plane.shape[0], : plane.shape[1]]


def apply(image, view, p, rng):
    """Encode and decode the frame."""
    if p["loss"] == 0:
        return image
    frame = slice(None) if view.windows is not None else frame_of(view)  # windows are whole blocks
    if rng is None:
        noise_dn = view.noise_dn[frame] if np.ndim(view.noise_dn) else view.noise_dn
        codec = functools.partial(expected, noise_dn=np.hypot(noise_dn, ROUNDING_DN))
        pixels = mean_of_clipped(image[frame], noise_dn)
    else:
        pixels, codec = np.clip(np.rint(image[frame]), 0, 255).astype(np.uint8), compressed
    out = image.copy()
    out[frame] = sum(np.float32(share) * codec(pixels, *way) for way, share in ways(p, image.shape[2] == 3))
    return out


def noise_gain(p):
    """Return by what noise that is still to be clipped grows: a decoder's levels are clipped."""
    return 0.0 if p["loss"] else 1.0


def ways(p, in_colour):
    """Return [((whole quality, whether colour is stored in full), share of it)] whose images are mixed."""
    below = int(np.floor(100 - p["loss"]))
    above = 100 - p["loss"] - below
    full = p["full_colour"] if in_colour else 0.0
    shares = {
        (below, False): (1 - above) * (1 - full),
        (below, True): (1 - above) * full,
        (below + 1, False): above * (1 - full),
        (below + 1, True): above * full,
    }
    return [(way, share) for way, share in shares.items() if share > 0]
