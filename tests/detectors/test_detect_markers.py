"""The command line on any images: rows, videos, bad files, nothing half-written."""

import subprocess
import sys
from pathlib import Path

import cv2
import numpy as np
import pandas as pd
import pytest

from bench.marker_scenes import scene
from detect_markers import COLUMNS, detect_markers, read_image
from rig.errors import InputError
from shared_files import shared

BOTH = ["DICT_5X5_1000", "DICT_ARUCO_ORIGINAL"]
SCRIPT = Path(__file__).resolve().parents[2] / "scripts" / "detect_markers.py"


@pytest.fixture(scope="module")
def images(tmp_path_factory):
    folder = tmp_path_factory.mktemp("images")
    image, truth = scene(np.random.default_rng(0), 640, 480, 4, (60, 70), (0, 20))
    cv2.imwrite(str(folder / "markers.png"), image)
    cv2.imwrite(str(folder / "deep.tiff"), image.astype(np.uint16) * 257)
    cv2.imwrite(str(folder / "empty.jpg"), np.full((60, 80), 128, np.uint8))
    video = cv2.VideoWriter(str(folder / "film.avi"), cv2.VideoWriter_fourcc(*"MJPG"), 10, (640, 480))
    for _ in range(3):
        video.write(cv2.cvtColor(image, cv2.COLOR_GRAY2BGR))
    video.release()
    return folder, {(t.dictionary, t.id) for t in truth}


def test_a_row_a_marker_and_an_empty_id_without_any(images, tmp_path):
    folder, truth = images
    out = tmp_path / "o.csv"
    names = [str(folder / n) for n in ("markers.png", "empty.jpg", "deep.tiff", "film.avi")]
    command = [sys.executable, str(SCRIPT), "bart", *names, "--out", str(out)]
    assert subprocess.run(command, capture_output=True).returncode == 0
    table = pd.read_csv(out, dtype={"id": "Int64"})
    assert list(table.columns) == COLUMNS
    assert (table.ms > 0).all() and (table.groupby("image").ms.nunique() == 1).all()
    empty = table[table.image == names[1]]
    assert len(empty) == 1 and empty.id.isna().all() and empty.x0.isna().all()
    films = [f"{names[3]}#frame{k}" for k in range(3)]
    assert list(table.image.unique()) == [*names[:3], *films]
    for name in (names[0], names[2], *films):
        rows = table[table.image == name]
        assert set(zip(rows.dictionary, rows.id, strict=True)) == truth


def test_one_frame_of_a_video(images, tmp_path):
    folder, truth = images
    detect_markers("bart", [f"{folder}/film.avi#frame2"], tmp_path / "o.csv", BOTH)
    table = pd.read_csv(tmp_path / "o.csv")
    assert set(table.image) == {f"{folder}/film.avi#frame2"} and len(table) == len(truth)
    with pytest.raises(InputError, match="no frame 3; it ends at frame 2"):
        detect_markers("aruco", [f"{folder}/film.avi#frame3"], tmp_path / "o.csv", BOTH)


def test_a_bad_image_is_one_message_and_leaves_the_old_table(images, tmp_path):
    folder, _ = images
    out = tmp_path / "o.csv"
    out.write_text("earlier")
    whole = (folder / "markers.png").read_bytes()
    (tmp_path / "cut.png").write_bytes(whole[: len(whole) // 2])
    (tmp_path / "words.png").write_text("no picture")
    (tmp_path / "words.avi").write_text("no film")
    # A header that asks for 40,000 x 40,000 pixels.
    huge = whole[:16] + (40000).to_bytes(4, "big") * 2 + whole[24:]
    (tmp_path / "huge.png").write_bytes(huge)
    for bad in ("cut.png", "words.png", "words.avi", "huge.png", "none.png"):
        names = [str(folder / "markers.png"), str(tmp_path / bad)]
        command = [sys.executable, str(SCRIPT), "aruco", *names, "--out", str(out)]
        done = subprocess.run(command, capture_output=True, text=True)
        errors = [line for line in done.stderr.splitlines() if line.startswith("error:")]
        assert done.returncode == 1 and len(errors) == 1 and bad in errors[0]
        assert "Traceback" not in done.stderr
        assert out.read_text() == "earlier" and sorted(p.name for p in tmp_path.glob("*o.csv*")) == ["o.csv"]


def test_colour_and_depth_survive_reading(images):
    folder, _ = images
    assert read_image(folder / "deep.tiff").dtype == np.uint16
    assert read_image(folder / "markers.png").ndim == 2


def test_the_published_frames_of_a_real_video_are_read(tmp_path):
    film = shared("real/aruco_original_single/video.avi")
    detect_markers("bart", [f"{film}#frame5"], tmp_path / "o.csv", BOTH)
    ids = set(pd.read_csv(tmp_path / "o.csv").id)
    assert {601, 701, 801, 901, 1001} <= ids <= {101, 601, 701, 801, 901, 1001}
