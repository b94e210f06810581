"""Boards that are bent or stretched in print, pixels that are not square: points by OpenCV, so that what is hidden is known."""

from dataclasses import replace
from types import SimpleNamespace

import cv2
import numpy as np
import pytest

from effects import library, pipeline
from effects.base import Scene, View
from gap.boards.board import board_case, on_board, seen_by_points
from gap.boards.needs import Told, cannot_tell
from gap.select.select_effects import verdict
from register.registration import NO_PRIOR, pose_from_plane
from rig.geometry import camera_matrix
from rig.targets import target_plate

COLUMNS, ROWS, SQUARE_M, NOISE_PX = 9, 6, 0.025, 0.1
SIZE, K = (1280, 960), camera_matrix(1100.0, 1100.0, 639.5, 479.5)
BOARD = SimpleNamespace(type="chessboard", columns=COLUMNS, rows=ROWS, square_m=SQUARE_M)
SCENE = Scene((target_plate(BOARD),), 0.8, 0.05, 0.3, 0.3)
POINTS = np.array([[x, y, 0.0] for y in range(1, ROWS + 1) for x in range(1, COLUMNS + 1)]) * SQUARE_M
COMPETING = [
    "board_bend", "pixel_aspect", "principal_point", "print_stretch", "radial_distortion", "rolling_shutter",
    "tangential_distortion",
]  # fmt: skip


def photographed(points, fy_ratio=1.0, rolled=True, number=14):
    """Return the BoardCase of photographs of points (p, 3), metres, by a camera whose rows are another length than columns."""
    rng, views, pixels = np.random.default_rng(3), [], []
    true_K = K * np.array([[1.0], [fy_ratio], [1.0]])
    true_K[1, 2] = K[1, 2]
    middle = POINTS.mean(axis=0)
    for k in range(number):
        turn = np.deg2rad(90.0 * (k % 2)) if rolled else 0.0
        R = cv2.Rodrigues(rng.uniform(-0.6, 0.6, 3) * [1, 1, 0.2])[0] @ cv2.Rodrigues(np.array([0, 0, turn]))[0]
        R = R @ np.diag([1.0, -1.0, -1.0])
        t = np.array([*rng.uniform(-0.03, 0.03, 2), rng.uniform(0.35, 0.5)]) - R @ middle
        xy = cv2.projectPoints(points, cv2.Rodrigues(R)[0], t, true_K, None)[0][:, 0]
        xy += NOISE_PX * rng.standard_normal(xy.shape)
        xy[(xy < 0).any(1) | (xy > np.array(SIZE) - 1).any(1)] = np.nan
        seen = np.isfinite(xy).all(1)
        T = pose_from_plane(POINTS[seen], xy[seen], K)
        views.append(View(K, *SIZE, 0, T, "c", f"p{k:02d}", f"p{k:02d}"))
        pixels.append(xy)
    return board_case("c", "c", SCENE, views, [0] * number, POINTS, np.array(pixels), NOISE_PX, False, NO_PRIOR)


def bowed(height_m):
    """Return the board's points where its middle is higher than its left and right edge."""
    paper = (COLUMNS + 1 + 1) * SQUARE_M  # half a square of margin on each side
    off = (POINTS[:, 0] - (COLUMNS + 1) * SQUARE_M / 2) / (paper / 2)
    return POINTS + np.column_stack([0 * off, 0 * off, height_m * (1 - off**2)])


def test_a_bowed_board_is_named_with_its_height():
    """Fails if paper that is not flat is taken for a lens, or its height for another board's."""
    _, _, _, outcome = verdict(photographed(bowed(0.006)), candidates=COMPETING)
    assert (outcome.verdict, [s.effect for s in outcome.steps]) == ("explained", ["board_bend"])
    found = dict(outcome.twin.effects)["board_bend"]
    assert found["bow_x_m"] == pytest.approx(0.006, abs=0.0006)
    assert abs(found["bow_y_m"]) < 0.0006 and abs(found["twist_m"]) < 0.0006


