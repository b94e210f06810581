"""Fixed pattern: each pixel has a gain and each column an offset of its own, the same in every capture.

Source: EMVA 1288 PRNU (photo response non-uniformity) and column DSNU. The pattern itself is drawn from the camera's
name: parameters tell its size, not the sensor's own pattern.
"""

import functools

import numpy as np

from effects.base import Parameter
from job import seed_of

STAGE, ORDER = "sensor", 15
AFFECTS = "intensity"
NEEDS_REPEATS = True
PARAMETERS = {
    "prnu": Parameter(
        unit="1", lower=0.0, upper=0.2, null=0.0, matters=0.005, doc="standard deviation of the pixels' gains"
    ),
    "column_offset_dn": Parameter(
        unit="dn", lower=0.0, upper=20.0, null=0.0, matters=0.1, doc="of the columns' offsets, linear levels"
    ),
}
STARTS = ({"prnu": 0.01}, {"column_offset_dn": 1.0}, {"prnu": 0.01, "column_offset_dn": 1.0})


@functools.lru_cache(maxsize=8)
def pattern(camera, width, height, margin):
    """Return the camera's gains and column offsets, (H + 2m, W + 2m, 1) and (1, W + 2m, 1), standard normal.

    Each pixel of the frame has its own whatever the margin; the margin is no part of the sensor and has none.
    """
    rng = np.random.default_rng(seed_of("fixed pattern", camera))
    offsets = rng.standard_normal((1, width), dtype=np.float32)
    gains = rng.standard_normal((height, width), dtype=np.float32)
    return np.pad(gains, margin)[..., None], np.pad(offsets, ((0, 0), (margin, margin)))[..., None]


def variance(linear, p):
    """Return the pattern's variance over sensors of linear values, in grey levels of full scale 255."""
    return np.float32(p["column_offset_dn"] ** 2) + np.float32((255 * p["prnu"]) ** 2) * linear**2


def apply(image, view, p, rng):
    """Apply the camera's pattern; the expected image is the mean over sensors, which has none."""
    if rng is None:
        return image
    gain, offset = pattern(view.camera, view.width, view.height, view.margin)
    if view.windows is not None:
        at = (np.rint(c).astype(int) + view.margin for c in (view.windows.y, view.windows.x))
        row, column = (np.clip(c, 0, size - 1) for c, size in zip(at, gain.shape[:2], strict=True))
        gain, offset = gain[row, column], offset[0, column]
    return image * (1 + np.float32(p["prnu"]) * gain) + np.float32(p["column_offset_dn"] / 255) * offset
