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

import cv2
import numpy as np
from PIL import Image
from scipy.special import ndtr

from effects.base import Parameter
from effects.encoding import mean_of_clipped

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
MIDDLE = 128
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
    grey = np.full((BLOCK, BLOCK, 3), MIDDLE, np.uint8)
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


def _by_blocks(plane, left, right):
    """Return left @ block @ right of every block of a plane whose sides are whole blocks."""
    rows, columns = plane.shape
    down = np.matmul(left, plane.reshape(-1, BLOCK, columns))
    return (down.reshape(-1, BLOCK) @ right).reshape(rows, columns)


def quantised(plane, table, noise):
    """Return the mean of a plane (rows, columns) float32 about 0 after its blocks' coefficients are rounded to the table.

    ``noise``, white, is its standard deviation in the plane's units, a number or (rows, columns).
    """
    lower, share = _steps_taken(plane, table, noise)
    return _decoded(lower + share, table, plane.shape)


def mean_decoded(plane, table, noise, decode):
    """Return the mean levels (rows, columns, C) of ``decode(plane)`` after a plane about 0 is quantised, under noise.

    Blocks' means may lie on either of two steps: each is decoded, as a decoder rounds, and then they are mixed.
    """
    lower, share = _steps_taken(plane, table, noise)
    coefficients = lower + share
    means = np.s_[::BLOCK, ::BLOCK]
    coefficients[means] = lower[means]
    low = _decoded(coefficients, table, plane.shape)
    rows, columns = plane.shape
    by_pixel = _spread_out(share[means])[:rows, :columns]
    low, high = decode(low), decode(low + table[0, 0] / BLOCK)
    return low + by_pixel[..., None] * (high - low)


def _steps_taken(plane, table, noise):
    """Return (lower of the two steps, probability of the upper) of the cosine coefficients of a plane's blocks.

    The last blocks are filled up. An orthonormal transform leaves white noise as it is; of uneven noise a block's mean
    variance counts.
    """
    whole = _filled_up(plane)
    steps = _tiled(table, whole.shape)
    coefficients = _by_blocks(whole, COSINES, COSINES.T) / steps
    lower = np.floor(coefficients)
    if np.ndim(noise):
        noise = _spread_out(np.sqrt(_means(_filled_up(noise) ** 2, BLOCK)))
    return lower, ndtr((coefficients - lower - 0.5) * steps / np.maximum(noise, np.float32(NO_NOISE)))


def _filled_up(plane, side=BLOCK):
    rows, columns = plane.shape
    return np.pad(plane, ((0, -rows % side), (0, -columns % side)), mode="edge")


def _means(plane, side):
    """Return the means of a plane's squares of ``side`` pixels, of which it has whole ones."""
    return plane.reshape(plane.shape[0] // side, side, -1, side).mean((1, 3))


def _spread_out(blocks):
    return np.repeat(np.repeat(blocks, BLOCK, axis=0), BLOCK, axis=1)


def _decoded(coefficients, table, shape):
    """Return the plane of coefficients in steps of the table, cut to its shape."""
    return _by_blocks(coefficients * _tiled(table, coefficients.shape), COSINES.T, COSINES)[: shape[0], : shape[1]]


def _tiled(table, shape):
    return np.tile(table, (shape[0] // BLOCK, shape[1] // BLOCK))


def _whole(values):
    """Return levels rounded as the decoder does: halves go up."""
    return np.clip(np.floor(values + np.float32(0.5)), 0, 255)


def expected(image, quality, full_colour, noise_dn):
    """Return the mean grey levels (H, W, 1 or 3) float32 that ``compressed`` gives of an image, not rounded, under noise.

    ``noise_dn``, a number or (H, W, 1 or 3), is the standard deviation in each of three channels: brightness has less.
    """
    brightness, colour = tables(quality)
    of_channels = _of_all_channels(noise_dn)
    noise = BRIGHTNESS_NOISE * of_channels
    if image.shape[2] == 1:
        return mean_decoded(image[..., 0] - MIDDLE, brightness, noise, lambda y: _whole(y + MIDDLE)[..., None])
    y, *chroma = np.moveaxis(image @ TO_YCC.T, 2, 0)
    stored = quantised if full_colour else _stored_in_half
    planes = [stored(plane, colour, COLOUR_NOISE * of_channels) for plane in chroma]

    def decode(y):
        return _whole(np.stack([y + MIDDLE, *planes], axis=-1) @ TO_RGB.T)

    return mean_decoded(y - MIDDLE, brightness, noise, decode)


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
    m = view.margin
    frame = (slice(m, m + view.height), slice(m, m + view.width))
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
