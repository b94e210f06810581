"""JPEG compression of the finished image.

``loss`` is 100 minus libjpeg's quality. Colour is stored with half the resolution (4:2:0) or in full (4:4:4).
Between two qualities tables are mixed, so that a fit has a slope. Source: ITU-T T.81, libjpeg's tables. The frame is
compressed without the margin, so that blocks lie as in the camera.

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

from effects.base import Parameter
from effects.encoding import mean_of_clipped
from effects.filters import frame_of
from effects.quantisation import BLOCK, COSINES, COSINES_BACK, by_blocks
from kernels import njit

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
        doc="1: colour is stored in full, 4:4:4, 0: 4:2:0; nothing in grey images",
        auxiliary=True,
        discrete=True,
    ),
}
STARTS = tuple({"loss": loss} for loss in (5.0, 25.0, 45.0, 60.0, 70.0, 80.0))
MIDDLE = np.float32(128)
# ITU-T T.871: Y, Cb, Cr of red, green, blue
TO_YCC = np.array([[0.299, 0.587, 0.114], [-0.168736, -0.331264, 0.5], [0.5, -0.418688, -0.081312]], np.float32)
BRIGHTNESS_NOISE = float(np.linalg.norm(TO_YCC[0]))  # over that of the channels, which are independent
COLOUR_NOISE = float(np.linalg.norm(TO_YCC[1]))  # of Cb; Cr has 7 % more
SAMPLING = {False: cv2.IMWRITE_JPEG_SAMPLING_FACTOR_420, True: cv2.IMWRITE_JPEG_SAMPLING_FACTOR_444}
ROUNDING_DN = 12**-0.5  # standard deviation of what rounding to whole levels adds
TO_RGB = np.linalg.inv(TO_YCC).astype(np.float32)
# Of steps that are read off an image: frequencies, what rounding to whole levels adds, what counts as 0, outliers' share
LOW_FREQUENCIES = np.array([(u, v) for u in range(BLOCK) for v in range(BLOCK) if 0 < u + v < 5])
LEVEL_ERROR_DN, NEAR_0_DN, ANYWHERE, LIVELY = 0.35, 1.5, 0.2, 3
CLEAR_STEPS, ENOUGH_COEFFICIENTS, WITHIN_SQUARES = 0.2, 200, 0.6
QUALITIES_SEEN = range(5, 97)


def declared_by(facts):
    """Return the parameters of the tables in a JPEG's own file; None of a file that is none."""
    if not facts["jpeg_quality"]:
        return None
    return {"loss": 100.0 - facts["jpeg_quality"], "full_colour": float(facts["jpeg_sampling"] == "4:4:4")}


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
    from PIL import Image  # only here: what is exported of an effect runs without it

    grey = np.full((BLOCK, BLOCK, 3), int(MIDDLE), np.uint8)
    _, data = cv2.imencode(".jpg", grey, [cv2.IMWRITE_JPEG_QUALITY, quality])
    with Image.open(io.BytesIO(data)) as image:
        brightness, colour = (image.quantization[k] for k in (0, 1))
    return tuple(np.reshape(table, (BLOCK, BLOCK)).astype(np.float32) for table in (brightness, colour))


def tables_between(quality):
    """Return ``tables`` of any quality: between two whole ones their tables are mixed, so that a fit has a slope."""
    below = math.floor(quality)
    share = np.float32(quality - below)
    if not share:
        return tables(below)
    return tuple((1 - share) * low + share * high for low, high in zip(tables(below), tables(below + 1), strict=True))


def quantised(plane, table, noise):
    """Return the mean of a plane (rows, columns) float32 about 0 after its blocks' coefficients are rounded to the table.

    ``noise`` (block rows, block columns), white, is its standard deviation in the plane's units.
    """
    low, high, share = by_blocks(_filled_up(plane), noise, table)
    return _mixed(low, high, share, plane.shape)


def mean_decoded(plane, table, noise, colours):
    """Return the mean levels (rows, columns, 1 or 3) of a decoded image whose brightness about 0 is quantised, under noise.

    ``noise`` as in ``quantised``; ``colours`` (2 or 0, rows, columns) are its decoded planes of colour. Blocks' means may lie
    on either of two steps: each is decoded, as a decoder rounds, and then they are mixed.
    """
    low, high, share = by_blocks(_filled_up(plane), noise, table)
    return _decoded(low, high, share, colours, plane.shape, TO_RGB)


