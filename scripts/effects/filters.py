"""Filters that several effects share, on float32 images (rows, columns, channels).

Spreads are exact: a kernel's variance is what its parameter says, also for a fraction of a pixel, and changes smoothly
with it, so that a fit can follow it from zero.
"""

import functools
import math

import cv2
import numpy as np

# Standard deviations at which a blur that varies over the image is computed; between them, variances are mixed
LEVELS_PX = (0.0, 0.25, 0.35, *(0.5 * 2 ** (k / 4) for k in range(16)), 8.0)
COARSE_BELOW_PX = 0.5
PIECES_PER_DISC = 64
TILE_PX = 128
SOFT_STRIDE = 35  # order in which a soft edge is visited, other than the disc's


@functools.lru_cache(maxsize=64)
def gaussian_taps(sigma_px):
    """Return the odd taps of a Gaussian of variance sigma_px^2: sampled, as an optical spread on box pixels is.

    Below 0.5 px, where samples would miss most of it, three taps of that variance.
    """
    if sigma_px < COARSE_BELOW_PX:
        v = sigma_px**2
        return np.array([v / 2, 1 - v, v / 2])
    reach = int(np.ceil(4.5 * sigma_px)) + 1
    squares = np.arange(-reach, reach + 1.0) ** 2
    variance = sigma_px**2
    for _ in range(20):  # sampling a narrow Gaussian loses some of its variance: widen it until it is right
        taps = np.exp(-0.5 * squares / variance)
        taps /= taps.sum()
        variance += sigma_px**2 - (taps * squares).sum()
    return taps


def gaussian(image, sigma_px):
    """Return the image blurred by a Gaussian of a standard deviation in pixels."""
    if sigma_px == 0:
        return image
    taps = gaussian_taps(float(sigma_px))
    out = cv2.sepFilter2D(image, cv2.CV_32F, taps, taps, borderType=cv2.BORDER_REPLICATE)
    return out.reshape(image.shape)


def gaussian_reach_px(sigma_px):
    """Return how far a Gaussian blur looks: what lies beyond three standard deviations counts for less than 0.3 %."""
    return math.ceil(3 * sigma_px)


def box_taps(sigma_px):
    """Return the odd taps of an average over 2 m + 1 pixels of variance m (m + 1) / 3, mixed with the next wider one."""
    m = int((np.sqrt(1 + 12 * sigma_px**2) - 1) / 2)
    share = (3 * sigma_px**2 - m * (m + 1)) / (2 * (m + 1))
    taps = np.full(2 * m + 3, share / (2 * m + 3))
    taps[1:-1] += (1 - share) / (2 * m + 1)
    return taps


def box(image, sigma_px):
    """Return the image averaged over squares of a standard deviation in pixels per axis."""
    taps = box_taps(sigma_px)
    out = cv2.sepFilter2D(image, cv2.CV_32F, taps, taps, borderType=cv2.BORDER_REPLICATE)
    return out.reshape(image.shape)


def convolve(image, kernel, border=cv2.BORDER_REPLICATE):
    """Return the image convolved with a kernel (odd, odd)."""
    out = cv2.filter2D(image, cv2.CV_32F, np.ascontiguousarray(kernel[::-1, ::-1]), borderType=border)
    return out.reshape(image.shape)


def varying_blur(image, sigma_px, blur=gaussian):
    """Return the image blurred by a standard deviation (rows, columns), pixels, 0 to 8, that varies slowly.

    Between two levels the blurred images are mixed so that variances, hence spreads, are exact and smooth. It goes tile
    by tile: one needs few levels.
    """
    variance = (sigma_px * sigma_px).astype(np.float32)
    out = np.empty_like(image)
    for top in range(0, image.shape[0], TILE_PX):
        for left in range(0, image.shape[1], TILE_PX):
            tile = slice(top, top + TILE_PX), slice(left, left + TILE_PX)
            out[tile] = _blurred_tile(image, variance[tile], top, left, blur)
    return out


def _blurred_tile(image, variance, top, left, blur):
    """Return the blurred part of the image that ``variance`` (rows, columns) covers from row ``top``, column ``left``."""
    height, width = variance.shape

    def blurred(level):
        pad = int(np.ceil(5 * level)) + 3
        first_row, first_column = max(top - pad, 0), max(left - pad, 0)
        part = image[first_row : top + height + pad, first_column : left + width + pad]
        part = blur(np.ascontiguousarray(part), level)
        return part[top - first_row :, left - first_column :][:height, :width]

    smallest, largest = np.sqrt(variance.min()), np.sqrt(variance.max())
    reach = int(np.ceil(5 * largest)) + 3
    around = image[max(top - reach, 0) : top + height + reach, max(left - reach, 0) : left + width + reach]
    if np.ptp(around) == 0:
        return around[:height, :width]
    first = max(k for k, level in enumerate(LEVELS_PX) if level <= smallest)
    lower_level, lower = LEVELS_PX[first], blurred(LEVELS_PX[first])
    out = lower
    for level in LEVELS_PX[first + 1 :]:
        if largest <= lower_level:
            break
        upper = blurred(level)
        share = (variance - np.float32(lower_level**2)) / np.float32(level**2 - lower_level**2)
        out = out + (upper - lower) * np.clip(share, 0, 1)[..., None]
        lower_level, lower = level, upper
    return out


