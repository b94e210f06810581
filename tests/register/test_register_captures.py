"""Registering a whole camera: what is written, and one message for captures that are not what the tables say."""

import json
import shutil

import cv2
import numpy as np
import pandas as pd
import pytest
import yaml

from case_files import load_case, read_capture
from expand_tables import expand_tables
from inputs.campaign import CalibrationBoard
from inputs.images import read_image
from register import boards
from register_captures import calibrations, register_captures
from rig.errors import InputError
from rig.geometry import camera_matrix, make_pose, project, station_pose
from rig.plates import code_cells
from seen_boards import embedded
from shared_files import shared
from tiny_campaign import HEIGHT, WIDTH, write_campaign


def register(campaign, camera, out):
    """Register a camera of a campaign; return (table, record)."""
    expand_tables(campaign, None, camera, out / "expand")
    register_captures(out / "expand", campaign, camera, out / "r.csv", out / "r.json")
    return pd.read_csv(out / "r.csv", dtype={"capture": str, "station": str}), json.loads((out / "r.json").read_text())


def fails(campaign, out, *words):
    """Check that registering the left camera ends with one message that has all the words, and writes nothing."""
    with pytest.raises(InputError) as caught:
        register(campaign, "left", out)
    message = str(caught.value)
    assert "\n" not in message
    for word in words:
        assert word in message, message
    assert not (out / "r.csv").exists() and not (out / "r.json").exists()


def test_a_campaign_without_a_marker_is_a_result(tmp_path):
    """Coverage 0 would be a crash, or captures would lose their nominal pose."""
    table, record = register(write_campaign(tmp_path / "c"), "left", tmp_path)
    assert list(table.capture) == ["left_a", "left_b"]
    assert set(table.status) == {"no_markers"} and (table.n_markers == 0).all()
    pose = table.loc[0, ["rx", "ry", "rz", "tx", "ty", "tz"]].to_numpy(float)
    assert np.allclose(make_pose(pose[:3], pose[3:]), station_pose(0.3, 45))
    assert [record[k] for k in ("fx", "fy", "cx", "cy")] == [50, 50, 31.5, 23.5]
    assert record["messages"] == ["2 of 2 captures show no marker or board"]


def test_points_that_no_camera_shows_are_one_message():
    """Fails if OpenCV's own error ends the run: markers in the squares of a board, described as a grid of 4 x 8."""
    grid = CalibrationBoard(
        type="aruco_grid", dictionary="DICT_4X4_1000", columns=4, rows=8, marker_m=0.01905, gap_m=0.006
    )
    images = [read_image(p) for p in sorted(shared("real/charuco_lifecam_480").glob("*.jpg"))[:8]]
    views = {str(k): boards.find_board(image, grid) for k, image in enumerate(images)}
    with pytest.raises(
        InputError, match=r"^here: camera left: no camera sees .* \(Principal point.*compare the description"
    ):
        calibrations(views, (640, 480), "here", "left")


def test_a_truncated_capture(tmp_path):
    """Half an image would be measured as if it were whole."""
    image = write_campaign(tmp_path / "c") / "images/left/b.png"
    image.write_bytes(image.read_bytes()[:-300])
    fails(tmp_path / "c", tmp_path, "capture left_b", "b.png", "truncated PNG")


def test_captures_of_another_size_are_told_together(tmp_path):
    """The user would fix one capture a run."""
    folder = write_campaign(tmp_path / "c") / "images/left"
    for name in ("a.png", "b.png"):
        cv2.imwrite(str(folder / name), np.zeros((HEIGHT, WIDTH + 2), np.uint8))
    fails(tmp_path / "c", tmp_path, "capture left_a", "capture left_b", "66 x 48 pixels, but its camera has 64 x 48")


def test_the_same_picture_twice(tmp_path):
    """A repeat that is a copy would make the floor look lower than it is, whatever the file's compression."""
    folder = write_campaign(tmp_path / "c") / "images/left"
    image = cv2.imread(str(folder / "a.png"), cv2.IMREAD_UNCHANGED)
    cv2.imwrite(str(folder / "b.png"), image, [cv2.IMWRITE_PNG_COMPRESSION, 9])
    fails(tmp_path / "c", tmp_path, "left_a", "images/left/a.png", "left_b", "images/left/b.png", "same picture")


def test_an_image_that_claims_too_much(tmp_path):
    """A header of 40,000 x 40,000 pixels would take all memory."""
    image = write_campaign(tmp_path / "c") / "images/left/a.png"
    data = bytearray(image.read_bytes())
    data[16:24] = (40_000).to_bytes(4, "big") * 2
    image.write_bytes(data)
    fails(tmp_path / "c", tmp_path, "capture left_a", "40000 x 40000 pixels")


