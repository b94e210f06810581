"""Photographs that do not show the described board: one line that says what they show and what to do."""

import shutil

import cv2
import numpy as np
import pandas as pd
import pytest
import yaml

from expand_tables import expand_tables
from inputs.campaign import CalibrationBoard
from inputs.images import read_image
from register import boards, calibration
from register.board_checks import check_photographs, check_tilt, edge_width_px, fits, only_fitting
from register_captures import register_captures
from rig.errors import InputError
from seen_boards import EMBEDDED, embedded, photographs, refused
from shared_files import shared

MIRROR = CalibrationBoard(
    type="charuco", dictionary="DICT_4X4_250", columns=18, rows=10, square_m=0.02, marker_m=0.015
)  # of charuco_gopro12_mirror, which is no campaign


def mirrored(image):
    """Return what a mirror shows."""
    return np.ascontiguousarray(image[:, ::-1])


def shaken(image):
    """Return the image of a camera that moved sideways while it was exposed."""
    return cv2.blur(image, (25, 1))


def out_of_focus(image):
    """Return the image of a camera that looked elsewhere."""
    return cv2.GaussianBlur(image, (0, 0), 8)


@pytest.mark.parametrize(
    ("change", "seen", "words"),
    [
        ({"columns": 5, "rows": 4}, None, ["columns and rows swapped", "write columns: 4, rows: 5"]),
        ({"dictionary": "DICT_5X5_1000"}, None, ["markers of DICT_6X6_50, not of DICT_5X5_1000"]),
        ({"columns": 3, "rows": 7}, None, ["4 columns and 5 rows, not 3 and 7", "write columns: 4, rows: 5"]),
        ({}, mirrored, ["mirrored", "print it again"]),
        ({}, out_of_focus, ["too blurred", "focus"]),
        ({}, lambda image: np.full_like(image, 90), ["0 of 7 photographs show the board", "4 columns, 5 rows"]),
    ],
)
def test_what_a_grid_is_instead_is_said(change, seen, words):
    """Fails if the user is told "no board" of a board that is there, or told to change what is right."""
    images, board = photographs(embedded(), 7)
    images = {name: seen(image) if seen else image for name, image in images.items()}
    message = refused(images, board.model_copy(update=change))
    for word in words:
        assert word in message, message


@pytest.mark.parametrize(
    ("folder", "change", "seen", "words"),
    [
        ("charuco_screen_wide", {"columns": 9, "rows": 18}, None, "write columns: 18, rows: 9"),
        (
            "charuco_screen_wide",
            {"columns": 17, "rows": 8},
            None,
            "count its squares, not inner corners: write columns: 18",
        ),
        ("charuco_screen_wide", {"dictionary": "DICT_5X5_250"}, None, "markers of DICT_4X4_100, not of DICT_5X5_250"),
        ("charuco_screen_wide", {}, mirrored, "mirrored"),
        (
            "chess_opencv_left",
            {"columns": 10, "rows": 7},
            None,
            "inner corners, not its squares: write columns: 9, rows: 6",
        ),
        ("chess_opencv_left", {}, shaken, "too blurred"),
    ],
)
def test_what_other_boards_are_instead_is_said(folder, change, seen, words):
    """Fails if only grids are understood, or if photographs that a hand has shaken pass for another board."""
    images, board = photographs(shared(f"real/{folder}"), 4)
    images = {name: seen(image) if seen else image for name, image in images.items()}
    assert words in refused(images, board.model_copy(update=change))


def test_a_real_mirror_is_seen_through():
    """Fails if what a mirror shows is found only where a program has flipped the image."""
    folder = shared("real/charuco_gopro12_mirror")
    assert "mirrored" in refused({p.name: read_image(p) for p in sorted(folder.glob("*.jpg"))[:2]}, MIRROR)


def test_too_few_photographs_are_counted():
    """Fails if five photographs pass, if six do not, or if those that lack the board are not named."""
    images, board = photographs(embedded(), 7)
    names = list(images)
    assert "5 photographs, and a verdict takes 6: take 1 more" in refused({n: images[n] for n in names[:5]}, board)
    for name in names[:2]:
        images[name] = np.full_like(images[name], 90)
    message = refused(images, board)
    assert f"5 of 7 photographs show the board (not found in {names[0]}, {names[1]})" in message
    images, board = photographs(embedded(), 6)
    found = {name: boards.find_board(image, board) for name, image in images.items()}
    check_photographs(found, board, images.get, "here")


