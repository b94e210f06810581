"""Measures of detectors on moving cameras, from truth and reports. Every one is defined in docs/moving.md."""

import numpy as np
import pandas as pd
from scipy.spatial.transform import Rotation

from moving.truth import CORNERS, POSE

MARKER = ["dictionary", "id"]
CELL = ["trajectory", "frame", *MARKER]
FALSE_SHARE = 0.5  # of a side: what is farther from the truth is another marker, or none
KEPT_SHARE = 0.25  # of a side: what is bridged (reported though unseen) and nearer than this is still of use
MIN_AT_REST = 0.5  # of the frames in which a marker must be seen for its jitter to count


def corner_error_px(reported, true):
    """Return the RMS distance (n,) between corners (n, 4, 2), pixels."""
    return np.sqrt(((reported - true) ** 2).sum(axis=2).mean(axis=1))


def pose_errors(reported, true):
    """Return (millimetres, degrees), each (n,), between poses (n, 6) as rx..tz; NaN where one is missing."""
    known = np.isfinite(reported).all(axis=1) & np.isfinite(true).all(axis=1)
    mm, deg = np.full(len(reported), np.nan), np.full(len(reported), np.nan)
    a, b = reported[known], true[known]
    mm[known] = 1000 * np.linalg.norm(a[:, 3:] - b[:, 3:], axis=1)
    turn = Rotation.from_rotvec(a[:, :3].reshape(-1, 3)).inv() * Rotation.from_rotvec(b[:, :3].reshape(-1, 3))
    deg[known] = np.degrees(turn.magnitude()) if len(a) else []
    return mm, deg


def match_reports(truth, reports):
    """Return (cells, false reports): the truth's rows with what was reported of each, and what is no marker there.

    Added columns: seen, reported (seen or bridged: extrapolated while unseen), kept (reported within KEPT_SHARE of a
    side), corner_px, translation_mm, rotation_deg, and the reported pose (rx_found...). A false report is one whose id
    is not in the rig or whose corners are more than FALSE_SHARE of a side off, or the second of one id in one frame;
    bridged markers are no false ids: far off they are only not kept.
    """
    found = reports.merge(truth, on=CELL, how="left", suffixes=("_found", ""), indicator=True)
    error = corner_error_px(
        found[[f"{c}_found" for c in CORNERS]].to_numpy(float).reshape(-1, 4, 2),
        found[CORNERS].to_numpy(float).reshape(-1, 4, 2),
    )
    found["corner_px"] = np.where(found["_merge"] == "both", error, np.inf)
    found["corner_px"] = found["corner_px"].fillna(np.inf)  # a marker behind the camera
    found = found.sort_values([*CELL, "corner_px"], kind="stable")
    false = found.seen & ((found.corner_px > FALSE_SHARE * found.side_px.fillna(0)) | found.duplicated(CELL))
    good = found[~false & np.isfinite(found.corner_px)].drop_duplicates(CELL)
    found_pose = [f"{c}_found" for c in POSE]
    cells = truth.merge(good[[*CELL, "seen", "corner_px", *found_pose]], on=CELL, how="left")
    cells["reported"] = cells.seen.notna()
    cells["seen"] = cells.seen.fillna(False).astype(bool)
    cells["kept"] = cells.reported & (cells.corner_px <= KEPT_SHARE * cells.side_px)
    cells["translation_mm"], cells["rotation_deg"] = pose_errors(
        cells[found_pose].to_numpy(float), cells[POSE].to_numpy(float)
    )
    return cells, found[false]


def jitter_at_rest(cells):
    """Return (millimetres, degrees) by which poses of a camera at rest scatter, median over markers.

    Of each marker: the root of the summed variances of its place, and the RMS angle from its mean rotation.
    """
    place, turn = [], []
    for _, marker in cells.groupby(MARKER):
        poses = marker[marker.seen][[f"{c}_found" for c in POSE]].dropna().to_numpy(float)
        if len(poses) < max(2, MIN_AT_REST * len(marker)):
            continue
        place.append(1000 * np.sqrt(poses[:, 3:].var(axis=0, ddof=1).sum()))
        turns = Rotation.from_rotvec(poses[:, :3])
        off = (turns.mean().inv() * turns).magnitude()
        turn.append(np.degrees(np.sqrt((off**2).sum() / (len(off) - 1))))
    return (float(np.median(place)), float(np.median(turn))) if place else (np.nan, np.nan)


def shake_mm(cells):
    """Return how much the error of a marker's place scatters over a trajectory, mm, median over trajectories and markers.

    What is drawn on a marker shakes by this, whether camera and marker move or not; a steady error is not counted.
    """
    scatter = []
    for _, marker in cells.groupby(["trajectory", *MARKER]):
        mine = marker[marker.seen & marker.in_frame]
        error = mine[[f"{c}_found" for c in POSE[3:]]].to_numpy(float) - mine[POSE[3:]].to_numpy(float)
        error = error[np.isfinite(error).all(axis=1)]
        if len(error) >= max(2, MIN_AT_REST * len(marker)):
            scatter.append(1000 * np.sqrt(error.var(axis=0, ddof=1).sum()))
    return _median(np.array(scatter))