def keys_weights(t):
    """Return the weights of cubic convolution at distances t: quadratics are kept, so no variance is added.

    Source: R. G. Keys, "Cubic convolution interpolation for digital image processing" (1981), a = -1/2.
    """
    t = np.abs(t)
    near, far = 1.5 * t**3 - 2.5 * t**2 + 1, -0.5 * t**3 + 2.5 * t**2 - 4 * t + 2
    return np.where(t < 1, near, np.where(t < 2, far, 0.0))


def spread_points(x, y):
    """Return the kernel (odd, odd) of points (n,) about the origin, each shared among the 4 x 4 pixels round it.

    A render's pixels hold edges sharper than any kernel can move: about 1 % of an edge's contrast stays wrong.
    """
    reach_x, reach_y = int(np.ceil(np.abs(x).max())) + 2, int(np.ceil(np.abs(y).max())) + 2
    across = keys_weights(np.arange(-reach_x, reach_x + 1) - x[:, None])
    down = keys_weights(np.arange(-reach_y, reach_y + 1) - y[:, None])
    kernel = down.T @ across
    return kernel / kernel.sum()


@functools.cache
def disc_points(n):
    """Return n = 4 m^2 points (n, 2) that fill a disc evenly, standard deviation 1 per axis: m rings of equal cells.

    The second half lies opposite the first: what leans to no side moves no edge.
    """
    k = np.arange(n // 2)
    ring = np.array([math.isqrt(i // 2) for i in k])
    radius = 2 * np.sqrt((ring**2 + (ring + 1) ** 2) / 2) / math.isqrt(n // 4)
    angle = 2 * np.pi * (k - 2 * ring**2 + 0.25 + 0.5 * (ring % 2)) / (4 * (2 * ring + 1))
    half = radius[:, None] * np.stack([np.cos(angle), np.sin(angle)], axis=1)
    return np.concatenate([half, -half])


@functools.cache
def gaussian_points(n):
    """Return n points (n, 2) spread as a Gaussian, standard deviation 1 per axis, the second half opposite the first."""
    k = np.arange(n // 2)
    radius, angle = np.sqrt(-2 * np.log(1 - (k + 0.5) / len(k))), k * np.pi * (3 - np.sqrt(5))
    half = standardised(radius[:, None] * np.stack([np.cos(angle), np.sin(angle)], axis=1))
    return np.concatenate([half, -half])


def standardised(points):
    """Return points (n, 2) about their mean, which is 0, stretched to a standard deviation of exactly 1 along every line."""
    return points @ np.linalg.inv(np.linalg.cholesky(points.T @ points / len(points))).T


def soft_points(n, softness):
    """Return where n parts (n, 2) of the light of a disc land whose edge is soft, standard deviation 1 per axis, the second half
    opposite the first.

    ``softness`` is the share of the variance that is Gaussian, 0 to 1.
    """
    of_half = np.arange(n // 2) * SOFT_STRIDE % (n // 2)
    gaussian_part = gaussian_points(n)[np.concatenate([of_half, of_half + n // 2])]
    points = np.sqrt(1 - softness) * disc_points(n) + np.sqrt(softness) * gaussian_part
    return standardised(points) if 0 < softness < 1 else points  # so few are not quite independent


def soft_disc(softness):
    """Return the blur (image, sigma_px) by a disc whose edge is soft, as ``soft_points`` says."""

    def blur(image, sigma_px):
        sharp = disc(image, sigma_px * float(np.sqrt(1 - softness)))
        return gaussian(sharp, sigma_px * float(np.sqrt(softness)))

    return blur


@functools.lru_cache(maxsize=64)
def disc_kernel(sigma_px):
    """Return the kernel of an evenly filled disc with that standard deviation per axis (radius 2 sigma_px)."""
    t = (np.arange(PIECES_PER_DISC) + 0.5) / PIECES_PER_DISC * 2 - 1
    x, y = (a.ravel() for a in np.meshgrid(t, t))
    inside = x * x + y * y <= 1
    x, y = x[inside], y[inside]
    scale = sigma_px * np.sqrt(2 / np.mean(x * x + y * y))
    return spread_points(scale * x, scale * y)


def disc(image, sigma_px):
    """Return the image blurred by an evenly filled disc (a defocused pupil) of that standard deviation per axis.

    A disc of radius R has the variance R^2 / 4 per axis.
    """
    return image if sigma_px == 0 else convolve(image, disc_kernel(float(sigma_px)))


def pixel_grid(view, shape):
    """Return frame pixels x and y, float32, of an array: (1, columns) and (rows, 1), or (rows, columns) of windows."""
    if view.windows is not None:
        return view.windows.x, view.windows.y
    x = np.arange(shape[1], dtype=np.float32)[None] - np.float32(view.margin)
    y = np.arange(shape[0], dtype=np.float32)[:, None] - np.float32(view.margin)
    return x, y


def frame_of(view):
    """Return the slices of an array that are the whole frame, in small where the array is put together of windows."""
    if view.windows is not None:
        return view.windows.frame
    m = view.margin
    return slice(m, m + view.height), slice(m, m + view.width)


def squared_radius(x, y, view):
    """Return the squared distance of pixels x, y from the frame's centre in units of half its diagonal."""
    dx, dy = x - (view.width - 1) / 2, y - (view.height - 1) / 2
    return (dx * dx + dy * dy) / np.float32((view.width**2 + view.height**2) / 4)
