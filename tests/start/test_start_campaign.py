"""A folder of photographs becomes a campaign in one command, with the right board, and says what it left out."""

import os
import shutil

import cv2
import numpy as np
import pytest

import start_campaign
from board_photographs import drawn, lay, photograph
from inputs.campaign import CalibrationBoard, load_campaign
from inputs.experiment import rig_markers
from inputs.safe_yaml import load_yaml
from markers.contract import marker_plate
from rig.targets import target_plate
from shared_files import shared

BOARDS = {
    "charuco": {"type": "charuco", "dictionary": "DICT_5X5_100", "columns": 7, "rows": 10, "square_m": 0.02, "marker_m": 0.015},
    "charuco even": {
        "type": "charuco", "dictionary": "DICT_4X4_50", "columns": 6, "rows": 8, "square_m": 0.02, "marker_m": 0.014,
    },
    "charuco legacy": {
        "type": "charuco", "dictionary": "DICT_6X6_50", "columns": 7, "rows": 6, "square_m": 0.02, "marker_m": 0.015,
        "legacy_pattern": True,
    },
    "chessboard": {"type": "chessboard", "columns": 8, "rows": 5, "square_m": 0.02},
    "aruco_grid": {
        "type": "aruco_grid", "dictionary": "DICT_6X6_50", "columns": 5, "rows": 4, "marker_m": 0.02, "gap_m": 0.005,
    },
    "apriltag_grid": {
        "type": "apriltag_grid", "dictionary": "DICT_APRILTAG_36h11", "columns": 4, "rows": 6, "marker_m": 0.02, "gap_m": 0.006,
    },
}  # fmt: skip
REAL = (
    "aruco6x6_gridboard", "charuco_lifecam_480", "charuco_lifecam_1280_old_pattern", "chess_opencv_left", "chess_picam_640",
)  # fmt: skip


@pytest.mark.parametrize("name", BOARDS)
def test_a_board_is_recognised(tmp_path, name):
    """Fails if type, dictionary, columns, rows, legacy pattern or the markers' size are guessed wrong."""
    own = CalibrationBoard.model_validate(BOARDS[name])
    folder = lay(tmp_path / "photos of mine", drawn(target_plate(own)))
    start_campaign.start_campaign(folder, 20)
    found = load_campaign(folder)
    target = found.file.target
    for key in ("type", "legacy_pattern"):
        assert getattr(target, key) == getattr(own, key), key
    assert own.dictionary is None or target.dictionary.split("_")[1] == own.dictionary.split("_")[1]  # same codes
    turned = own.type == "chessboard" and own.columns < own.rows
    assert (target.columns, target.rows) == ((own.rows, own.columns) if turned else (own.columns, own.rows))
    for key in ("square_m", "marker_m", "gap_m"):
        assert (getattr(target, key) or 0) == pytest.approx(getattr(own, key) or 0, rel=0.01, abs=3e-4), key
    assert len(found.captures) == 4 and found.file.name == "photos_of_mine"


def test_printed_plates_are_recognised(tmp_path):
    """Fails if plates that `make board` prints must be measured all over again."""
    table = rig_markers("config/rigs/ladders.yaml")
    canvas = np.full((2300, 1400), 110, np.uint8)
    for m in table.itertuples():
        flat = m._replace(x=0.0, y=0.0)
        plate = drawn(marker_plate(flat), 1000)
        left, top = round(650 + 1000 * m.x), round(2150 - 1000 * m.y)
        canvas[top : top + plate.shape[0], left : left + plate.shape[1]] = plate
    folder = tmp_path / "rail"
    folder.mkdir()
    for k in range(2):
        shift = np.float32([[0.5, 0, 20 + 9 * k], [0, 0.5, 10]])
        cv2.imwrite(str(folder / f"{k}.png"), cv2.warpAffine(canvas, shift, (760, 1180), borderValue=110))
    pattern, cameras, left_out = start_campaign.start_campaign(folder, None)
    found = load_campaign(folder)
    assert len(found.markers) == 40 and found.file.target is None and not left_out
    assert found.captures.rx.isna().all() and list(cameras) == ["camera"]
    assert "ladders.yaml" in pattern.guesses["markers"]


