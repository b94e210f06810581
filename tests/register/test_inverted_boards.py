"""A chessboard whose black and white are swapped is measured and drawn as it is, not as it was described."""

import json

import cv2
import numpy as np
import pandas as pd
import pytest
import yaml

from board_photographs import drawn, lay
from expand_tables import expand_tables
from gap.signatures.signature import MIN_PATCHES
from inputs.campaign import CalibrationBoard
from inputs.scene import load_scene
from light_captures import light_captures
from observe_patches import observe_patches
from register_captures import register_captures
from rig.light import LIGHT
from rig.targets import inverted_plate, target_plate
from shared_files import shared

BOARD = {"type": "chessboard", "columns": 8, "rows": 6, "square_m": 0.03}  # 9 x 7 squares: no turn swaps their colours
PLATE = target_plate(CalibrationBoard.model_validate(BOARD))
NUMBER = 6
REAL = "chess_lifecam_1280"


def campaign_of(folder, plate):
    """Return the folder of a campaign: photographs of a plate, described as BOARD."""
    lay(folder, drawn(plate), NUMBER)
    names = [f"photo {k}.png" for k in range(NUMBER)]
    height, width = cv2.imread(str(folder / names[0])).shape[:2]
    captures = {"camera": "c", "capture": [f"p{k}" for k in range(NUMBER)], "image": names}
    pd.DataFrame(captures).to_csv(folder / "captures.csv", index=False)
    camera = {"width": width, "height": height} | dict.fromkeys(("fx", "fy", "cx", "cy"))
    facts = {"schema": 1, "name": "swapped", "origin": "camera", "target": BOARD, "captures": "captures.csv"}
    (folder / "campaign.yaml").write_text(yaml.safe_dump(facts | {"cameras": {"c": camera}, "encoding": "srgb"}))
    return folder


def seen(folder, campaign, camera, least):
    """Return (scene, lights of the captures, numbers of patches measured in them) as the workflow finds them."""
    expand, register = folder / "expand", folder / "register.json"
    points, light, patches = (folder / name for name in ("observations.npz", "light.csv", "patches.npz"))
    expand_tables(campaign, None, camera, expand)
    register_captures(expand, campaign, camera, register.with_suffix(".csv"), register, points, least=least)
    light_captures(expand, register, None, campaign, camera, points, [], light)
    observe_patches(expand, register, campaign, camera, points, patches)
    with np.load(patches) as stored:
        numbers = (stored["plates"] >= 0).sum(axis=1)
    return load_scene(expand, register), pd.read_csv(light).gain, numbers


@pytest.mark.parametrize("plate", [PLATE, inverted_plate(PLATE)], ids=["as described", "swapped"])
def test_a_swapped_board_has_light_patches_and_a_twin(tmp_path, plate):
    """Fails if the twin keeps the described colours, or no light and no patch is found where white and black are swapped."""
    scene, gains, numbers = seen(tmp_path, campaign_of(tmp_path / "photographs", plate), "c", NUMBER)
    np.testing.assert_array_equal(scene.plates[0].white, plate.white)
    assert gains.notna().all() and (numbers >= MIN_PATCHES).all()


def test_a_photographs_light_is_sought_behind_its_own_twin(tmp_path, monkeypatch):
    """Fails if a twin is made and not asked, or that of another capture is."""
    campaign, asked = campaign_of(tmp_path / "photographs", PLATE), []
    monkeypatch.setattr("light_captures.twins_in_light", lambda *_: {"p1": "twin of p1", "p4": "twin of p4"})
    monkeypatch.setattr(
        "light_captures.photograph_light", lambda *given: asked.append(given[-1]) or np.zeros(len(LIGHT))
    )
    seen(tmp_path, campaign, "c", NUMBER)
    assert asked == [None, "twin of p1", None, None, "twin of p4", None]


def test_the_paper_about_a_swapped_board_stays_white():
    """Fails if the margin turns black as well: the outer squares would have no edge to be found by."""
    white = inverted_plate(PLATE).white
    assert white[0].all() and white[:, -1].all() and (white[1:-1, 1:-1] != PLATE.white[1:-1, 1:-1]).all()


def test_swapped_in_real_photographs(tmp_path):
    """Fails if a real set that shows the other colours is said to show too little of the board."""
    scene, gains, numbers = seen(tmp_path, shared(f"real/{REAL}"), REAL, NUMBER)
    message = json.loads((tmp_path / "register.json").read_text())["messages"]
    assert any("the twin's board has its black and white swapped too" in line for line in message)
    assert gains.notna().sum() >= NUMBER and (numbers >= MIN_PATCHES).sum() >= NUMBER
