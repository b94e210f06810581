"""A lamp's glossy reflection lies on the plates.

Adds strength (n . h)^(2 / roughness^2), h halfway between the directions to the lamp and to the camera, and a share of
Fresnel's rise towards grazing light. Sources: J. F. Blinn, "Models of light reflection for computer synthesized pictures"
(1977); C. Schlick, "An inexpensive BRDF model for physically-based rendering" (1994).
"""

from effects.base import Parameter

STAGE, ORDER = "scene", 70
AFFECTS = "intensity"
PARAMETERS = {
    "strength": Parameter(
        unit="1", lower=0.0, upper=3.0, null=0.0, matters=0.01, doc="radiance at the highlight's centre"
    ),
    "x_m": Parameter(unit="m", lower=-3.0, upper=3.0, null=0.0, matters=0.05, doc="lamp, to the right", auxiliary=True),
    "y_m": Parameter(unit="m", lower=-3.0, upper=6.0, null=1.0, matters=0.05, doc="lamp, forward", auxiliary=True),
    "height_m": Parameter(
        unit="m", lower=0.3, upper=6.0, null=1.5, matters=0.05, doc="lamp, above the ground", auxiliary=True
    ),
    "roughness": Parameter(
        unit="1", lower=0.05, upper=0.7, null=0.2, matters=0.02, doc="width of the highlight", auxiliary=True
    ),
    "fresnel": Parameter(
        unit="1",
        lower=0.0,
        upper=1.0,
        null=0.0,
        matters=0.1,
        doc="share of Fresnel's rise at grazing angles",
        auxiliary=True,
    ),
}
# A lobe is seen only near its lamp's mirror image: lamps all over the ground are tried
STARTS = tuple(
    {"strength": 0.15, "roughness": 0.25, "x_m": x, "y_m": y} for y in (1.2, 2.2, 3.2, 4.2) for x in (0.0, 0.5, -0.5)
)


def change_scene(scene, p):
    """Set the scene's highlight."""
    if p["strength"] == 0:
        return scene
    return scene.with_(highlight=dict(p))
