"""Black and white of the print do not reflect as nominal.

Linear reflectances are the nominal ones plus the changes. Source: Lambertian reflectance.
"""

from effects.base import Parameter

STAGE, ORDER = "scene", 50
AFFECTS = "intensity"
SHARED_WHERE_OPEN = ("reflectance",)
PARAMETERS = {
    "white_change": Parameter(
        unit="1", lower=-0.6, upper=0.6, null=0.0, matters=0.005, doc="reflectance of white minus the nominal one"
    ),
    "black_change": Parameter(
        unit="1", lower=-0.3, upper=0.6, null=0.0, matters=0.002, doc="reflectance of black minus the nominal one"
    ),
}


def change_scene(scene, p):
    """Change both reflectances, within 0 and 1."""
    return scene.with_(
        white=min(max(scene.white + p["white_change"], 0.0), 1.0),
        black=min(max(scene.black + p["black_change"], 0.0), 1.0),
    )
