"""What a camera's processor does to encoded values: denoise, sharpen, tone, compress. In this order, after
the noise.
"""

import io

import numpy as np
from numba import njit
from PIL import Image
from scipy.interpolate import PchipInterpolator
from scipy.ndimage import median_filter

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


def process(image, effects):
    """Return 8-bit values (H, W, 3) of encoded, noisy ``image`` (0..255, unrounded)."""
    image = np.clip(image, 0.0, 255.0).astype(np.float32)
    if p := effects.get("denoising"):
        if p["method"] == "median":
            image = (1 - p["share"]) * image + p["share"] * median_filter(image, (3, 3, 1), mode="nearest")
        else:
            image = _bilateral(image, p["radius_px"], p["sigma_px"], p["sigma_dn"])
    if p := effects.get("sharpening"):
        image = np.clip(image + p["amount"] * (image - soften(image, p["sigma_px"])), 0.0, 255.0)
    if p := effects.get("tone_curve"):
        image = PchipInterpolator(p["in_dn"], p["out_dn"])(image)
    image = np.rint(np.clip(image, 0.0, 255.0)).astype(np.uint8)
    if p := effects.get("jpeg_compression"):
        file = io.BytesIO()
        Image.fromarray(image).save(file, "JPEG", quality=p["quality"], subsampling=p["subsampling"])
        image = np.array(Image.open(io.BytesIO(file.getvalue())))
    return image
