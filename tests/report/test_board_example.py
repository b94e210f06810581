"""A board's first picture: the twin is moved to where the photograph was taken from, and shows the lens that was found."""

import numpy as np

from draw_board_example import board_part, drawn, in_its_light, registered_view, twins_of
from effects import pipeline
from effects.base import Scene, View
from inputs.campaign import CalibrationBoard
from register.boards import BoardPoints
from rig.geometry import camera_matrix, perturb_pose, project, station_pose
from rig.targets import inverted_plate, target_plate

SIZE, SIDE_M, MARGIN = (320, 240), 0.02, 20
LENS = [("radial_distortion", {"k1": -0.25})]
BOARD = CalibrationBoard(type="chessboard", columns=7, rows=5, square_m=SIDE_M)
FACTS = {"left_open": ["light", "exposure", "white_balance", "reflectance"], "encoding": "srgb", "exposure": 1.0}


def checkerboard(view, margin):
    """Return the radiance (rows, columns) of 8 x 6 squares on the ground, 16 rays a pixel."""
    size = view.height + 2 * margin, view.width + 2 * margin
    y, x = (np.mgrid[: 4 * size[0], : 4 * size[1]] + 0.5) / 4 - 0.5 - margin
    H = np.linalg.inv(view.K @ view.T_cam_world[:3, [0, 1, 3]])
    ground = np.tensordot(H, np.stack([x, y, np.ones_like(x)]), 1)
    X, Y = ground[:2] / ground[2] / SIDE_M
    inside = (X > 0) & (X < 8) & (Y > 0) & (Y < 6)
    seen = np.where(inside, np.where((np.floor(X) + np.floor(Y)) % 2, 0.8, 0.05), 0.35)
    return seen.reshape(size[0], 4, size[1], 4).mean(axis=(1, 3)).astype(np.float32)


def test_the_twin_with_what_was_found_looks_like_the_photograph():
    """Fails if the render stays where it was, the lens is left out, or the photograph's light passes for a difference."""
    K = camera_matrix(300.0, 300.0, 159.5, 119.5)
    T = station_pose(0.22, 60)
    T[:3, 3] -= T[:3, :3] @ [0.08, -0.02, 0.0]
    taken = View(K, *SIZE, MARGIN * 4, T, "camera", "a", "a", 1.0, "srgb")
    seen = checkerboard(taken, 4 * MARGIN)[..., None] * np.array([0.6, 0.7, 0.9]) + 0.02
    photograph = pipeline.form_image(seen.astype(np.float32), taken, LENS, None)
    X, Y = np.meshgrid(np.arange(1.0, 8), np.arange(1.0, 6))
    board = np.column_stack([X.ravel() * SIDE_M, Y.ravel() * SIDE_M, np.zeros(X.size)])
    image = pipeline.map_points(project(K, T, board), taken, LENS)
    rendered = View(
        K, *SIZE, 0, perturb_pose(T, np.array([0.02, -0.01, 0.03, 0.002, 0.001, 0.004])), "camera", "a", "a", 1.0
    )
    radiance = checkerboard(rendered, MARGIN)
    verdict = {"configured": [], "steps": [{"effect": "radial_distortion", "parameters": {"k1": {"value": -0.25}}}]}
    twins = twins_of(verdict)
    assert twins == ([], LENS)
    points = BoardPoints(board, image, 0)
    views = [registered_view(rendered, points, e) for e in twins]
    scene = Scene((inverted_plate(target_plate(BOARD)),), 0.8, 0.05, 0.35, 0.35)
    shown = [
        in_its_light(
            lambda lit, v=v, e=e: drawn(radiance, MARGIN, rendered, v, e, lit), e, photograph, FACTS, scene, points
        )
        for v, e in zip(views, twins, strict=True)
    ]
    rows, columns = board_part(points, SIZE)
    inside = np.zeros(SIZE[::-1], bool)
    inside[rows, columns] = True
    before, after = (np.sqrt(((t - photograph)[inside] ** 2).mean()) for t in shown)
    assert after < 9 and after < 0.6 * before, (before, after)
    assert np.abs(views[1].T_cam_world - T).max() < 2e-3