def test_a_link_that_leaves_the_campaign(tmp_path):
    """An untrusted campaign would read any file of the user's."""
    folder = write_campaign(tmp_path / "c")
    expand_tables(folder, None, "left", tmp_path / "expand")
    shutil.move(folder / "images/left/a.png", tmp_path / "outside.png")
    (folder / "images/left/a.png").symlink_to(tmp_path / "outside.png")
    with pytest.raises(InputError, match="leaves the campaign's folder"):
        register_captures(tmp_path / "expand", folder, "left", tmp_path / "r.csv", tmp_path / "r.json")


@pytest.mark.parametrize(
    ("board", "words"),
    [
        ({"type": "charuco", "columns": 5, "rows": 4, "square_m": 0.04}, ("board.yaml", "needs dictionary")),
        ({"type": "sudoku", "columns": 5, "rows": 4}, ("board.yaml", "type")),
        (None, ("board.yaml", "no such file")),
    ],
)
def test_a_wrong_board_file(tmp_path, board, words):
    """board.yaml's faults would be a traceback."""
    folder = write_campaign(tmp_path / "c") / "calibration/left"
    folder.mkdir(parents=True)
    if board:
        (folder / "board.yaml").write_text(yaml.safe_dump(board))
    fails(tmp_path / "c", tmp_path, *words)


def rig_photographs(folder, K, poses):
    """Lay down a rig of two flat markers and its photographs by a perfect camera of unknown pose and intrinsics."""

    def describe(data):
        data["cameras"] = {"left": {"width": 640, "height": 480, "fx": None, "fy": None, "cx": None, "cy": None}}
        del data["tolerance"]

    rows = "".join(f"p{k},left,images/left/p{k}.png,,,,,,\n" for k in range(len(poses)))
    campaign = write_campaign(folder, describe, captures="capture,camera,image,rx,ry,rz,tx,ty,tz\n" + rows)
    for k, T in enumerate(poses):
        image = np.full((480, 640), 150, np.uint8)
        for dictionary, x in (("DICT_5X5_1000", -0.1), ("DICT_ARUCO_ORIGINAL", 0.1)):
            cells = np.pad(np.where(code_cells(dictionary, 3), 220, 20), 1, constant_values=220).astype(np.uint8)
            big = np.kron(cells, np.ones((20, 20), np.uint8))
            h = 0.035 * 9 / 7
            ground = np.array([[x - h, 0.4 + h, 0], [x + h, 0.4 + h, 0], [x + h, 0.4 - h, 0], [x - h, 0.4 - h, 0]])
            e = len(big) - 0.5
            source = np.array([[-0.5, -0.5], [e, -0.5], [e, e], [-0.5, e]], np.float32)
            H = cv2.getPerspectiveTransform(source, project(K, T, ground).astype(np.float32))
            cv2.warpPerspective(big, H, (640, 480), image, cv2.INTER_AREA, cv2.BORDER_TRANSPARENT)
        cv2.imwrite(str(campaign / f"images/left/p{k}.png"), image)
    return campaign


def by_hand():
    """Return poses T_cam_world of a camera that looks at the markers of ``rig_photographs`` from all sides."""
    poses = []
    for turn in ((0.5, 0, 0.1), (-0.5, 0.2, 0), (0.1, 0.6, -0.2), (0, -0.6, 0.3), (0.4, 0.4, 0.9)):
        T = make_pose(turn, (0, 0, 0)) @ make_pose((np.pi, 0, 0), (0, 0, 0))
        T[:3, 3] = [0, 0, 0.45] - T[:3, :3] @ [0, 0.4, 0]
        poses.append(T)
    return poses


def test_unknown_intrinsics_of_a_marker_rig_are_fitted(tmp_path):
    """The format allows null intrinsics for rigs of markers too; they would be refused, or guessed."""
    K, poses = camera_matrix(700, 700, 319.5, 239.5), by_hand()
    table, record = register(rig_photographs(tmp_path / "c", K, poses), "left", tmp_path)
    assert set(table.status) == {"registered"} and (table.n_markers == 2).all()
    assert abs(record["fx"] / 700 - 1) < 0.03 and record["fx"] == record["fy"]
    assert (record["cx"], record["cy"]) == (319.5, 239.5)
    for row, T in zip(table.itertuples(), poses, strict=True):
        assert np.abs(make_pose([row.rx, row.ry, row.rz], [0, 0, 0])[:3, :3] - T[:3, :3]).max() < 0.03


def test_plates_are_measured_where_captures_were_registered(tmp_path):
    """Fails if markers that were photographed by hand, from places that nobody wrote down, can't be diagnosed."""
    campaign = rig_photographs(tmp_path / "c", camera_matrix(700, 700, 319.5, 239.5), by_hand())
    register(campaign, "left", tmp_path)
    case, captures = load_case(tmp_path / "expand", tmp_path / "r.json", "left")
    assert np.isinf(case.sigma_pose).all()
    case.observe_real(case.captures[0], read_capture(campaign, captures.image.iloc[0]))
    assert case.captures[0].observation.measured.all()


