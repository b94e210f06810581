"""The light on the rig changes smoothly over the ground.

Radiance times 1 + gradient_x x + gradient_y (y - 1 m) + lamp_share (E(x, y) / E(0, 1 m) - 1), at least 0: a tilt (the
first order of any uneven light) and a lamp that is near, E = h / d^3. Source: Lambert's cosine and inverse square laws.
"""

from effects.base import Parameter

STAGE, ORDER = "scene", 60
PARAMETERS = {
    "gradient_x": Parameter("1/m", -2.0, 2.0, 0.0, (0.0,), 0.01, "relative change of light per metre to the right"),
    "gradient_y": Parameter("1/m", -0.9, 0.9, 0.0, (0.0,), 0.01, "relative change of light per metre forward"),
    "lamp_share": Parameter("1", 0.0, 1.0, 0.0, (0.0, 0.4, 0.4, 0.4, 0.4), 0.02, "share of the light from a near lamp"),
    "lamp_x_m": Parameter(
        "m", -4.0, 4.0, 0.0, (0.0, 1.0, -1.0, 1.0, -1.0), 0.05, "lamp, to the right", 3.0, qualifies=True
    ),
    "lamp_y_m": Parameter("m", -4.0, 6.0, 1.0, (1.0, 0.0, 0.0, 2.0, 2.0), 0.05, "lamp, forward", 3.0, qualifies=True),
    "lamp_height_m": Parameter("m", 0.3, 6.0, 1.5, (1.5,), 0.05, "lamp, above the ground", 3.0, qualifies=True),
}


def change_scene(scene, p):
    """Set the scene's light."""
    if p["gradient_x"] == 0 and p["gradient_y"] == 0 and p["lamp_share"] == 0:
        return scene
    return scene.with_(light=dict(p))
