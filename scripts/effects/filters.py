"""Filters that several effects share, on float32 images (rows, columns, channels)."""

import cv2
import numpy as np

# Standard deviations at which a blur that varies over the image is computed; between them, variances are mixed
LEVELS_PX = (0.0, 0.35, 0.5, 0.7, 1.0, 1.4, 2.0, 2.8, 4.0, 5.6, 8.0)


def gaussian_taps(sigma_px):
    """Return odd taps of a Gaussian with exactly that variance: three taps where sampling one would be too coarse."""
    if sigma_px < 0.5:
        v = sigma_px**2
        return np.array([v / 2, 1 - v, v / 2])
    reach = int(np.ceil(4 * sigma_px))
    x = np.arange(-reach, reach + 1)
    taps = np.exp(-(x**2) / (2 * sigma_px**2))
    return taps / taps.sum()


def gaussian(image, sigma_x, sigma_y=None):
    """Return the image blurred by a Gaussian, standard deviations in pixels."""
    if sigma_x == 0 and not sigma_y:
        return image
    taps_x, taps_y = gaussian_taps(sigma_x), gaussian_taps(sigma_x if sigma_y is None else sigma_y)
    out = cv2.sepFilter2D(image, cv2.CV_32F, taps_x, taps_y, borderType=cv2.BORDER_REPLICATE)
    return out.reshape(image.shape)


def convolve(image, kernel):
    """Return the image convolved with a small symmetric-about-its-centre kernel (odd, odd)."""
    out = cv2.filter2D(image, cv2.CV_32F, kernel[::-1, ::-1], borderType=cv2.BORDER_REPLICATE)
    return out.reshape(image.shape)


def varying_blur(image, sigma_px, blur=gaussian):
    """Return the image blurred by a standard deviation (rows, columns), pixels, that varies slowly.

    Between two levels variances are mixed, so that the spread is exact and smooth in the parameters.
    """
    largest = float(sigma_px.max())
    out = np.zeros_like(image)
    lower_level, lower = LEVELS_PX[0], image
    for level in LEVELS_PX[1:]:
        upper = blur(image, level)
        share = np.clip((sigma_px**2 - lower_level**2) / (level**2 - lower_level**2), 0, 1)
        here = (sigma_px >= lower_level) & ((sigma_px < level) | (level == LEVELS_PX[-1]))
        mixed = lower + (upper - lower) * share[..., None].astype(np.float32)
        out[here] = mixed[here]
        if largest < level:
            break
        lower_level, lower = level, upper
    return out


def disc(image, sigma_px):
    """Return the image blurred by an evenly filled disc (a defocused pupil) of that standard deviation per axis.

    A disc of radius R has the variance R^2 / 4 per axis.
    """
    if sigma_px == 0:
        return image
    radius = 2 * sigma_px
    reach = int(np.ceil(radius + 0.5))
    fine = (np.arange(-reach * 16 - 8, reach * 16 + 8) + 0.5) / 16
    inside = (fine[:, None] ** 2 + fine[None, :] ** 2 <= radius**2).astype(float)
    n = 2 * reach + 1
    kernel = inside.reshape(n, 16, n, 16).sum((1, 3))
    kernel /= kernel.sum()
    # a box per kernel cell adds 1/12 px^2: small discs would spread too much
    x = np.arange(-reach, reach + 1)
    variance = (kernel.sum(0) * x**2).sum()
    if variance > sigma_px**2:
        share = sigma_px**2 / variance
        kernel *= share
        kernel[reach, reach] += 1 - share
    return convolve(image, kernel)


def pixel_grid(view, shape):
    """Return frame pixels (x, y), float32 (rows, columns), of an array with the view's margin."""
    y, x = np.mgrid[0 : shape[0], 0 : shape[1]].astype(np.float32)
    return x - view.margin, y - view.margin


def relative_radius(view, shape):
    """Return the distance from the frame's centre in units of half its diagonal (rows, columns), float32."""
    x, y = pixel_grid(view, shape)
    dx, dy = x - (view.width - 1) / 2, y - (view.height - 1) / 2
    return np.hypot(dx, dy) / np.float32(np.hypot(view.width, view.height) / 2)