def test_board_photographs(tmp_path):
    """A hand-held board campaign would have no poses, no ideal pinhole or other residuals than OpenCV's own."""
    table, record = register(shared("real/chess_opencv_left"), "chess_opencv_left", tmp_path)
    assert set(table.status) == {"registered"} and table.tz.gt(0).all()
    fits = record["calibrations"]
    assert [round(fits[m]["rms_px"], 2) for m in ("pinhole", "5")] == [1.55, 0.2]  # its README, OpenCV 4.11
    assert fits["8"]["rms_px"] <= fits["5"]["rms_px"] <= fits["pinhole"]["rms_px"]
    assert set(fits["5"]["views_rms_px"]) == set(table.capture) and all(
        v > 0 for v in fits["pinhole"]["se"].values() if v
    )
    assert record["fx"] == record["fy"] and (record["cx"], record["cy"]) == (319.5, 239.5)


def test_same_table_twice(tmp_path):
    """A rebuild would not be the same byte for byte."""
    campaign = shared("campaigns/frame")
    register(campaign, "hp325", tmp_path / "one")
    register(campaign, "hp325", tmp_path / "two")
    for name in ("r.csv", "r.json"):
        assert (tmp_path / "one" / name).read_bytes() == (tmp_path / "two" / name).read_bytes()


def test_threads_find_what_one_finds(tmp_path):
    """Fails if which of two photographs is looked at first changes a table, the intrinsics or the order of the points."""
    expand_tables(embedded(), None, "aruco6x6_gridboard", tmp_path / "expand")
    made = [[tmp_path / str(threads) / name for name in ("r.csv", "r.json", "points.npz")] for threads in (1, 2)]
    for threads, paths in zip((1, 2), made, strict=True):
        register_captures(tmp_path / "expand", embedded(), "aruco6x6_gridboard", *paths, threads=threads)
    assert [path.read_bytes() for path in made[0]] == [path.read_bytes() for path in made[1]]
    with np.load(made[0][2]) as points:
        assert np.isfinite(points["pixels"]).all(2).sum() > 21 * boards.MIN_POINTS


def test_wrong_legacy_flag_of_a_campaign(tmp_path):
    """A wrong flag in campaign.yaml would come out as "no board"."""
    source = shared("real/charuco_lifecam_480")
    shutil.copytree(source, tmp_path / "c")
    described = tmp_path / "c/campaign.yaml"
    described.write_text(described.read_text().replace("legacy_pattern: false", "legacy_pattern: true"))
    with pytest.raises(InputError, match="campaign.yaml: target: legacy_pattern is true but the photographs show"):
        register(tmp_path / "c", "charuco_lifecam_480", tmp_path)


def calibrated(folder, images, board):
    """Lay down a campaign whose left camera has some images of a board beside its captures."""

    def describe(data):
        data["cameras"]["left"] |= {"width": 640, "height": 480}

    write_campaign(folder, describe)
    for k, name in enumerate("ab"):
        noise = np.random.default_rng(k).integers(0, 255, (480, 640), dtype=np.uint8)
        cv2.imwrite(str(folder / f"images/left/{name}.png"), noise)
    (folder / "calibration/left").mkdir(parents=True)
    for image in images:
        shutil.copy(image, folder / "calibration/left")
    (folder / "calibration/left/board.yaml").write_text(yaml.safe_dump(board))
    return folder


def test_calibration_folder(tmp_path):
    """Calibration images beside the captures would be ignored, or another board's size would pass."""
    images = [shared("real/chess_opencv_left") / f"left0{k}.jpg" for k in range(1, 6)]
    board = {"type": "chessboard", "columns": 9, "rows": 6, "square_m": 0.025}
    folder = calibrated(tmp_path / "c", images, board)
    _, record = register(folder, "left", tmp_path)
    assert record["calibrations"]["5"]["rms_px"] < 0.3
    assert record["fx"] == 50  # the nominal camera stays the ideal twin
    cv2.imwrite(str(folder / "calibration/left/small.png"), np.zeros((48, 64), np.uint8))
    (tmp_path / "r.csv").unlink(), (tmp_path / "r.json").unlink()
    fails(folder, tmp_path, "small.png", "64 x 48 pixels")


@pytest.mark.parametrize(
    ("count", "change", "words"),
    [
        (5, {"columns": 5, "rows": 4}, "the board with columns and rows swapped: write columns: 4, rows: 5"),
        (5, {"dictionary": "DICT_5X5_1000"}, "markers of DICT_6X6_50, not of DICT_5X5_1000"),
        (5, {"rows": 4}, "go on below the last of the described 4 rows: write rows: 5"),
        (2, {}, "2 photographs, and a calibration takes 3: take 1 more"),
    ],
)
def test_a_calibrations_board_is_looked_at_like_a_campaigns(tmp_path, count, change, words):
    """Fails if a board.yaml of another board costs the calibration without a word, or calibrates with the wrong points."""
    board = yaml.safe_load((embedded() / "campaign.yaml").read_text())["target"] | change
    images = sorted((embedded() / "images").iterdir())[:count]
    fails(calibrated(tmp_path / "c", images, board), tmp_path, "calibration/left/board.yaml: ", words)
