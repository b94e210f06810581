"""The numbers behind the page to explore: places of captures, what was found of each marker, sums for the rig's map.

Everything here is plain lists for JSON, rounded to what a page shows. ``as_js`` writes them as JavaScript, as a page that
is opened from a folder may run scripts but fetch nothing.
"""

import json

import numpy as np

from job import clean
from rig.geometry import camera_matrix, invert_pose

TWINS = {"configured": 0, "explained": 1, "ideal": 0}  # in plates and in cells: before, after
MAX_TILTS, TILT_STEP_DEG = 9, 10  # nominal tilts that are told one by one; else bins of so many degrees
MAX_BINS = 8
WIDTHS_M = (0.05, 0.1, 0.2, 0.25, 0.5, 1, 2, 5, 10, 20, 50, 100)
BORDER_POINTS = 12  # of each side of a frame, to see where it meets the ground
MAX_DISTANCE_M = 40.0  # metres: ground beyond is not drawn
CORNER_NAMES = [f"corner_{axis}{k}" for k in range(4) for axis in "xy"]


def as_js(name, value):
    """Return the JavaScript that hands the page a value under a name; no text in it can end its script element."""
    text = json.dumps(clean(value), ensure_ascii=True, separators=(",", ":"), sort_keys=True)
    for sign in "<>&":
        text = text.replace(sign, f"\\u{ord(sign):04x}")
    return f"explorer.take({json.dumps(name)},{text});\n"


def rounded(values, digits):
    """Return an array as nested lists, rounded; None where it is not finite."""
    return clean(np.round(np.asarray(values, float), digits).tolist())


def bins_of(values, widths=WIDTHS_M, most=MAX_BINS):
    """Return rising edges, of a round width, that hold all finite values in at most ``most`` bins; [0, 1] without any."""
    values = np.asarray(values, float)
    values = values[np.isfinite(values)]
    if not len(values):
        return [0.0, 1.0]
    for width in widths:
        first, last = int(np.floor(values.min() / width)), int(np.floor(values.max() / width))
        if last - first < most:
            break
    return [round(k * width, 6) for k in range(first, last + 2)]


def bin_index(values, edges):
    """Return the bin (n,) of each value, -1 where it is not finite."""
    values = np.asarray(values, float)
    index = np.clip(np.digitize(values, edges) - 1, 0, len(edges) - 2)
    return np.where(np.isfinite(values), index, -1)


def tilt_bins(tilts):
    """Return (labels, bin of each tilt): the tilts themselves where there are few, else bins of 10 degrees; -1: unknown."""
    tilts = np.asarray(tilts, float)
    known = np.unique(np.round(tilts[np.isfinite(tilts)], 3))
    if len(known) <= MAX_TILTS:
        index = np.searchsorted(known, np.round(np.nan_to_num(tilts), 3)) if len(known) else np.zeros(len(tilts), int)
        return [f"{t:g}°" for t in known], np.where(np.isfinite(tilts), index, -1).tolist()
    step = TILT_STEP_DEG * np.floor(tilts / TILT_STEP_DEG)
    starts = np.unique(step[np.isfinite(step)])
    index = np.where(np.isfinite(step), np.searchsorted(starts, np.nan_to_num(step)), -1)
    return [f"{s:g}° to {s + TILT_STEP_DEG:g}°" for s in starts], index.tolist()


def place_of(K, width, height, T_cam_world):
    """Return a dict of where a camera stands and looks: ``at`` (x, y, z), ``axis`` (x, y), ``ground`` (n, 2) corners
    of what it sees of the plane z = 0; None where the pose is unknown.
    """
    if T_cam_world is None or not np.isfinite(T_cam_world).all():
        return None
    eye = invert_pose(T_cam_world)
    t = np.linspace(0, 1, BORDER_POINTS, endpoint=False)
    around = [(t, 0 * t), (1 + 0 * t, t), (1 - t, 1 + 0 * t), (0 * t, 1 - t)]
    xy = np.concatenate([np.stack([a * width - 0.5, b * height - 0.5], 1) for a, b in around])
    rays = np.column_stack([xy, np.ones(len(xy))]) @ np.linalg.inv(K).T @ eye[:3, :3].T
    with np.errstate(divide="ignore", invalid="ignore"):
        s = -eye[2, 3] / rays[:, 2]
    hit = (s > 0) & (s * np.linalg.norm(rays, axis=1) < MAX_DISTANCE_M)
    ground = eye[:2, 3] + s[hit, None] * rays[hit, :2]
    return {"at": rounded(eye[:3, 3], 4), "axis": rounded(eye[:2, 2], 4), "ground": rounded(ground, 3)}


