"""The board is not flat: its paper is bowed along its width or its height, or twisted.

z = bow_x_m (1 - u^2) + bow_y_m (1 - v^2) + twist_m u v, u and v from -1 to 1 over the paper. Source: second order of a smooth
surface about its mean plane; that paper keeps its length along the arc moves points by (bow / width)^2 and is left out.
"""

from dataclasses import replace

from effects.base import Parameter

STAGE, ORDER = "scene", 35
AFFECTS = "geometry"
ONLY_BOARDS = True
PARAMETERS = {
    "bow_x_m": Parameter(
        unit="m",
        lower=-0.1,
        upper=0.1,
        null=0.0,
        matters=0.0005,
        doc="height of the middle over the left and right edge",
    ),
    "bow_y_m": Parameter(
        unit="m",
        lower=-0.1,
        upper=0.1,
        null=0.0,
        matters=0.0005,
        doc="height of the middle over the top and bottom edge",
    ),
    "twist_m": Parameter(
        unit="m", lower=-0.1, upper=0.1, null=0.0, matters=0.0005, doc="height of the top right corner over the middle"
    ),
}


def change_scene(scene, p):
    """Bend every print."""
    bend = p["bow_x_m"], p["bow_y_m"], p["twist_m"]
    return scene.with_(plates=tuple(replace(plate, bend_m=bend) for plate in scene.plates))
