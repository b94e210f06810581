"""JPEG compression of the finished image.

``loss`` is 100 minus libjpeg's quality; between two qualities the images are mixed, so that a fit has a slope. Colour
images are stored with half the resolution of colour. Source: ITU-T T.81, libjpeg's tables. The frame is compressed
without the margin, so that blocks lie as in the camera.
"""

import cv2
import numpy as np

from effects.base import Parameter

STAGE, ORDER = "processing", 60
LEAPS = "loss"  # the tables change by leaps: a fit compares all whole values first
PARAMETERS = {"loss": Parameter("1", 0.0, 95.0, 0.0, (5.0, 25.0, 45.0, 60.0, 70.0, 80.0), 3.0, "100 minus the quality")}


def compressed(pixels, quality):
    """Return uint8 pixels (H, W, 1 or 3; red first) after JPEG at a whole quality, 0..100."""
    colour = pixels.shape[2] == 3
    _, data = cv2.imencode(".jpg", pixels[..., ::-1] if colour else pixels, [cv2.IMWRITE_JPEG_QUALITY, quality])
    back = cv2.imdecode(data, cv2.IMREAD_COLOR if colour else cv2.IMREAD_GRAYSCALE)
    return back[..., ::-1] if colour else back[..., None]


def apply(image, view, p, rng):
    """Encode and decode the frame."""
    if p["loss"] == 0:
        return image
    m = view.margin
    frame = (slice(m, m + view.height), slice(m, m + view.width))
    pixels = np.clip(np.rint(image[frame]), 0, 255).astype(np.uint8)
    below = int(np.floor(100 - p["loss"]))
    share = np.float32(100 - p["loss"] - below)
    out = image.copy()
    out[frame] = compressed(pixels, below)
    if share > 0:
        out[frame] += share * (compressed(pixels, below + 1).astype(np.float32) - out[frame])
    return out