def height_and_tilt(T_cam_world):
    """Return (height in metres over the plane, degrees below the horizontal) of a camera."""
    eye = invert_pose(T_cam_world)
    return float(eye[2, 3]), float(np.degrees(np.arcsin(np.clip(-eye[2, 2], -1, 1))))


def plate_sums(plates, captures, edges, marker_of):
    """Return rows [twin, tilt, bin, marker, n, sum of squared corner gaps (px²), sum of |white's gap| (DN)].

    plates    table of the diagnosis: a row a plate, capture and twin
    captures  DataFrame by capture with ``tilt_bin``
    marker_of {plate's name: number}
    """
    if "dx_px" not in plates:
        return []
    table = plates[plates.capture.isin(captures.index) & plates.plate.isin(marker_of)]
    keys = {
        "twin": table.twin.map(TWINS),
        "tilt": table.capture.map(captures.tilt_bin),
        "bin": bin_index(table.distance_m, edges),
        "marker": table.plate.map(marker_of),
    }
    values = {"n": 1, "px2": (table[CORNER_NAMES] ** 2).sum(axis=1) / 4, "white": table.white.abs()}
    return _sums(table, keys, values)


def cell_sums(cells, captures, edges, marker_of, detectors):
    """Return rows [twin, detector, tilt, bin, marker, n, n where one side alone found it, pairs, sum of |distance
    gap| (cm), sum of rotations (°)] over available cells; flips are in no sum.
    """
    if cells.empty:
        return []
    table = cells[cells.available & cells.capture.isin(captures.index)]
    pair = table.paired & ~table.flipped
    keys = {
        "twin": table.twin_is.map(TWINS),
        "detector": table.detector.map({d: k for k, d in enumerate(detectors)}),
        "tilt": table.capture.map(captures.tilt_bin),
        "bin": bin_index(table.range_m, edges),
        "marker": (table.dictionary + "/" + table.id.astype(str)).map(marker_of),
    }
    values = {
        "n": 1,
        "alone": table.real != table.twin,
        "pairs": pair,
        "cm": 100 * table.delta_distance_m.abs().where(pair, 0),
        "deg": table.rotation_deg.where(pair, 0),
    }
    return _sums(table, keys, values)


def _sums(table, keys, values):
    numbers = table[[]].assign(**keys, **values).groupby(list(keys)).sum()
    return [
        [*map(int, key), *(round(float(v), 4) for v in row)]
        for key, row in zip(numbers.index, numbers.to_numpy(), strict=True)
    ]


def cells_of_capture(cells, detections, detectors, marker_of):
    """Return {detector: {"real": {marker: corners (8)}, "before" and "after": {marker: [found in the photograph, found
    in the twin, distance in the photograph (m), distance in the twin (m), rotation (°), flipped]}}} of one capture.
    """
    out = {name: {"real": {}, "before": {}, "after": {}} for name in detectors}
    for row in cells.itertuples(index=False):
        marker = marker_of[f"{row.dictionary}/{row.id}"]
        numbers = rounded([row.distance_real_m, row.distance_twin_m], 4) + rounded([row.rotation_deg], 3)
        side = "before" if TWINS[row.twin_is] == 0 else "after"
        out[row.detector][side][marker] = [int(row.real), int(row.twin), *numbers, int(row.flipped)]
    for row in detections.itertuples(index=False):
        marker, mine = marker_of.get(f"{row.dictionary}/{row.id}"), out[row.detector]
        if mine["before"].get(marker, [0])[0]:  # else its place is wrong
            mine["real"][marker] = rounded([getattr(row, f"{axis}{k}") for k in range(4) for axis in "xy"], 2)
    return out


def intrinsics(record):
    """Return the 3 x 3 camera matrix of a register record (dict), None where it is unknown."""
    four = [record.get(k) for k in ("fx", "fy", "cx", "cy")]
    return None if None in four else camera_matrix(*four)
