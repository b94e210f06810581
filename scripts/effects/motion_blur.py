"""Motion blur: the camera moves straight and evenly while the shutter is open.

The image is averaged along the segment (dx, dy), centred. Source: Kang et al., linear motion point spread function.
"""

import numpy as np

from effects.base import Parameter
from effects.filters import convolve

STAGE, ORDER = "shutter", 20
PIECES = 64
PARAMETERS = {
    "dx_px": Parameter("px", -40, 40, 0.0, (2.0, 0.0, 1.5, 1.5), 0.4, "smear to the right during the exposure"),
    "dy_px": Parameter("px", -40, 40, 0.0, (0.0, 2.0, 1.5, -1.5), 0.4, "smear downwards during the exposure"),
}


def smear_kernel(dx, dy):
    """Return the point spread function (odd, odd) of a smear: points along it, shared among four pixels."""
    t = (np.arange(PIECES) + 0.5) / PIECES - 0.5
    reach_x, reach_y = int(np.ceil(abs(dx) / 2)) + 1, int(np.ceil(abs(dy) / 2)) + 1
    kernel = np.zeros((2 * reach_y + 1, 2 * reach_x + 1))
    x, y = t * dx + reach_x, t * dy + reach_y
    i, j = np.floor(y).astype(int), np.floor(x).astype(int)
    fy, fx = y - i, x - j
    np.add.at(kernel, (i, j), (1 - fy) * (1 - fx))
    np.add.at(kernel, (i, j + 1), (1 - fy) * fx)
    np.add.at(kernel, (i + 1, j), fy * (1 - fx))
    np.add.at(kernel, (i + 1, j + 1), fy * fx)
    return kernel / PIECES


def apply(image, view, p, rng):
    """Average along the smear."""
    return convolve(image, smear_kernel(p["dx_px"], p["dy_px"]))
