"""The light on the rig changes smoothly over the ground.

Radiance times 1 + gradient_x x + gradient_y (y - 1 m), at least 0. Source: first-order expansion of an uneven light.
"""

from effects.base import Parameter

STAGE, ORDER = "scene", 60
PARAMETERS = {
    "gradient_x": Parameter("1/m", -2.0, 2.0, 0.0, (0.0,), 0.01, "relative change of light per metre to the right"),
    "gradient_y": Parameter("1/m", -0.9, 0.9, 0.0, (0.0,), 0.01, "relative change of light per metre forward"),
}


def change_scene(scene, p):
    """Set the scene's light."""
    if p["gradient_x"] == 0 and p["gradient_y"] == 0:
        return scene
    return scene.with_(light={"gradient_x": p["gradient_x"], "gradient_y": p["gradient_y"]})
