"""Measures on made-up reports whose answers are known."""

import numpy as np
import pandas as pd
import pytest
from scipy.spatial.transform import Rotation

from moving.metrics import dropouts, first_seen_frames, jitter_at_rest, match_reports, occlusions, summary
from moving.truth import CORNERS, POSE, TRUTH

SQUARE = np.array([[0, 0], [40, 0], [40, 40], [0, 40]], float)
FRAMES = 20
HIDDEN = range(8, 12)


def truth():
    """Return a marker at rest (id 1) that is hidden in frames 8 to 11."""
    rows = [
        ["a", k, k / 30, "D", 1, *(SQUARE + 100).ravel(), 3.0, 0, 0, 0, 0, 1.0, 40.0, 0.0, True, 0.5 * (k in HIDDEN)]
        for k in range(FRAMES)
    ]
    return pd.DataFrame(rows, columns=list(TRUTH.columns))


def reports(frames, shift=(0.0, 0.0), seen=True, marker=1):
    rows = [["a", k, "D", marker, seen, *(SQUARE + 100 + shift).ravel(), 3.0, 0, 0, 0, 0, 1.0] for k in frames]
    return pd.DataFrame(rows, columns=["trajectory", "frame", "dictionary", "id", "seen", *CORNERS, *POSE])


def measured(*parts):
    cells, false = match_reports(truth(), pd.concat(parts))
    return summary(cells, false, 30.0, ["a"])


def test_all_seen_is_a_recall_of_a_hundred_and_no_error():
    done = measured(reports(range(FRAMES)))
    assert (done["recall_pct"], done["false_ids"], done["corner_rms_px"], done["hidden_frames_lost"]) == (100, 0, 0, 0)


def test_hidden_frames_do_not_count_against_recall_but_are_lost_unless_bridged():
    clear = [k for k in range(FRAMES) if k not in HIDDEN]
    done = measured(reports(clear))
    assert (done["recall_pct"], done["hidden_frames"], done["hidden_frames_lost"]) == (100, 4, 4)
    done = measured(reports(clear), reports(HIDDEN, (3, 0), seen=False))
    assert (done["hidden_frames_lost"], done["false_ids"], done["bridged_corner_median_px"]) == (0, 0, 3)


def test_what_is_bridged_at_a_wrong_place_is_lost_all_the_same():
    """Otherwise a tracker that lets markers drift away would have bridged an occlusion."""
    clear = [k for k in range(FRAMES) if k not in HIDDEN]
    assert measured(reports(clear), reports(HIDDEN, (15, 0), seen=False))["hidden_frames_lost"] == 4


@pytest.mark.parametrize("wrong", [reports([3], marker=2), reports([3], (30, 0)), reports([3], (1, 0))])
def test_ids_that_are_not_there_are_false(wrong):
    """Another id, the right id elsewhere, the right id a second time."""
    done = measured(reports(range(FRAMES)), wrong)
    assert (done["false_ids"], done["recall_pct"], done["corner_rms_px"]) == (1, 100, 0)


def test_waiting_dropouts_and_recovery_are_counted_in_frames():
    cells, _ = match_reports(truth(), reports([2, 3, 4, 6, 7, 14, 15, 16, 17, 18, 19]))
    assert first_seen_frames(cells).tolist() == [2.0]
    assert dropouts(cells) == (3, 0)  # 5, 12, 13
    row = occlusions(cells).iloc[0]
    assert (row.hidden, row.lost, row.recovery) == (4, 4, 2)


def test_jitter_is_the_standard_deviation_that_went_in():
    rng = np.random.default_rng(1)
    long = pd.concat([truth().assign(frame=truth().frame + FRAMES * k) for k in range(50)])
    mine = pd.concat([reports(range(FRAMES)).assign(frame=lambda t, k=k: t.frame + FRAMES * k) for k in range(50)])
    turns = Rotation.from_rotvec(mine[POSE[:3]]) * Rotation.from_rotvec(rng.normal(0, 0.01, (len(mine), 3)))
    mine[POSE[:3]] = turns.as_rotvec()
    mine[POSE[3:]] += rng.normal(0, [1e-3, 2e-3, 2e-3], (len(mine), 3))
    mm, deg = jitter_at_rest(match_reports(long, mine)[0])
    assert mm == pytest.approx(3.0, rel=0.05)
    assert deg == pytest.approx(np.degrees(0.01 * np.sqrt(3)), rel=0.05)


def test_no_report_at_all_is_measured_too():
    done = measured(reports([]))
    assert (done["recall_pct"], done["never_seen"]) == (0, 1)
    assert np.isnan(done["corner_rms_px"])
