"""Photographs of a board, drawn by the twin's own image formation with a light, a blur, noise and poses of their own."""

import numpy as np

from effects import pipeline
from effects.base import Scene, View
from gap.boards.photographs import photographs_case
from gap.problem import MARGIN_PX, Capture
from inputs.campaign import CalibrationBoard
from rig.geometry import camera_matrix, make_pose
from rig.light import LIGHT
from rig.patches import board_patches
from rig.targets import target_plate

BOARD = CalibrationBoard.model_validate({"type": "chessboard", "columns": 8, "rows": 6, "square_m": 0.03})
SCENE = Scene((target_plate(BOARD),), 0.9, 0.04, 0.9, 0.9)
K = camera_matrix(420.0, 420.0, 159.5, 119.5)


def view_of(k, name):
    """Return a View of the board from above, each from another place."""
    middle = np.array([0.135, 0.105, 0.0])
    tilt = np.array([[0.5, 0.1], [-0.4, 0.3], [0.1, -0.5], [0.3, 0.4], [-0.3, -0.3], [0.45, -0.2]][k % 6]) * (
        1 + 0.1 * k
    )
    T = make_pose([np.pi + tilt[0], tilt[1], 0.05 * k], [0.0, 0.0, 0.0])
    T[:3, 3] = np.array([0.01 * (k % 3 - 1), 0.01 * (k % 2), 0.42]) - T[:3, :3] @ middle
    return View(K, 320, 240, MARGIN_PX, T, "camera", name, name)


def light_of(k):
    """Return LIGHT (11,) of photograph k."""
    values = {
        "gain": -0.5 + 0.05 * k,
        "along_x": 0.1 - 0.04 * k,
        "along_y": 0.05,
        "red": -0.2,
        "blue": 0.15,
        "stray": 0.01,
    }
    return np.array([values.get(name, 0.0) for name in LIGHT])


def on_board(view, x, y):
    """Return the board's x and y at pixels, where its plane is z = 0."""
    H = np.linalg.inv(view.K @ view.T_cam_world[:3, [0, 1, 3]])
    u, v, w = (H[k, 0] * x + H[k, 1] * y + H[k, 2] for k in range(3))
    return u / w, v / w


def board_case(number):
    """Return the PhotographsCase of so many captures of the board, nothing measured."""
    captures = [Capture(view_of(k, f"p{k}"), 1) for k in range(number)]
    return photographs_case("c", "camera", SCENE, captures, board_patches(BOARD, *SCENE.plates))


def photograph(case, k, effects, noise_dn=1.0):
    """Return the grey levels (H, W, 3) of capture k with some effects, in its own light, noise drawn by its number."""
    capture, m = case.captures[k], MARGIN_PX
    whole = case.radiance_of(capture, effects, np.zeros(6))
    x, y = np.meshgrid(np.arange(-m, 320 + m), np.arange(-m, 240 + m))
    lit = case.lit(whole, light_of(k), *on_board(capture.view, x, y))
    image = pipeline.form_image(lit, capture.view, pipeline.left_to_apply(effects), None)
    return np.clip(np.rint(image + np.random.default_rng(k).normal(0, noise_dn, image.shape)), 0, 255)
