"""The print is longer one way than the other: a printer feeds paper and moves its head by different scales.

y' = m + ratio (y - m) about the print's middle m; the paper stays. Source: printer's feed and "fit to page".
"""

from dataclasses import replace

import numpy as np

from effects.base import Parameter

STAGE, ORDER = "scene", 25
AFFECTS = "geometry"
ONLY_BOARDS = True
PARAMETERS = {
    "ratio": Parameter(
        unit="1", lower=0.95, upper=1.05, null=1.0, matters=0.001,
        doc="printed height over the nominal one, where the width is right",
    )
}  # fmt: skip


def change_scene(scene, p):
    """Move the lines across every print that are not the paper's edges."""
    return scene.with_(plates=tuple(replace(plate, y_m=_stretched(plate.y_m, p["ratio"])) for plate in scene.plates))


def _stretched(lines, ratio):
    out, middle = lines.copy(), (lines[0] + lines[-1]) / 2
    out[1:-1] = np.clip(lines[1:-1] + (ratio - 1) * (lines[1:-1] - middle), lines[0], lines[-1])
    return out