@njit(cache=True, nogil=True)
def _mixed(low, high, share, shape):
    out = np.empty(shape, np.float32)
    for r in range(shape[0]):
        for c in range(shape[1]):
            out[r, c] = low[r, c] + share[r // BLOCK, c // BLOCK] * (high[r, c] - low[r, c])
    return out


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


def _noise_of_blocks(noise_dn, shape, side=BLOCK):
    """Return the noise (block rows, block columns) in blocks of ``side`` pixels of an image: of uneven noise the mean variance
    counts. ``noise_dn`` is a number or (rows, columns, C).
    """
    if np.ndim(noise_dn):
        return _root_mean_square(np.ascontiguousarray(noise_dn, np.float32), side)
    return np.full((-(-shape[0] // side), -(-shape[1] // side)), noise_dn, np.float32)


@njit(cache=True, nogil=True)
def _root_mean_square(values, side):
    """Return the root mean square (block rows, block columns) of an array (rows, columns, C), its last row and column again."""
    rows, columns, channels = values.shape
    out = np.empty((-(-rows // side), -(-columns // side)), np.float32)
    for i in range(out.shape[0]):
        for j in range(out.shape[1]):
            total = np.float32(0.0)
            for r in range(i * side, (i + 1) * side):
                for c in range(j * side, (j + 1) * side):
                    for k in range(channels):
                        total += values[min(r, rows - 1), min(c, columns - 1), k] ** 2
            out[i, j] = np.sqrt(total / np.float32(side * side * channels))
    return out


def _filled_up(plane, side=BLOCK):
    rows, columns = plane.shape
    if rows % side == columns % side == 0:
        return np.ascontiguousarray(plane)
    return np.pad(plane, ((0, -rows % side), (0, -columns % side)), mode="edge")


@njit(cache=True, nogil=True)
def _halved(plane):
    """Return the means of a plane's squares of 2 pixels, of which it has whole ones."""
    out = np.empty((plane.shape[0] // 2, plane.shape[1] // 2), np.float32)
    for r in range(out.shape[0]):
        for c in range(out.shape[1]):
            above = plane[2 * r, 2 * c] + plane[2 * r, 2 * c + 1]
            out[r, c] = np.float32(0.25) * (above + plane[2 * r + 1, 2 * c] + plane[2 * r + 1, 2 * c + 1])
    return out


def expected(image, quality, full_colour, noise_dn):
    """Return the mean grey levels (H, W, 1 or 3) float32 that ``compressed`` gives of an image, not rounded, under noise.

    ``noise_dn``, a number or (H, W, 1 or 3), is the standard deviation in each of three channels: brightness has less.
    """
    brightness, colour = tables_between(quality)
    noise = _noise_of_blocks(noise_dn, image.shape)
    if image.shape[2] == 1:
        no_colours = np.empty((0, *image.shape[:2]), np.float32)
        return mean_decoded(image[..., 0] - MIDDLE, brightness, BRIGHTNESS_NOISE * noise, no_colours)
    y, *chroma = _brightness_and_colours(np.ascontiguousarray(image), TO_YCC)
    if full_colour:
        stored = [quantised(p, colour, COLOUR_NOISE * noise) for p in chroma]
    else:  # the mean of four pixels has half their noise
        of_fours = COLOUR_NOISE / 2 * _noise_of_blocks(noise_dn, image.shape, 2 * BLOCK)
        stored = [_stored_in_half(p, colour, of_fours) for p in chroma]
    return mean_decoded(y, brightness, BRIGHTNESS_NOISE * noise, np.stack(stored))


def _stored_in_half(plane, table, noise):
    """Return a plane of colour whose fours of pixels are one, and which is interpolated back."""
    even = _filled_up(plane, 2)
    half = quantised(_halved(even), table, noise)
    back = cv2.resize(half, even.shape[::-1], interpolation=cv2.INTER_LINEAR)
    return back[: plane.shape[0], : plane.shape[1]]


def apply(image, view, p, rng):
    """Encode and decode the frame."""
    if p["loss"] == 0:
        return image
    frame = slice(None) if view.windows is not None else frame_of(view)  # windows are whole blocks
    full_colour = p["full_colour"] >= 0.5
    out = image.copy()
    if rng is None:
        noise_dn = view.noise_dn[frame] if np.ndim(view.noise_dn) else view.noise_dn
        levels = mean_of_clipped(image[frame], noise_dn)
        out[frame] = expected(levels, 100 - p["loss"], full_colour, np.hypot(noise_dn, ROUNDING_DN))
        return out
    pixels = np.clip(np.rint(image[frame]), 0, 255).astype(np.uint8)
    out[frame] = sum(np.float32(share) * compressed(pixels, q, full_colour) for q, share in qualities(p["loss"]))
    return out


def starts_from(image):
    """Return the quality, and the way of colour, that an image's own coefficients show; None where they show no steps.

    Decoded, coefficients still lie near multiples of their table's entries. Of all qualities that with the largest likelihood
    ratio to coefficients that lie anywhere is taken. Source: Fridrich and Goljan, "Reliable detection of LSB steganography"
    (2003), and Neelamani et al., "JPEG compression history estimation for color images" (2006).
    """
    pixels = np.ascontiguousarray(image, np.float32)
    in_colour = image.shape[2] == 3
    planes = _brightness_and_colours(pixels, TO_YCC) if in_colour else pixels.transpose(2, 0, 1)
    coefficients = _lively_coefficients(planes[0])
    gain, quality = max((_steps_seen(coefficients, tables(q)[0][*LOW_FREQUENCIES.T]), q) for q in QUALITIES_SEEN)
    if gain < CLEAR_STEPS:
        return None
    return {"loss": 100.0 - quality, "full_colour": float(in_colour and _is_in_full(planes[1:], tables(quality)[1]))}


def _lively_coefficients(plane):
    """Return the low cosine coefficients (blocks, k) of those whole blocks of a plane that have several.

    Levels are rounded after decoding: in a block of one level all are off alike, and that is no noise.
    """
    rows, columns = (n - n % BLOCK for n in plane.shape)
    blocks = plane[:rows, :columns].reshape(rows // BLOCK, BLOCK, columns // BLOCK, BLOCK).swapaxes(1, 2)
    coefficients = (COSINES @ blocks.reshape(-1, BLOCK, BLOCK) @ COSINES_BACK)[:, *LOW_FREQUENCIES.T]
    return coefficients[(np.abs(coefficients) > NEAR_0_DN).sum(1) >= LIVELY]


def _steps_seen(coefficients, steps):
    """Return the mean log likelihood ratio of coefficients (n, k) near multiples of their steps (k,) to lying anywhere.

    Those near 0 tell nothing; it is 0 where too few are left.
    """
    off = coefficients - steps * np.rint(coefficients / steps)
    near = np.exp(-0.5 * (off / LEVEL_ERROR_DN) ** 2) / (LEVEL_ERROR_DN * math.sqrt(2 * math.pi))
    ratios = np.log((1 - ANYWHERE) * near * steps + ANYWHERE)[np.abs(coefficients) > NEAR_0_DN]
    return float(ratios.mean()) if len(ratios) >= ENOUGH_COEFFICIENTS else 0.0


def _is_in_full(planes, table):
    """Return whether planes of colour (2, rows, columns) were stored in full: in steps of their table.

    Where they are too flat for steps to be seen: with changes within squares of two blocks as large as between them.
    """
    gain = _steps_seen(np.concatenate([_lively_coefficients(p) for p in planes]), table[*LOW_FREQUENCIES.T])
    if gain:
        return gain > CLEAR_STEPS
    rows, columns = (n - n % (2 * BLOCK) for n in planes.shape[1:])
    means = planes[:, :rows, :columns].reshape(2, rows // BLOCK, BLOCK, columns // BLOCK, BLOCK).mean((2, 4))
    steps = np.diff(means, axis=2) ** 2
    return bool(steps[..., ::2].mean() > WITHIN_SQUARES * steps[..., 1::2].mean())


def noise_gain(p):
    """Return by what noise that is still to be clipped grows: a decoder's levels are clipped."""
    return 0.0 if p["loss"] else 1.0


def qualities(loss):
    """Return [(whole quality, share of it)] whose images are mixed where a quality is not whole."""
    below = math.floor(100 - loss)
    share = 100 - loss - below
    return [(below, 1 - share), (below + 1, share)] if share else [(below, 1.0)]
