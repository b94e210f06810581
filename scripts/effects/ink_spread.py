"""The print's black has grown (or shrunk) by a constant length at all its boundaries.

Source: dot gain; print growth of ISO/IEC 15416.
"""

from effects.base import Parameter

STAGE, ORDER = "scene", 40
AFFECTS = "intensity"
PARAMETERS = {
    "spread_m": Parameter(
        unit="m", lower=-0.004, upper=0.004, null=0.0, matters=0.00004, doc="outward move of the boundaries of black"
    )
}


def change_scene(scene, p):
    """Note the growth; plates are drawn with it."""
    return scene.with_(ink_spread_m=scene.ink_spread_m + p["spread_m"])