def _runs(flags):
    """Return [(first, end), ...] of runs of True, end exclusive."""
    edges = np.flatnonzero(np.diff(np.concatenate([[0], np.asarray(flags, int), [0]])))
    return list(zip(edges[::2].tolist(), edges[1::2].tolist(), strict=True))


def first_seen_frames(cells):
    """Return for each marker that comes into view unhidden: frames until it is seen; NaN where it never is."""
    waits = []
    for _, marker in cells.groupby(["trajectory", *MARKER]):
        clear = (marker.in_frame & (marker.hidden == 0)).to_numpy()
        if clear.any():
            start = int(np.argmax(clear))
            seen = np.flatnonzero(marker.seen.to_numpy()[start:])
            waits.append(float(seen[0]) if len(seen) else np.nan)
    return np.array(waits)


def dropouts(cells):
    """Return (frames, of these kept) in which an unhidden marker in the frame is not seen between two that see it."""
    lost = kept = 0
    for _, marker in cells.groupby(["trajectory", *MARKER]):
        seen = np.flatnonzero(marker.seen)
        if len(seen):
            between = marker.iloc[seen[0] : seen[-1]]
            gap = between[between.in_frame & (between.hidden == 0) & ~between.seen]
            lost, kept = lost + len(gap), kept + int(gap.kept.sum())
    return lost, kept


def occlusions(cells):
    """Return a row for each time that a marker, seen before, is hidden: frames hidden, frames lost, frames to recover.

    A frame is lost if nothing is reported within KEPT_SHARE of a side. Recovery is counted from the first frame in which the
    marker is free again to the first in which it is seen (0: at once); NaN where the sequence ends before.
    """
    rows = []
    for name, marker in cells.groupby(["trajectory", *MARKER]):
        hidden = (marker.in_frame & (marker.hidden > 0)).to_numpy()
        seen = marker.seen.to_numpy()
        for first, end in _runs(hidden):
            if not seen[:first].any():
                continue
            again = np.flatnonzero(seen[end:])
            lost = int((~marker.kept.to_numpy()[first:end]).sum())
            rows.append([*name, end - first, lost, float(again[0]) if len(again) else np.nan])
    return pd.DataFrame(rows, columns=["trajectory", *MARKER, "hidden", "lost", "recovery"])


def summary(cells, false, fps, at_rest):
    """Return the measures (dict) of one detector on some trajectories; at_rest: names of those that do not move."""
    view = cells[cells.in_frame]
    clear = view[view.hidden == 0]
    good = clear[clear.seen]
    waits = first_seen_frames(cells)
    gaps, bridged = dropouts(cells)
    hidden = occlusions(cells)
    extrapolated = view[view.reported & ~view.seen]
    jitter = jitter_at_rest(cells[cells.trajectory.isin(at_rest)])
    return {
        "frames": int(cells[["trajectory", "frame"]].drop_duplicates().shape[0]),
        "markers": len(clear),
        "recall_pct": _percent(clear.seen),
        "with_bridged_pct": _percent(clear.kept),
        "false_ids": len(false),
        "corner_median_px": _median(good.corner_px),
        "corner_rms_px": float(np.sqrt((good.corner_px**2).mean())) if len(good) else np.nan,
        "translation_median_mm": _median(good.translation_mm),
        "rotation_median_deg": _median(good.rotation_deg),
        "jitter_mm": jitter[0],
        "jitter_deg": jitter[1],
        "shake_mm": shake_mm(cells),
        "first_seen_mean_ms": 1000 / fps * float(np.nanmean(waits)) if np.isfinite(waits).any() else np.nan,
        "never_seen": int(np.isnan(waits).sum()),
        "dropout_frames": gaps,
        "dropout_frames_bridged": bridged,
        "bridged_corner_median_px": _median(extrapolated.corner_px),
        "hidden_frames": int(hidden.hidden.sum()),
        "hidden_frames_lost": int(hidden.lost.sum()),
        "recovery_median_frames": _median(hidden.recovery),
        "recovery_most_frames": float(hidden.recovery.max()) if len(hidden) else np.nan,
    }


def latency(timing):
    """Return measures (dict) of a detector's TIMING rows: milliseconds a frame, without and with a budget."""
    free = timing[timing.budget_ms.isna()]
    held = timing[timing.budget_ms.notna()]
    over = (held.ms - held.budget_ms).to_numpy()
    return {
        "frames": len(free),
        "ms_median": _median(free.ms),
        "ms_p99": _quantile(free.ms, 0.99),
        "budget_ms": _median(held.budget_ms),
        "held_ms_p99": _quantile(held.ms, 0.99),
        "held_partial_pct": _percent(held.partial),
        "held_over_pct": _percent(over > 0) if len(held) else np.nan,
        "held_most_over_ms": float(max(over.max(), 0)) if len(held) else np.nan,
    }


def _median(values):
    return float(np.nanmedian(values)) if len(values) and np.isfinite(values).any() else np.nan


def _quantile(values, share):
    return float(np.quantile(values, share)) if len(values) else np.nan


def _percent(flags):
    return 100 * float(np.mean(flags)) if len(flags) else np.nan
