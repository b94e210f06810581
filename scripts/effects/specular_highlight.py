"""A lamp's glossy reflection lies on the plates.

Adds strength (n . h)^(2 / roughness^2), h halfway between the directions to the lamp and to the camera, and a share of
Fresnel's rise towards grazing light. Sources: J. F. Blinn, "Models of light reflection for computer synthesized pictures"
(1977); C. Schlick, "An inexpensive BRDF model for physically-based rendering" (1994).
"""

from effects.base import Parameter

STAGE, ORDER = "scene", 70
# A lobe is seen only near its lamp's mirror image: lamps all over the ground are tried
LAMPS_M = [(x, y) for y in (1.2, 2.2, 3.2, 4.2) for x in (0.0, 0.5, -0.5)]
PARAMETERS = {
    "strength": Parameter("1", 0.0, 3.0, 0.0, (0.15,), 0.01, "radiance at the highlight's centre"),
    "x_m": Parameter("m", -3.0, 3.0, 0.0, tuple(x for x, _ in LAMPS_M), 0.05, "lamp, to the right", qualifies=True),
    "y_m": Parameter("m", -3.0, 6.0, 1.0, tuple(y for _, y in LAMPS_M), 0.05, "lamp, forward", qualifies=True),
    "height_m": Parameter("m", 0.3, 6.0, 1.5, (1.5,), 0.05, "lamp, above the ground", qualifies=True),
    "roughness": Parameter("1", 0.05, 0.7, 0.2, (0.25,), 0.02, "width of the highlight", qualifies=True),
    "fresnel": Parameter("1", 0.0, 1.0, 0.0, (0.0,), 0.1, "share of Fresnel's rise at grazing angles", qualifies=True),
}


def change_scene(scene, p):
    """Set the scene's highlight."""
    if p["strength"] == 0:
        return scene
    return scene.with_(highlight=dict(p))
