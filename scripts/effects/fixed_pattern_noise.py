"""Fixed pattern: each pixel has a gain and each column an offset of its own, the same in every capture.

Source: EMVA 1288 PRNU (photo response non-uniformity) and column DSNU. The pattern itself is drawn from the camera's
name: parameters tell its size, not the sensor's own pattern.
"""

import functools

import numpy as np

from effects.base import Parameter
from job import seed_of

STAGE, ORDER = "sensor", 15
PARAMETERS = {
    "prnu": Parameter("1", 0.0, 0.2, 0.0, (0.01, 0.0, 0.01), 0.002, "standard deviation of the pixels' gains"),
    "column_offset_dn": Parameter("dn", 0.0, 20.0, 0.0, (0.0, 1.0, 1.0), 0.1, "of the columns' offsets, linear levels"),
}


@functools.lru_cache(maxsize=8)
def _pattern(camera, shape):
    rng = np.random.default_rng(seed_of("fixed pattern", camera))
    return rng.standard_normal(shape, dtype=np.float32), rng.standard_normal((1, *shape[1:]), dtype=np.float32)


def apply(image, view, p, rng):
    """Apply the camera's pattern; the expected image is the mean over sensors, which has none."""
    if rng is None:
        return image
    gain, offset = _pattern(view.camera, image.shape)
    return image * (1 + np.float32(p["prnu"]) * gain) + np.float32(p["column_offset_dn"] / 255) * offset
