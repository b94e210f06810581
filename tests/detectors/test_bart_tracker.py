"""BART on sequences: motion, occlusion, budget, flips, and frames that are not as they should be."""

import threading
import time

import cv2
import numpy as np
import pytest

from bench.marker_scenes import scene
from detectors.bart.filter import PoseFilter
from detectors.bart.tracker import Tracker
from detectors.contract import estimate_poses
from rig.geometry import camera_matrix, make_pose, project, transform
from rig.plates import marker_corners_plate

K = camera_matrix(700, 700, 319.5, 239.5)


def moving(frames, step=(3.0, 1.5), seed=1, markers=4):
    """Return grey frames of a scene that slides by ``step`` pixels a frame, and the first frame's truth."""
    image, truth = scene(np.random.default_rng(seed), 640, 480, markers, (50, 60), (0, 30), pieces=20)
    slide = [np.array([[1, 0, step[0] * k], [0, 1, step[1] * k]]) for k in range(frames)]
    return [cv2.warpAffine(image, m, (640, 480), borderMode=cv2.BORDER_REPLICATE) for m in slide], truth


@pytest.mark.parametrize("parameters", [{}, {"asynchronous": True}, {"regions": False}])
def test_moving_markers_are_seen_in_every_frame_where_they_are(parameters):
    frames, truth = moving(15)
    tracker = Tracker(**parameters)
    for k, image in enumerate(frames):
        markers = tracker.update(image).markers
        assert {(m.dictionary, m.id) for m in markers if m.seen} == {(t.dictionary, t.id) for t in truth}
        where = {(m.dictionary, m.id): m.corners for m in markers}
        for t in truth:
            assert np.abs(where[t.dictionary, t.id] - t.corners - np.array([3.0, 1.5]) * k).max() < 0.5


def test_an_occlusion_of_ten_frames_is_bridged_and_said():
    frames, truth = moving(26, step=(2.0, 0.0))
    hidden = truth[0]
    tracker = Tracker(K=K, code_m=0.05)
    for k, image in enumerate(frames):
        if 10 <= k < 20:
            centre = hidden.corners.mean(axis=0) + (2.0 * k, 0)
            cv2.circle(image, tuple(int(v) for v in centre), 50, 128, -1)
        markers = {(m.dictionary, m.id): m for m in tracker.update(image).markers}
        m = markers[hidden.dictionary, hidden.id]
        assert m.seen == (not 10 <= k < 20)
        assert np.abs(m.corners.mean(axis=0) - hidden.corners.mean(axis=0) - (2.0 * k, 0)).max() < 8
    gone = np.full_like(frames[0], 128)
    for _ in range(17):
        left = tracker.update(gone).markers
    assert left == []


def test_without_bridging_only_what_is_seen_is_reported():
    frames, _ = moving(3)
    tracker = Tracker(bridge_frames=0)
    tracker.update(frames[0])
    assert tracker.update(np.full_like(frames[0], 128)).markers == []


def test_a_budget_of_zero_gives_nothing_and_says_so():
    frames, _ = moving(3)
    for image in frames:
        result = Tracker(budget_ms=0).update(image)
        assert result.partial and result.markers == []


def test_frames_of_another_size_start_anew_and_disorder_is_an_error():
    frames, truth = moving(2)
    tracker = Tracker()
    assert len(tracker.update(frames[0], 0.0).markers) == len(truth)
    small = frames[0][::2, ::2]
    assert all(m.seen for m in tracker.update(small, 0.1).markers)
    for bad in (0.1, 0.05, float("nan")):
        with pytest.raises(ValueError, match="order"):
            tracker.update(small, bad)
    with pytest.raises(ValueError, match="image"):
        tracker.update(np.zeros((0, 0), np.uint8), 1.0)
    with pytest.raises(ValueError, match="unknown"):
        Tracker(budget=3)
    with pytest.raises(ValueError, match="budget_ms"):
        Tracker(budget_ms=-1.0)


def test_two_trackers_in_two_threads_do_not_touch_each_other():
    sequences = [moving(8, seed=s) for s in (1, 2)]
    results = {}

    def follow(k):
        tracker = Tracker()
        results[k] = [sorted(m.id for m in tracker.update(f).markers) for f in sequences[k][0]]

    threads = [threading.Thread(target=follow, args=(k,)) for k in range(2)]
    for t in threads:
        t.start()
    for t in threads:
        t.join()
    for k in range(2):
        assert results[k] == [sorted(t.id for t in sequences[k][1])] * 8