@pytest.mark.parametrize("rolled", [True, False])
def test_pixels_that_are_not_square_are_no_rolling_shutter(rolled):
    """Fails if rows of another length are called a shutter that skews them by as much, which has four parameters."""
    _, _, _, outcome = verdict(photographed(POINTS, fy_ratio=1.006, rolled=rolled), candidates=COMPETING)
    assert (outcome.verdict, [s.effect for s in outcome.steps]) == ("explained", ["pixel_aspect"])
    assert dict(outcome.twin.effects)["pixel_aspect"]["ratio"] == pytest.approx(1.006, abs=0.0015)


def test_a_print_that_is_longer_one_way_is_told_from_pixels_by_a_rolled_camera():
    """Fails if the print's lines do not move with their ratio, or photographs turned by 90 degrees tell nothing."""
    longer = POINTS * [1.0, 1.008, 1.0]
    _, _, _, outcome = verdict(photographed(longer), candidates=COMPETING)
    assert (outcome.verdict, [s.effect for s in outcome.steps]) == ("explained", ["print_stretch"])
    assert dict(outcome.twin.effects)["print_stretch"]["ratio"] == pytest.approx(1.008, abs=0.0015)
    assert "pixel_aspect" not in outcome.steps[0].confused_with


def test_points_lie_on_the_board_as_it_is_drawn():
    """Fails if the points of a bent and stretched print are not corners of the cells that are drawn of it."""
    chosen = [
        ("board_bend", {"bow_x_m": 0.01, "bow_y_m": -0.004, "twist_m": 0.003}),
        ("print_stretch", {"ratio": 1.02}),
    ]
    scene = pipeline.scene_with_effects(SCENE, chosen)
    drawn = scene.plates[0].grid_world().reshape(-1, 3)
    points = on_board(scene, SCENE, POINTS)
    assert np.abs(points - POINTS).max() > 0.007
    assert np.linalg.norm(points[:, None] - drawn[None], axis=-1).min(axis=1).max() < 1e-12
    assert on_board(SCENE, SCENE, POINTS) is POINTS


def test_a_rig_has_no_effects_of_boards():
    """Fails if a board's effects compete where a rig's numbers are declared, or are not asked of photographs of a board."""
    of_boards = [n for n in library.available_effects() if library.is_of_boards(n)]
    assert of_boards and set(of_boards) <= set(seen_by_points(library.available_effects()))


def test_photographs_that_cannot_tell_say_which_ones_would():
    """Fails if information is counted that poses or other effects take up, or what is asked for does not hold it."""
    search, _, _, outcome = verdict(photographed(POINTS, fy_ratio=1.006, rolled=False), candidates=COMPETING)
    hidden, alike, needs = cannot_tell(search, outcome.twin, COMPETING)
    assert "print_stretch" in hidden and "radial_distortion" not in hidden
    assert alike == {
        "pixel_aspect": ["rolling_shutter"]
    }  # rows that slide show the same in all photographs of any kind
    (need,) = needs
    assert need["effect"] == "print_stretch" and "roll the camera by 90 degrees" in need["text"]
    search, _, _, outcome = verdict(photographed(POINTS, fy_ratio=1.006, rolled=True), candidates=COMPETING)
    assert "print_stretch" not in cannot_tell(search, outcome.twin, COMPETING)[0]


def test_what_stays_open_hides_effects_as_noise_does():
    """Fails if photographs that differ by twice what the twin explains are said to tell as much as good ones."""
    search, base, _, _ = verdict(photographed(POINTS), candidates=COMPETING)
    open_ones = replace(base, floors={name: floor / 2 for name, floor in base.floors.items()} or {"corners": 0.5})
    clear, hazy = (Told(search, twin, COMPETING).seen("radial_distortion") for twin in (base, open_ones))
    assert open_ones.gap == pytest.approx(2 * base.gap, rel=0.01)
    assert hazy == pytest.approx(clear * max(base.gap, 1) ** 2 / open_ones.gap**2, rel=1e-6)
