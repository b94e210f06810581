"""The codes are printed larger or smaller about their centres; the plates stay.

Source: printer scaling ("fit to page").
"""

from dataclasses import replace

import numpy as np

from effects.base import Parameter

STAGE, ORDER = "scene", 20
AFFECTS = "geometry"
PARAMETERS = {
    "scale": Parameter(
        unit="1", lower=0.7, upper=1.35, null=1.0, matters=0.002, doc="printed side of the code over the nominal one"
    )
}


def _scaled(lines, scale):
    out = lines.copy()
    # a code that outgrows its plate is cut at the plate's edge
    out[1:-1] = np.clip(out[1:-1] * scale, out[0], out[-1])
    return out


def change_scene(scene, p):
    """Scale what is printed inside the white ring of every plate."""
    scale = p["scale"]
    plates = tuple(
        replace(
            plate,
            x_m=_scaled(plate.x_m, scale),
            y_m=_scaled(plate.y_m, scale),
            discs=plate.discs * [scale, scale, scale, 1],
        )
        for plate in scene.plates
    )
    return scene.with_(plates=plates)