def test_what_is_left_out_is_said_and_why(tmp_path, capfd):
    """Fails if a photograph disappears in silence, or one that can't be used ends the run."""
    picture = drawn(target_plate(CalibrationBoard.model_validate(BOARDS["charuco"])))
    folder = lay(tmp_path / "it's mine", picture)
    shutil.copy(folder / "photo 0.png", folder / "copy.png")
    cv2.imwrite(str(folder / "small.png"), cv2.resize(photograph(picture, 9), None, fx=0.75, fy=0.75))
    cv2.imwrite(str(folder / "wall.jpg"), np.full((720, 960), 99, np.uint8))
    (folder / "cut.png").write_bytes((folder / "photo 1.png").read_bytes()[:4000])
    (folder / "curly{0}.png").write_bytes((folder / "photo 1.png").read_bytes())
    for name in (" blank.png", "turned \u202egnp.png", os.fsdecode(b"\xff bytes.png")):
        (folder / name).write_bytes((folder / "photo 1.png").read_bytes())
    (folder / "notes.txt").write_text("hello")
    start_campaign.main([str(folder)])
    said = capfd.readouterr().err
    for words in (
        "photo 0.png: the same picture as copy.png", "small.png: 720 x 540 pixels, with 1 usable; 3 of one camera",
        "wall.jpg: the board was not found in it", "cut.png: truncated PNG", "curly{0}.png: braces",
        " blank.png: its name has signs that can't be printed, or begins or ends with a blank", "gnp.png: its name has signs",
        "square_m is a guess: measure it", "next: snakemake --cores 2 --config 'campaign=",
    ):  # fmt: skip
        assert words in said, said
    assert "notes.txt" not in said and len(load_campaign(folder).captures) == 4
    assert "# GUESSED" in (folder / "campaign.yaml").read_text()


def test_cameras_are_told_apart_by_size(tmp_path):
    """Fails if photographs of two cameras are calibrated as one."""
    picture = drawn(target_plate(CalibrationBoard.model_validate(BOARDS["charuco"])))
    folder = lay(tmp_path / "two", picture)
    for k in range(3):
        cv2.imwrite(str(folder / f"small {k}.png"), cv2.resize(photograph(picture, 20 + k), None, fx=0.75, fy=0.75))
    _, cameras, _ = start_campaign.start_campaign(folder, 20)
    assert {name: len(group) for name, group in cameras.items()} == {"camera_960x720": 4, "camera_720x540": 3}


@pytest.mark.parametrize(("make", "message"), [
    (lambda folder: None, "no photographs"),
    (lambda folder: (folder / "campaign.yaml").write_text("mine"), "is there already"),
    (lambda folder: cv2.imwrite(str(folder / "a.png"), np.full((60, 80), 9, np.uint8)), "no photograph shows a chessboard"),
    (lambda folder: (folder / "a.jpg").write_bytes(b"\xff\xd8"), "no usable photograph; a.jpg: "),
])  # fmt: skip
def test_a_folder_that_is_none_is_one_line(tmp_path, capfd, make, message):
    """Fails if a user sees a traceback, or half a campaign is left behind."""
    folder = tmp_path / "empty"
    folder.mkdir()
    make(folder)
    before = sorted(folder.iterdir())
    with pytest.raises(SystemExit) as end:
        start_campaign.main([str(folder)])
    said = capfd.readouterr().err
    assert end.value.code == 1 and message in said and said.count("\n") == 1
    assert sorted(folder.iterdir()) == before


@pytest.mark.parametrize("name", REAL)
def test_real_boards_are_recognised(tmp_path, name):
    """Fails if photographs of cheap cameras, bent lenses and paper that is not flat are too much."""
    source = shared(f"real/{name}")
    for image in [*source.glob("*.jpg"), *source.glob("*.png")]:
        shutil.copy(image, tmp_path)
    true = load_yaml(source / "campaign.yaml")["target"]
    side = 1000 * true.get("square_m", true.get("marker_m"))
    start_campaign.start_campaign(tmp_path, side)
    found = load_campaign(tmp_path).file.target
    assert found.type == true["type"]
    assert sorted((found.columns, found.rows)) == sorted((true["columns"], true["rows"]))
    assert found.legacy_pattern == true.get("legacy_pattern", False)
    if "dictionary" in true:
        assert found.dictionary.split("_")[1] == true["dictionary"].split("_")[1]
        assert found.marker_m == pytest.approx(true["marker_m"], rel=0.02)
