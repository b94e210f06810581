"""JPEG compression of the finished image.

``loss`` is 100 minus libjpeg's quality. Colour is stored with half the resolution (4:2:0), in full (4:4:4), or as a
file's own sampling has it. Between two qualities tables are mixed, so that a fit has a slope. Source: ITU-T T.81,
libjpeg's tables. The frame is compressed without the margin, so that blocks lie as in the camera.

The expected image is not rounded before it is compressed: noise carries levels between whole numbers into a block's
mean, and a coarse table makes much of half a level. Where a block's mean lies within the noise's reach of half a step,
repeats fall on either side: the expected level lies between (the mean of a dithered quantiser; Widrow and Kollar,
"Quantization Noise", 2008).
"""

import functools
import io
import math
from typing import NamedTuple

import cv2
import numpy as np

from effects.base import Parameter
from effects.encoding import mean_of_clipped
from effects.filters import frame_of
from effects.noise_kernels import correlations, followed
from effects.own_tables import TO_YCC, compressed_as_own, factors_of, own_of, rounds_in_turn, steps_of
from effects.quantisation import BLOCK, COSINES, COSINES_BACK, LAGS, by_blocks, gains_of, noise_of_blocks
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
# Noise of Y, Cb, Cr over that of the channels, which are independent
PLANE_NOISE = np.linalg.norm(TO_YCC, axis=1).astype(np.float32)
SAMPLING = {False: cv2.IMWRITE_JPEG_SAMPLING_FACTOR_420, True: cv2.IMWRITE_JPEG_SAMPLING_FACTOR_444}
ROUNDING_DN = np.float32(12**-0.5)  # standard deviation of what rounding to whole levels adds
MAX_INTERPOLATED = 2  # pixels that a value of colour is stored for, beyond which decoders repeat it
TO_RGB = np.linalg.inv(TO_YCC).astype(np.float32)
ROUNDS_UP = np.float32(0.5 + 1e-3)  # a half is one although its sum is not exact
# Of steps that are read off an image: frequencies, what rounding to whole levels adds, what counts as 0, outliers' share
LOW_FREQUENCIES = np.array([(u, v) for u in range(BLOCK) for v in range(BLOCK) if 0 < u + v < 5])
LEVEL_ERROR_DN, NEAR_0_DN, ANYWHERE, LIVELY = 0.35, 1.5, 0.2, 3
CLEAR_STEPS, MIN_COEFFICIENTS, WITHIN_SQUARES = 0.2, 200, 0.6
QUALITIES_SEEN = range(5, 97)


def declared_by(facts):
    """Return the parameters of the tables in a JPEG's own file; None of a file that is none.

    ``loss`` and ``full_colour`` are the nearest; where these are not the file's own, ``own`` is there (effects.own_tables).
    """
    if not facts["jpeg_quality"]:
        return None
    said = {"loss": 100.0 - facts["jpeg_quality"], "full_colour": float(facts["jpeg_sampling"] == "4:4:4")}
    own = own_of(facts)
    return said | ({"own": own} if own else {})


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


class Plane(NamedTuple):
    """What is quantised: levels (rows, columns) about 0; standard deviations of their noise (block rows, block columns) and of
    what rounding to whole numbers adds, gains (8, 8) of that noise in coefficients; the table (8, 8).
    """

    levels: np.ndarray
    noise: np.ndarray
    gains: np.ndarray
    rounding: np.float32
    table: np.ndarray

    def quantised(self, middle):
        """Return ``_whole_steps`` about a level."""
        blocks = by_blocks(*self._replace(levels=_filled_up(self.levels)))
        return _whole_steps(*blocks, self.table[0, 0] / np.float32(BLOCK), middle)


