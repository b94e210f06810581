"""The light on the rig changes smoothly over the ground.

Radiance times 1 + t + lamp_share (E(x, y) / E(0, 1 m) - 1), at least 0: a tilt t = gradient_x x + gradient_y (y - 1 m)
(the first order of any uneven light), which may level off a length 1 / sqrt(levelling_per_m2) away, and a lamp that is
near, E = h / d^3. Source: Lambert's cosine and inverse square laws.
"""

from effects.base import Parameter

STAGE, ORDER = "scene", 60
AFFECTS = "intensity"
OWN_WHERE_OPEN = {"light": ("gradient_x", "gradient_y")}
PARAMETERS = {
    "gradient_x": Parameter(
        unit="1/m", lower=-2.0, upper=2.0, null=0.0, matters=0.01, doc="relative change of light per metre to the right"
    ),
    "gradient_y": Parameter(
        unit="1/m", lower=-0.9, upper=0.9, null=0.0, matters=0.01, doc="relative change of light per metre forward"
    ),
    "levelling_per_m2": Parameter(
        unit="1/m^2",
        lower=0.0,
        upper=10.0,
        null=0.0,
        matters=0.1,
        doc="inverse square of the length over which the gradient levels off",
        prior_sd=3.0,
        auxiliary=True,
    ),
    "lamp_share": Parameter(
        unit="1", lower=0.0, upper=1.0, null=0.0, matters=0.02, doc="share of the light from a near lamp"
    ),
    "lamp_x_m": Parameter(
        unit="m", lower=-4.0, upper=4.0, null=0.0, matters=0.05, doc="lamp, to the right", prior_sd=3.0, auxiliary=True
    ),
    "lamp_y_m": Parameter(
        unit="m", lower=-4.0, upper=6.0, null=1.0, matters=0.05, doc="lamp, forward", prior_sd=3.0, auxiliary=True
    ),
    "lamp_height_m": Parameter(
        unit="m",
        lower=0.3,
        upper=6.0,
        null=1.5,
        matters=0.05,
        doc="lamp, above the ground",
        prior_sd=3.0,
        auxiliary=True,
    ),
}
STARTS = ({}, *({"lamp_share": 0.4, "lamp_x_m": x, "lamp_y_m": y} for y in (0.0, 2.0) for x in (1.0, -1.0)))


def change_scene(scene, p):
    """Set the scene's light."""
    if p["gradient_x"] == 0 and p["gradient_y"] == 0 and p["lamp_share"] == 0:
        return scene
    return scene.with_(light=dict(p))