def seen_poses(T, rng, noise_px):
    corners = project(K, np.eye(4), transform(T, marker_corners_plate(0.05)))
    return estimate_poses(corners + rng.normal(0, noise_px, (4, 2)), 0.05, K)


def test_the_filter_calms_a_resting_marker_to_two_thirds():
    rng = np.random.default_rng(0)
    T = make_pose([2.4, 0.4, 0.2], [0.02, 0.01, 0.8])
    rest = PoseFilter(K, None, 0.05, 0.08, 0.1, 0.5)
    raw, calm = [], []
    for _ in range(150):
        poses = seen_poses(T, rng, 0.08)
        rest.predict(1 / 30)
        rest.update(poses)
        raw.append(poses[0][1])
        calm.append(rest.pose()[1])
    assert np.std(calm[50:], axis=0)[2] < 0.67 * np.std(raw[50:], axis=0)[2]
    assert abs(np.mean(calm[50:], axis=0)[2] - 0.8) < 0.002


def test_single_flips_do_not_turn_the_marker_over():
    """Far and nearly frontal, noise often makes the mirrored pose fit better in a single frame."""
    rng = np.random.default_rng(1)
    T = make_pose([np.pi - 0.35, 0, 0], [0.1, 0.05, 1.5])
    follower = PoseFilter(K, None, 0.05, 0.3, 3.0, 10.0)
    better, kept = [], []
    truth = make_pose([np.pi - 0.35, 0, 0], [0, 0, 0])[:3, :3]
    for k in range(200):
        poses = seen_poses(T, rng, 0.02 if k < 5 else 0.3)
        follower.predict(1 / 30)
        follower.update(poses)
        angles = [np.linalg.norm(cv2.Rodrigues(cv2.Rodrigues(p[0])[0] @ truth.T)[0]) for p in poses]
        better.append(angles[0] < 0.3)
        kept.append(np.linalg.norm(cv2.Rodrigues(follower.R @ truth.T)[0]) < 0.45)
    assert np.mean(better) < 0.95
    assert np.mean(kept) > np.mean(better) + 0.03


def test_the_filter_follows_a_sudden_move_at_once():
    """Calm at rest must not mean lag in motion: a marker that sets off is followed to a millimetre."""
    rng = np.random.default_rng(2)
    follower = PoseFilter(K, None, 0.05, 0.08, 0.1, 0.5)
    lag = []
    for k in range(60):
        x = 0.0 if k < 30 else 0.5 * (k - 29) / 30
        T = make_pose([2.4, 0.4, 0.2], [0.02 + x, 0.01, 0.8])
        follower.predict(1 / 30)
        follower.update(seen_poses(T, rng, 0.08))
        lag.append(abs(follower.pose()[1][0] - T[0, 3]))
    assert max(lag[30:]) < 0.002


@pytest.mark.parametrize("asynchronous", [False, True])
def test_a_search_that_a_budget_cuts_off_goes_on_and_finds_everything(asynchronous, monkeypatch):
    """Wrong if a search began anew at each frame (or its result was lost): far markers would never be found."""
    images, truth = moving(1, markers=6)
    tracker = Tracker(asynchronous=asynchronous, budget_ms=1000.0)
    steps = []

    def two_steps(start):
        steps.append(1)
        return 1.0 if len(steps) % 3 else 0.0

    if not asynchronous:
        monkeypatch.setattr(tracker, "_left", two_steps)  # a budget that ends after two looks at the clock
    frames = []
    for _ in range(60):
        frames.append(tracker.update(images[0]))
        if asynchronous:
            time.sleep(0.02)
    assert asynchronous or any(frame.partial for frame in frames)
    seen = {(m.dictionary, m.id) for frame in frames for m in frame.markers if m.seen}
    assert seen == {(m.dictionary, m.id) for m in truth}


def test_markers_take_turns_where_the_budget_is_too_small_for_all(monkeypatch):
    """Wrong if the first in the list were always looked for first: the last would be lost, though in plain sight."""
    images, truth = moving(1, markers=6)
    tracker = Tracker(full_every=10**6, search_after_sides=None)
    tracker.update(images[0])
    looks = []

    def for_two(start):
        looks.append(1)
        return 1.0 if len(looks) <= 3 else 0.0  # the batch, two markers

    monkeypatch.setattr(tracker, "_left", for_two)
    counts = dict.fromkeys([(m.dictionary, m.id) for m in truth], 0)
    for _ in range(9):
        looks.clear()
        for m in tracker.update(images[0]).markers:
            counts[m.dictionary, m.id] += m.seen
    assert set(counts.values()) == {3}