def mean_decoded(brightness, colours=(), factors=(1, 1)):
    """Return the mean levels (rows, columns, 1 or 3) of a decoded image: each block at either of two steps, then mixed.

    brightness is a Plane, colours are two or none, stored once for ``factors`` (across, down) pixels. As a decoder does, planes
    are rounded to whole numbers, and then what colours add is.
    """
    y = brightness.quantised(MIDDLE)
    if not colours:
        return _grey_decoded(*y[:2], brightness.levels.shape)
    cb, cr = (_colour_decoded(colour, *factors) for colour in colours)
    return _decoded(y, cb, cr, *(BLOCK * f for f in factors), brightness.levels.shape)


def _colour_decoded(plane, across, down):
    """Return ``_whole_steps`` of a plane of colour at the size of brightness: interpolated, or repeated, as a decoder does."""
    both, share, even = plane.quantised(np.float32(0))
    if across > 1 or down > 1:
        way = cv2.INTER_LINEAR if max(across, down) <= MAX_INTERPOLATED else cv2.INTER_NEAREST
        both = np.stack([cv2.resize(p, None, fx=across, fy=down, interpolation=way) for p in both])
    return both, share, even


@njit(cache=True, nogil=True)
def _whole_steps(low, share, even, step, middle):
    """Return (plane (2, rows, columns) about ``middle`` at the lower and the upper step of its blocks, rounded; share; even)."""
    out = np.empty((2, *low.shape), np.float32)
    for r in range(low.shape[0]):
        for c in range(low.shape[1]):
            for k in range(2):
                out[k, r, c] = _whole(low[r, c] + k * step + middle, even[r // BLOCK, c // BLOCK])
    return out, share, even


@njit(cache=True, nogil=True)
def _whole(value, even):
    """Return a number rounded as the decoder does, halves up, as far as that shows."""
    return value + even * (np.floor(value + ROUNDS_UP) - value)


@njit(cache=True, nogil=True)
def _clipped(level):
    return min(max(level, np.float32(0.0)), np.float32(255.0))


@njit(cache=True, nogil=True)
def _mixed(below, above, share):
    return below + share * (above - below)


@njit(cache=True, nogil=True)
def _grey_decoded(both, share, shape):
    out = np.empty((*shape, 1), np.float32)
    for r in range(shape[0]):
        for c in range(shape[1]):
            out[r, c, 0] = _mixed(_clipped(both[0, r, c]), _clipped(both[1, r, c]), share[r // BLOCK, c // BLOCK])
    return out


@njit(cache=True, nogil=True)
def _decoded(y, cb, cr, width, height, shape):
    """Return the mean levels (rows, columns, 3) of ``_whole_steps`` of brightness and two planes of colour, whose blocks are
    ``width`` by ``height`` pixels of it.

    What colours add are the means of whole numbers, green's over both planes' steps.
    """
    (levels, upper, _), (blue, b_upper, b_even), (red, r_upper, r_even) = y, cb, cr
    of_red, of_blue, green_of_blue, green_of_red = TO_RGB[0, 2], TO_RGB[2, 1], TO_RGB[1, 1], TO_RGB[1, 2]
    out = np.empty((*shape, 3), np.float32)
    for r in range(shape[0]):
        for c in range(shape[1]):
            i, j = r // height, c // width
            share, more_blue, more_red = upper[r // BLOCK, c // BLOCK], b_upper[i, j], r_upper[i, j]
            even = b_even[i, j] * r_even[i, j]
            b0, b1, r0, r1 = blue[0, r, c], blue[1, r, c], red[0, r, c], red[1, r, c]
            low_red = _mixed(
                _whole(green_of_blue * b0 + green_of_red * r0, even),
                _whole(green_of_blue * b1 + green_of_red * r0, even),
                more_blue,
            )
            high_red = _mixed(
                _whole(green_of_blue * b0 + green_of_red * r1, even),
                _whole(green_of_blue * b1 + green_of_red * r1, even),
                more_blue,
            )
            added = (
                _mixed(_whole(of_red * r0, r_even[i, j]), _whole(of_red * r1, r_even[i, j]), more_red),
                _mixed(low_red, high_red, more_red),
                _mixed(_whole(of_blue * b0, b_even[i, j]), _whole(of_blue * b1, b_even[i, j]), more_blue),
            )
            for k in range(3):
                below, above = _clipped(levels[0, r, c]) + added[k], _clipped(levels[1, r, c]) + added[k]
                out[r, c, k] = _mixed(_clipped(below), _clipped(above), share)
    return out


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


def _filled_up(plane, width=BLOCK, height=BLOCK):
    rows, columns = plane.shape
    if rows % height == columns % width == 0:
        return np.ascontiguousarray(plane)
    return np.pad(plane, ((0, -rows % height), (0, -columns % width)), mode="edge")


@njit(cache=True, nogil=True)
def _means(plane, across, down):
    """Return the means of a plane's blocks of so many pixels, of which it has whole ones."""
    out = np.empty((plane.shape[0] // down, plane.shape[1] // across), np.float32)
    for r in range(out.shape[0]):
        for c in range(out.shape[1]):
            total = np.float32(0.0)
            for i in range(down):
                for j in range(across):
                    total += plane[down * r + i, across * c + j]
            out[r, c] = total / np.float32(across * down)
    return out


def expected(image, quality, full_colour, noise_dn, kernel=None, own=None):
    """Return the mean grey levels (H, W, 1 or 3) float32 that ``compressed`` gives of an image, not rounded, under noise.

    own are a file's own tables and sampling, which then count. ``noise_dn``, a number or (H, W, 1 or 3), is the standard
    deviation in each of three channels, brightness has less; kernel as ``View.noise_kernel``.
    """
    of_y, of_colour = steps_of(own) if own else tables_between(quality)
    noise, gains = noise_of_blocks(noise_dn, image.shape), gains_of(correlations(kernel, LAGS))
    if image.shape[2] == 1:
        return mean_decoded(Plane(image[..., 0] - MIDDLE, PLANE_NOISE[0] * noise, gains, ROUNDING_DN, of_y))
    y, *colours = _brightness_and_colours(np.ascontiguousarray(image), TO_YCC)
    brightness = Plane(y, PLANE_NOISE[0] * noise, gains, ROUNDING_DN, of_y)
    factors, rounding = factors_of(own[1] if own else "4:4:4" if full_colour else "4:2:0"), ROUNDING_DN
    if factors != (1, 1):
        gain, gains = _gains_of_means(kernel, *factors)
        noise = np.float32(gain) * noise_of_blocks(noise_dn, image.shape, *factors)
        rounding *= np.sqrt(np.float32(1 + 1 / math.prod(factors)))  # of whole levels and of their mean
        colours = [_stored(p, *factors) for p in colours]
    stored = [Plane(p, n * noise, gains, rounding, of_colour) for p, n in zip(colours, PLANE_NOISE[1:], strict=True)]
    return mean_decoded(brightness, stored, factors)


def _stored(plane, across, down):
    """Return the means of a plane of colour that libjpeg stores, by how much it rounds them up on average included."""
    count = across * down
    up = 0 if rounds_in_turn(across, down) or count % 2 else 0.5 / count
    return _means(_filled_up(plane, BLOCK * across, down), across, down) + np.float32(up)


def _gains_of_means(kernel, across, down):
    """Return (by what noise with a kernel is more in means of (across, down) pixels, ``gains_of`` it in blocks of them)."""
    side = max(across, down)
    mean = np.zeros((side, side))
    mean[:down, :across] = 1 / (across * down)
    gain, of_means = followed(kernel, mean)
    apart = (slice((side - n) * LAGS, (side + n) * LAGS + 1, n) for n in (down, across))
    return gain, gains_of(correlations(of_means, side * LAGS)[*apart])


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
        noise_dn, own = np.hypot(noise_dn, ROUNDING_DN), p.get("own")
        out[frame] = expected(levels, 100 - p["loss"], full_colour, noise_dn, view.noise_kernel, own)
        return out
    pixels = np.clip(np.rint(image[frame]), 0, 255).astype(np.uint8)
    if "own" in p:
        out[frame] = compressed_as_own(pixels, p["own"])
        return out
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
    clipped = _clipped_blocks(pixels)
    coefficients = _lively_coefficients(planes[0], clipped)
    gain, quality = max((_steps_seen(coefficients, tables(q)[0][*LOW_FREQUENCIES.T]), q) for q in QUALITIES_SEEN)
    if gain < CLEAR_STEPS:
        return None
    return {
        "loss": 100.0 - quality,
        "full_colour": float(in_colour and _is_in_full(planes[1:], tables(quality)[1], clipped)),
    }


def _clipped_blocks(pixels):
    """Return which whole blocks (block rows, block columns) of an image have levels that may have been clipped after decoding."""
    clipped = ((pixels <= 0) | (pixels >= 255)).any(2)
    rows, columns = (n // BLOCK for n in clipped.shape)
    return clipped[: rows * BLOCK, : columns * BLOCK].reshape(rows, BLOCK, columns, BLOCK).any((1, 3))


def _lively_coefficients(plane, clipped):
    """Return the low cosine coefficients (blocks, k) of those whole blocks of a plane that have several, and are not ``clipped``.

    Levels are rounded after decoding: in a block of one level all are off alike, and that is no noise.
    """
    rows, columns = (n - n % BLOCK for n in plane.shape)
    blocks = plane[:rows, :columns].reshape(rows // BLOCK, BLOCK, columns // BLOCK, BLOCK).swapaxes(1, 2)[~clipped]
    coefficients = (COSINES @ blocks.reshape(-1, BLOCK, BLOCK) @ COSINES_BACK)[:, *LOW_FREQUENCIES.T]
    return coefficients[(np.abs(coefficients) > NEAR_0_DN).sum(1) >= LIVELY]


def _steps_seen(coefficients, steps):
    """Return the mean log likelihood ratio of coefficients (n, k) near multiples of their steps (k,) to lying anywhere.

    Those near 0 tell nothing; it is 0 where too few are left.
    """
    off = coefficients - steps * np.rint(coefficients / steps)
    near = np.exp(-0.5 * (off / LEVEL_ERROR_DN) ** 2) / (LEVEL_ERROR_DN * math.sqrt(2 * math.pi))
    ratios = np.log((1 - ANYWHERE) * near * steps + ANYWHERE)[np.abs(coefficients) > NEAR_0_DN]
    return float(ratios.mean()) if len(ratios) >= MIN_COEFFICIENTS else 0.0


def _is_in_full(planes, table, clipped):
    """Return whether planes of colour (2, rows, columns) were stored in full: in steps of their table.

    Where they are too flat for steps to be seen: with changes within squares of two blocks as large as between them.
    """
    gain = _steps_seen(np.concatenate([_lively_coefficients(p, clipped) for p in planes]), table[*LOW_FREQUENCIES.T])
    if gain:
        return gain > CLEAR_STEPS
    rows, columns = (n - n % (2 * BLOCK) for n in planes.shape[1:])
    means = planes[:, :rows, :columns].reshape(2, rows // BLOCK, BLOCK, columns // BLOCK, BLOCK).mean((2, 4))
    steps = np.diff(means, axis=2) ** 2
    return bool(steps[..., ::2].mean() > WITHIN_SQUARES * steps[..., 1::2].mean())


def noise_kernel(p, noise_dn):
    """Return what is left of noise that is still to be clipped, (1, 1): a decoder's levels are clipped."""
    return np.full((1, 1), 0.0 if p["loss"] else 1.0)


def qualities(loss):
    """Return [(whole quality, share of it)] whose images are mixed where a quality is not whole."""
    below = math.floor(100 - loss)
    share = 100 - loss - below
    return [(below, 1 - share), (below + 1, share)] if share else [(below, 1.0)]
