"""Board points: their place to a thousandth of a pixel, our board frame, chessboards seen the other way round."""

import cv2
import numpy as np
import pytest

from effects.motion_blur import motion_blur_kernel
from inputs.campaign import CalibrationBoard
from inputs.images import read_image
from register import boards
from register.registration import pose_from_plane, register_pose
from rig.board_markers import charuco_board
from rig.errors import InputError
from rig.geometry import camera_matrix, project, station_pose
from rig.targets import target_plate
from shared_files import shared

K = camera_matrix(900, 900, 399.5, 299.5)
SIZE = 800, 600
BOARDS = {
    "charuco": CalibrationBoard(
        type="charuco", dictionary="DICT_5X5_1000", columns=7, rows=6, square_m=0.04, marker_m=0.03
    ),
    "charuco_legacy": CalibrationBoard(
        type="charuco",
        dictionary="DICT_4X4_50",
        columns=8,
        rows=6,
        square_m=0.04,
        marker_m=0.03,
        legacy_pattern=True,
    ),
    "chessboard": CalibrationBoard(type="chessboard", columns=6, rows=5, square_m=0.04),
    "chessboard_square": CalibrationBoard(type="chessboard", columns=5, rows=5, square_m=0.045),
    "aruco_grid": CalibrationBoard(
        type="aruco_grid", dictionary="DICT_5X5_1000", columns=4, rows=3, marker_m=0.05, gap_m=0.02
    ),
    "apriltag_grid": CalibrationBoard(
        type="apriltag_grid", dictionary="DICT_APRILTAG_36h11", columns=4, rows=3, marker_m=0.05, gap_m=0.02
    ),
}


def view(turn_deg=10.0):
    """Return T_cam_board of a camera half a metre off, leaning and rolled by some degrees."""
    T = station_pose(0.55, 75)
    T[:3, 3] += T[:3, :3] @ [-0.14, 0.02, 0]
    s, c = np.sin(np.radians(turn_deg)), np.cos(np.radians(turn_deg))
    roll = np.eye(4)
    roll[:2, :2] = [[c, -s], [s, c]]
    return roll @ T


def photograph(board, T, finer=4):
    """Return the ideal 8-bit image of the board's plate: each pixel the mean of finer x finer exact looks at it."""
    plate = target_plate(board)
    steps = (np.arange(finer) + 0.5) / finer - 0.5
    x = (np.arange(SIZE[0])[:, None] + steps).ravel()
    y = (np.arange(SIZE[1])[:, None] + steps).ravel()
    to_plane = np.linalg.inv(K @ T[:3, [0, 1, 3]])
    px, py = np.meshgrid(x, y)
    w = to_plane @ np.stack([px.ravel(), py.ravel(), np.ones(px.size)])
    column = np.searchsorted(plate.x_m, w[0] / w[2]) - 1
    row = np.searchsorted(plate.y_m, w[1] / w[2]) - 1
    inside = (column >= 0) & (column < plate.white.shape[1]) & (row >= 0) & (row < plate.white.shape[0])
    value = np.full(column.shape, 150.0)
    value[inside] = np.where(plate.white[row[inside], column[inside]], 220, 30)
    return value.reshape(SIZE[1], finer, SIZE[0], finer).mean((1, 3)).round().astype(np.uint8)


@pytest.mark.parametrize("name", BOARDS)
def test_a_drawn_board_gives_back_its_pose(name):
    """Signs, origin or order of the board frame would be wrong: the twin's board would lie elsewhere."""
    T = view()
    found = boards.find_board(photograph(BOARDS[name], T), BOARDS[name])
    assert len(found.image) >= boards.MIN_POINTS and not found.inverted
    fitted, _, rms = register_pose(
        found.board, found.image, K, pose_from_plane(found.board, found.image, K), np.full(6, np.inf)
    )
    assert rms < 0.5
    assert np.abs(fitted - T).max() < 0.005


@pytest.mark.parametrize("turn_deg", [100, 190, 280])
@pytest.mark.parametrize("finder", [boards.find_board, boards.find_chessboard_by_sectors])
def test_a_turned_chessboard_is_numbered_by_its_colours(finder, turn_deg):
    """The twin would show white squares where the photograph has black ones."""
    board, T = BOARDS["chessboard"], view(turn_deg)
    found = finder(photograph(board, T), board)
    assert not found.inverted
    assert np.linalg.norm(project(K, T, found.board) - found.image, axis=1).max() < 0.5


