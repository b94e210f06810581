"""The nominal scene of a campaign from its expanded tables: plates of markers, or one calibration board."""

import json
from pathlib import Path

from effects.base import Scene
from inputs import tables
from inputs.campaign import CalibrationBoard
from markers.contract import marker_plate
from rig.targets import inverted_plate, target_plate


def load_scene(expand, register_json):
    """Return the effects.base.Scene of an expand folder, a board's black and white as register_json says that they are."""
    expand = Path(expand)
    facts = json.loads((expand / "scene.json").read_text())
    if facts["target"]:
        plate = target_plate(CalibrationBoard.model_validate(facts["target"]))
        plates = (inverted_plate(plate) if json.loads(Path(register_json).read_text())["inverted"] else plate,)
    else:
        plates = tuple(marker_plate(m) for m in tables.read_table(expand / "markers.csv", tables.MARKERS).itertuples())
    r = facts["reflectance"]
    return Scene(plates, r["white"], r["black"], r["ground"], r["background"])