def test_a_board_of_a_wide_lens_fits_and_another_layout_does_not():
    """Fails if distortion of a fifth of a square is taken for another board."""
    images, board = photographs(shared("real/charuco_screen_wide"), 2)
    assert all(fits(boards.find_board(image, board), board) for image in images.values())
    images, board = photographs(embedded(), 2)
    other = board.model_copy(update={"columns": 5, "rows": 4})
    messages = []
    found = {name: boards.find_board(image, other) for name, image in images.items()}
    assert all(len(v.image) == 0 for v in only_fitting(found, other, messages).values())
    assert "lie otherwise than on the described board in 0, 2" in messages[0]


@pytest.mark.parametrize("sigma_px", [1.5, 2.5])
def test_an_edge_is_as_wide_as_it_was_made(sigma_px):
    """Fails if the width is measured in other units than pixels, or if one sharp direction hides a shaken one."""
    image = np.full((200, 200), 40, np.uint8)
    image[60:140, 60:140] = 200
    assert edge_width_px(cv2.GaussianBlur(image, (0, 0), sigma_px)) == pytest.approx(2.51 * sigma_px, rel=0.12)
    assert edge_width_px(image) < 2.5
    assert edge_width_px(cv2.blur(image, (15, 1))) > 10
    assert edge_width_px(np.full_like(image, 90)) == np.inf


def views_of(tilts_deg, focal_px=800.0):
    """Return {name: BoardPoints} of a grid of points seen by a pinhole from the front, tilted by some degrees."""
    rng, grid = (
        np.random.default_rng(0),
        np.stack(np.meshgrid(np.arange(8), np.arange(6), [0]), -1).reshape(-1, 3) * 0.03,
    )
    views = {}
    for k, tilt in enumerate(tilts_deg):
        axis = np.array([np.cos(k), np.sin(k), 0]) * np.radians(tilt)
        R = cv2.Rodrigues(axis)[0] @ np.diag([1.0, -1, -1])
        X = (grid - grid.mean(0)) @ R.T + [0.02 * np.sin(3 * k), 0.02 * np.cos(5 * k), 0.4 + 0.02 * k]
        pixels = X[:, :2] / X[:, 2:] * focal_px + [319.5, 239.5] + rng.normal(0, 0.1, (len(grid), 2))
        views[str(k)] = boards.BoardPoints(grid, pixels, 0)
    return views


def test_photographs_from_straight_on_cannot_tell_a_focal_length():
    """Fails if a focal length that could be twice as long passes, or if a few tilted photographs are not enough."""
    flat, tilted = views_of([0.0] * 8), views_of([0.0] * 5 + [15.0] * 3)
    with pytest.raises(InputError, match=r"here: .*from one side.*tilted by 20 to 45.*fx = fy = 812\)"):
        check_tilt(flat, calibration.calibrate(flat, (640, 480), 0), "here", 812.3)
    check_tilt(tilted, calibration.calibrate(tilted, (640, 480), 0), "here")


@pytest.mark.parametrize("name", ["charuco_lifecam_1280_old_pattern", "chess_gloworm_960", "chess_gopro_wide"])
def test_real_photographs_that_tell_a_focal_length_pass(name):
    """Fails if the sets with the least tilt, 15 degrees, or the widest lens are refused."""
    folder = shared(f"real/{name}")
    images, board = photographs(folder, 100)
    found = {k: boards.find_board(image, board) for k, image in images.items()}
    views = {k: v for k, v in found.items() if fits(v, board)}
    size = next(iter(images.values())).shape[1::-1]
    check_tilt(views, calibration.calibrate(views, size, 0), "here")


def campaign_with(folder, count, **target):
    """Lay the first of the embedded photographs down with another description of the board."""
    shutil.copytree(embedded(), folder)
    pd.read_csv(folder / "captures.csv", dtype=str).iloc[:count].to_csv(folder / "captures.csv", index=False)
    data = yaml.safe_load((folder / "campaign.yaml").read_text())
    data["target"] |= target
    (folder / "campaign.yaml").write_text(yaml.safe_dump(data))
    return folder


@pytest.mark.parametrize(
    ("count", "target", "words"),
    [(21, {"columns": 5, "rows": 4}, "write columns: 4, rows: 5"), (4, {}, "4 photographs, and a verdict takes 6")],
)
def test_registering_refuses_them_and_writes_nothing(tmp_path, count, target, words):
    """Fails if the check is there and nobody asks it."""
    campaign = campaign_with(tmp_path / "c", count, **target)
    expand_tables(campaign, None, EMBEDDED.name, tmp_path / "expand")
    with pytest.raises(InputError, match=f"campaign.yaml: target: .*{words}"):
        register_captures(tmp_path / "expand", campaign, EMBEDDED.name, tmp_path / "r.csv", tmp_path / "r.json")
    assert not (tmp_path / "r.csv").exists() and not (tmp_path / "r.json").exists()
