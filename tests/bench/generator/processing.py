"""What a camera's processor does to encoded values after the noise: denoise, sharpen, tone in the order that the
campaign drew, then compress.
"""

import io

import numpy as np
from numba import njit
from PIL import Image
from scipy.interpolate import PchipInterpolator
from scipy.ndimage import median_filter

from generator import nominal
from generator.optics import soften


@njit(cache=True)
def _bilateral(image, radius, sigma_px, sigma_dn):
    """Bilateral filter (Tomasi and Manduchi 1998) within each channel; weights are tabulated in steps of 1/4
    DN.
    """
    rows, columns, channels = image.shape
    table = np.exp(-0.5 * (np.arange(1600) / 4.0 / sigma_dn) ** 2).astype(np.float32)
    out = np.empty_like(image)
    near = np.empty((2 * radius + 1, 2 * radius + 1), np.float32)
    for a in range(-radius, radius + 1):
        for b in range(-radius, radius + 1):
            near[a + radius, b + radius] = np.exp(-0.5 * (a * a + b * b) / sigma_px**2)
    for i in range(rows):
        for j in range(columns):
            for c in range(channels):
                here = image[i, j, c]
                top, bottom = np.float32(0.0), np.float32(0.0)
                for a in range(-radius, radius + 1):
                    y = min(max(i + a, 0), rows - 1)
                    for b in range(-radius, radius + 1):
                        x = min(max(j + b, 0), columns - 1)
                        value = image[y, x, c]
                        step = min(int(abs(value - here) * 4.0 + 0.5), 1599)
                        w = near[a + radius, b + radius] * table[step]
                        top += w * value
                        bottom += w
                out[i, j, c] = top / bottom
    return out


def drawn_order(effects, seed_name):
    """Return the names among ``effects`` of what acts on encoded values before the codec, in the order in which it does.

    Denoising comes before sharpening; cameras differ in where their curve is, so its place among what is hidden of the
    two is drawn by the campaign's seed.
    """
    order = [name for name in ("denoising", "sharpening") if name in effects]
    if "tone_curve" in effects:
        place = nominal.rng_of("tone curve's place", seed_name).integers(len(order) + 1)
        order.insert(int(place), "tone_curve")
    return order


def _denoise(image, p):
    if p["method"] == "median":
        return (1 - p["share"]) * image + p["share"] * median_filter(image, (3, 3, 1), mode="nearest")
    return _bilateral(image.astype(np.float32), p["radius_px"], p["sigma_px"], p["sigma_dn"])


def _sharpen(image, p):
    return np.clip(image + p["amount"] * (image - soften(image, p["sigma_px"])), 0.0, 255.0)


def _tone(image, p):
    return PchipInterpolator(p["in_dn"], p["out_dn"])(image)


STEPS = {"denoising": _denoise, "sharpening": _sharpen, "tone_curve": _tone}


def process(image, effects, order):
    """Return 8-bit values (H, W, 3) of encoded, noisy ``image`` (0..255, unrounded); ``order`` as ``drawn_order`` has it."""
    image = np.clip(image, 0.0, 255.0).astype(np.float32)
    for name in order:
        image = STEPS[name](image, effects[name])
    image = np.rint(np.clip(image, 0.0, 255.0)).astype(np.uint8)
    if p := effects.get("jpeg_compression"):
        file = io.BytesIO()
        Image.fromarray(image).save(file, "JPEG", quality=p["quality"], subsampling=p["subsampling"])
        image = np.array(Image.open(io.BytesIO(file.getvalue())))
    return image
