"""Real frames from Blender: where they show corners, what they hide, what is kept, and the way to the tables."""

import cv2
import numpy as np
import pandas as pd
import pytest

from detect_markers import read_frames
from detect_moving import detect_moving
from detectors.contract import make
from draw_moving import draw_moving
from markers.contract import marker_corners_world
from measure_moving import measure_moving
from moving.config import load_moving
from moving.trajectories import project_rolling
from moving.truth import CORNERS
from render_moving import render_moving
from trace_moving import trace_moving

FILE = """
name: tiny
rig: rig.yaml
camera: {width: 240, height: 180, fov_deg: 50.0, fov_axis: horizontal}
frames: 3
exposure_s: 0.006
readout_s: 0.024
samples: 32
noise_dn: 0.0
detectors: {aruco_subpix: {}, bart: {}}
trajectories:
  turn: {kind: pan, camera_m: [0.0, -0.8, 0.35], look_at_m: [0.0, 0.0, 0.3], pan_deg: 5.0}
  rest:
    kind: at_rest
    camera_m: [0.0, -0.8, 0.35]
    look_at_m: [0.0, 0.0, 0.3]
    occluder: {start_x_m: -0.21, y_m: -0.3, speed_m_s: 3.0, width_m: 0.1}
"""
RIG = """
boards:
  - {dictionary: DICT_5X5_1000, columns: 3, rows: 2, pitch_m: 0.16, centre_z_m: 0.3, code_m: 0.1, plate_m: 0.14}
"""


@pytest.fixture(scope="module")
def run(tmp_path_factory):
    """Return (experiment, folder of its results), rendered."""
    folder = tmp_path_factory.mktemp("moving")
    (folder / "config/moving").mkdir(parents=True)
    (folder / "config/rigs").mkdir()
    (folder / "config/rigs/rig.yaml").write_text(RIG)
    experiment = folder / "config/moving/tiny.yaml"
    experiment.write_text(FILE)
    trace_moving(experiment, folder / "truth.csv", folder / "markers.csv")
    for name in ("turn", "rest"):
        render(experiment, folder, name)
    return experiment, folder


def render(experiment, folder, name):
    """Render a trajectory; return the frames that were rendered now."""
    timing = folder / f"{name}_timing.csv"
    render_moving(experiment, name, folder / "render" / name, folder / "frames" / name, timing)
    return pd.read_csv(timing).frame.tolist()


def frames(folder, name):
    return [cv2.imread(str(path), cv2.IMREAD_UNCHANGED) for path in sorted((folder / "frames" / name).glob("*.png"))]


def test_corners_are_seen_where_the_truth_of_their_row_says(run):
    """Otherwise Blender's rolling shutter is another one than the truth's: here 14 px a frame, read over 0.7 frames."""
    experiment, folder = run
    moving = load_moving(experiment)
    truth = pd.read_csv(folder / "truth.csv").set_index(["trajectory", "frame", "id"])
    off = []
    for detection in make("bart").detect(frames(folder, "turn")[1]):
        row = truth.loc[("turn", 1, detection.id)]
        off.append(detection.corners - row[CORNERS].to_numpy(float).reshape(4, 2))
    assert len(off) >= 4
    off = np.array(off)
    assert np.abs(off.mean(axis=(0, 1))).max() < 0.03
    assert np.sqrt((off**2).sum(axis=2).mean()) < 0.15
    assert moving.file.readout_s > 0


def test_the_truth_of_a_global_shutter_would_be_wrong_here(run):
    """Otherwise the test above could not tell whether rows are read one after the other."""
    from moving.truth import trajectory_of

    experiment, folder = run
    moving = load_moving(experiment)
    pose = trajectory_of(moving, "turn")
    marker = next(moving.markers.itertuples())
    points = marker_corners_world(marker)
    rolling, still = (project_rolling(moving.K, pose, moving.times_s[1], points, 180, s) for s in (0.024, 0.0))
    assert np.abs(rolling - still).max() > 1.5


def test_what_the_occluder_covers_is_hidden_in_the_truth(run):
    """Otherwise hidden markers count as missed, or seen ones as hidden."""
    experiment, folder = run
    truth = pd.read_csv(folder / "truth.csv")
    truth = truth[(truth.trajectory == "rest") & truth.in_frame]
    images = frames(folder, "rest")
    assert (truth.hidden > 0.9).any() and (truth.hidden == 0).any()
    brightest = images[0].max()
    for row in truth.itertuples():
        corners = np.array([getattr(row, c) for c in CORNERS]).reshape(4, 2)
        mask = np.zeros(images[0].shape, np.uint8)
        cv2.fillConvexPoly(mask, np.rint(corners).astype(int), 1)
        white_within = (images[row.frame][mask > 0] > 0.95 * brightest).mean()
        if row.hidden > 0.99:
            assert white_within == 0
        if row.hidden == 0:
            assert white_within > 0.05


def test_a_frame_that_is_rendered_is_not_rendered_again(run):
    experiment, folder = run
    before = [image.copy() for image in frames(folder, "turn")]
    gone = sorted((folder / "render/turn").glob("*.npz"))[0]
    gone.unlink()
    assert len(render(experiment, folder, "turn")) == 1
    assert all(np.array_equal(a, b) for a, b in zip(before, frames(folder, "turn"), strict=True))
    assert render(experiment, folder, "turn") == []


def test_from_frames_to_tables_and_a_clip_that_can_be_watched(run):
    """The same tables byte for byte on a second run; a clip with every frame in it."""
    experiment, folder = run
    names = ["aruco_subpix", "bart"]
    tables = []
    for k in range(2):
        detections = {name: folder / f"{k}/{name}.csv" for name in names}
        timings = {name: folder / f"{k}/{name}_timing.csv" for name in names}
        for name in names:
            images = {t: folder / "frames" / t for t in ("turn", "rest")}
            detect_moving(experiment, name, images, detections[name], timings[name])
        out = folder / f"{k}/moving.csv"
        measure_moving(
            experiment, folder / "truth.csv", detections, timings, out, folder / "cells.csv", folder / "ms.csv"
        )
        tables.append(out.read_bytes())
    assert tables[0] == tables[1]
    measures = pd.read_csv(out).set_index(["detector", "trajectory"])
    assert (measures.false_ids == 0).all()
    assert measures.loc[("bart", "all"), "recall_pct"] > 95
    clip = folder / "clips/bart.webm"
    draw_moving(experiment, folder / "truth.csv", folder / "1/bart.csv", "bart", images, clip)
    watched = [image for _, image in read_frames(clip)]
    assert len(watched) == 6
    assert watched[0].shape == (360, 480, 3)
    assert (watched[0][..., 0].astype(int) - watched[0][..., 2] > 60).any()  # blue: seen