def test_swapped_colours_are_noticed():
    """A board printed with white corner squares would be taken for ours without a word."""
    board = CalibrationBoard(
        type="chessboard", columns=6, rows=4, square_m=0.04
    )  # 7 x 5 squares: no turn swaps its colours
    image = photograph(board, view())
    for picture, inverted in ((image, False), (255 - image, True)):
        found = boards.find_chessboard_by_sectors(picture, board)
        assert len(found.image) == 24 and found.inverted == inverted


def test_charuco_corners_have_no_half_pixel():
    """opencv#25539: OpenCV's own are half a pixel off before its pull request 28380, and right after it.

    Wrong if OpenCV changed and CHARUCO_OFFSET_PX did not: principal points would be half a pixel off.
    """
    side = 40
    board = CalibrationBoard(
        type="charuco", dictionary="DICT_5X5_1000", columns=7, rows=6, square_m=0.04, marker_m=0.03
    )
    drawn = charuco_board(board).generateImage((7 * side, 6 * side))
    image = cv2.copyMakeBorder(drawn, 30, 30, 30, 30, cv2.BORDER_CONSTANT, value=255)
    found = boards.find_board(image, board)
    # square k of the drawing spans the pixels 30 + 40 k to 69 + 40 k: its edge lies half a pixel before the first
    exact = np.stack([found.board[:, 0], 6 * board.square_m - found.board[:, 1]], 1) / board.square_m * side + 29.5
    error = found.image - exact
    assert len(found.image) == 6 * 5
    assert np.abs(error).max() < 1e-3


@pytest.mark.parametrize("flag", [True, False])
def test_wrong_legacy_flag_is_said(flag):
    """A wrong legacy flag would come out as "no board found"."""
    board = BOARDS["charuco_legacy"].model_copy(update={"legacy_pattern": flag})
    wrong = board.model_copy(update={"legacy_pattern": not flag})
    image = photograph(board, view())
    assert len(boards.find_board(image, wrong).image) == 0
    shown = "the legacy pattern" if flag else "the pattern of today"
    message = f"here: legacy_pattern is {str(not flag).lower()} but the photographs show {shown}"
    with pytest.raises(InputError, match=message):
        boards.check_legacy_pattern([image], wrong, "here")
    boards.check_legacy_pattern([image], board, "here")


def test_wrong_legacy_flag_on_photographs():
    """The message would appear on drawings only."""
    folder = shared("real/charuco_lifecam_1280_old_pattern")
    board = CalibrationBoard(
        type="charuco", dictionary="DICT_4X4_1000", columns=8, rows=8, square_m=0.0254, marker_m=0.01905
    )
    image = read_image(sorted(folder.glob("*.jpg"))[0])
    with pytest.raises(InputError, match="legacy_pattern is false but the photographs show the legacy pattern"):
        boards.check_legacy_pattern([image], board, "target")


def test_markers_that_a_shaken_camera_closes_are_read():
    """Fails if a photograph is lost whose markers blur has closed, or if its points lie where a sharpened image has them."""
    board, T = BOARDS["charuco"], view()
    kernel = motion_blur_kernel(11.3, 6.5)  # 13 px long
    shaken = cv2.filter2D(photograph(board, T), -1, kernel, borderType=cv2.BORDER_REPLICATE)
    shaken = shaken + np.random.default_rng(1).normal(0, 1.5, shaken.shape)
    found = boards.find_board(np.clip(np.rint(shaken), 0, 255).astype(np.uint8), board)
    assert len(found.image) >= boards.MIN_POINTS
    assert np.sqrt(((found.image - project(K, T, found.board)) ** 2).sum(1).mean()) < 0.1


def test_an_empty_image_shows_no_board():
    """A capture without the board would crash."""
    blank = np.full((60, 80), 128, np.uint8)
    for board in BOARDS.values():
        assert len(boards.find_board(blank, board).image) == 0


def test_corners_of_squares_that_the_frame_cuts_are_left_out():
    """Fails if the corner of what is left of a cut square is a point of the board, up to half a square from where that is,
    or if a wide lens, which bends the ends of all lines, loses true corners.
    """
    x, y = np.meshgrid(np.arange(9.0), np.arange(6.0))
    grid = np.stack([140 + 45 * x + 2 * y, 210 + 50 * y - 3 * x + 0.4 * y**2], axis=-1)  # last row: 470 to 446 of 480
    cut = grid.copy()
    cut[5, :3] += [[0.0, -23.0], [-7.0, -8.0], [6.0, -6.0]]
    whole = boards.whole_corners(cut, (480, 640))
    assert not whole[5, :3].any() and whole.sum() == 51
    assert boards.whole_corners(cut, (600, 640)).all()  # nothing is cut: the finder saw whole squares
    bent = grid.copy()
    bent[5, :, 1] -= 7.0
    assert boards.whole_corners(bent, (480, 640)).all()
