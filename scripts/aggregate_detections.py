"""From detections to cells: per camera, detector, capture and marker, what was found and how poses differ.

A detection counts only with the right id and its centre within half a marker of the truth; any other is a
false id.
"""

import functools
import json
import logging
from pathlib import Path

import numpy as np
import pandas as pd
import pyarrow as pa
import pyarrow.parquet as pq

import job
from inputs.tables import CAMERAS, CAPTURES, DETECTIONS, MARKERS, REGISTERED, STATIONS, read_table
from markers.contract import marker_corners_world
from reporting.metrics import is_flipped, relative_rotvec_deg
from rig.geometry import camera_matrix, make_pose, project, station_pose, transform

log = logging.getLogger("twingap")

SCHEMAS = {"markers": MARKERS, "cameras": CAMERAS, "stations": STATIONS, "captures": CAPTURES}
POSE = ["rx", "ry", "rz", "tx", "ty", "tz"]
INTRINSICS = ["fx", "fy", "cx", "cy"]
CORNERS = ["x0", "y0", "x1", "y1", "x2", "y2", "x3", "y3"]
MARKER = ["dictionary", "id"]
PAIRED = ["distance_real_m", "distance_twin_m", "delta_distance_m", "rotation_deg", "rotation_x_deg"]
PAIRED += ["rotation_y_deg", "rotation_z_deg"]

CELL_TYPES = (
    {name: pa.string() for name in ("camera", "detector", "capture", "station")}
    | {"trial": pa.int64(), "height_m": pa.float64(), "tilt_deg": pa.float64(), "has_real": pa.bool_()}
    | {"dictionary": pa.string(), "id": pa.int64(), "range_m": pa.float64()}
    | {"side_px": pa.float64(), "available": pa.bool_(), "real": pa.bool_(), "twin": pa.bool_()}
    | {"paired": pa.bool_(), "flipped": pa.bool_()}
    | {name: pa.float64() for name in PAIRED}
)
FALSE_ID_TYPES = {
    "camera": pa.string(),
    "detector": pa.string(),
    "source": pa.string(),
    "capture": pa.string(),
    "dictionary": pa.string(),
    "id": pa.int64(),
    "x": pa.float64(),
    "y": pa.float64(),
}


def shots_of(camera, captures, stations, register):
    """Return a dict a capture: names, station, ``T_registered`` and ``T_nominal`` (4 x 4 or None).

    Without photographs the stations themselves are the twin's captures.
    """
    stations = stations[stations.camera == camera].set_index("station")
    mine = captures[captures.camera == camera]
    if mine.empty:
        mine = pd.DataFrame({"capture": stations.index, "station": stations.index, "trial": 0})
    registered = register.set_index("capture") if register is not None else pd.DataFrame(columns=POSE)
    rows = []
    for shot in mine.itertuples():
        nominal = _pose(stations.loc[shot.station]) if shot.station in stations.index else None
        found = _pose(registered.loc[shot.capture]) if shot.capture in registered.index else None
        place = stations.loc[shot.station] if shot.station in stations.index else {}
        rows.append(
            {
                "capture": shot.capture,
                "station": shot.station,
                "trial": int(shot.trial),
                "height_m": float(place.get("height_m", np.nan)),
                "tilt_deg": float(place.get("tilt_deg", np.nan)),
                "T_registered": found if found is not None else nominal,
                "T_nominal": nominal,
            }
        )
    return rows


def _pose(row):
    values = np.array([row[name] for name in POSE], float)
    if np.isfinite(values).all():
        return make_pose(values[:3], values[3:])
    place = [float(row.get(name, np.nan)) for name in ("height_m", "tilt_deg")]
    return station_pose(*place) if np.isfinite(place).all() else None


def predicted_markers(markers, K, width, height, T_cam_world, lens=None):
    """Return where n markers appear: ``centre`` (n, 2), and ``side_px``, ``range_m``, ``available`` (n,).

    Available: all four code corners in front of the camera and inside the frame, whose pixels span -0.5 to
    size - 0.5. The side is the mean of the four, in pixels. ``lens`` is a function of the pixels (m, 2) of a pinhole to
    those where its light lands; None: a pinhole.
    """
    world = np.stack([marker_corners_world(m) for m in markers.itertuples()])
    corners = project(K, T_cam_world, world)
    centres_world = world.mean(axis=1)
    centre = project(K, T_cam_world, centres_world)
    if lens is not None:
        corners, centre = lens(corners.reshape(-1, 2)).reshape(corners.shape), lens(centre)
    inside = (corners > -0.5) & (corners < np.array([width, height]) - 0.5)
    edges = corners - np.roll(corners, 1, axis=1)
    return {
        "centre": centre,
        "side_px": np.linalg.norm(edges, axis=2).mean(axis=1),
        "range_m": np.linalg.norm(transform(T_cam_world, centres_world), axis=1),
        "available": inside.all(axis=(1, 2)),
    }


def lens_of(K, width, height, shot, effects):
    """Return the ``lens`` of ``predicted_markers`` that effects [(name, parameters)] make in a shot; None without any."""
    if not effects:
        return None
    from effects import pipeline  # only here: campaigns of photographs do without
    from effects.base import View

    view = View(K, int(width), int(height), 0, shot["T_registered"], "", shot["capture"], shot["station"])
    return functools.partial(pipeline.map_points, view=view, chosen=effects)


def centres_of(detections):
    """Return the centres (n, 2) of detections: where the diagonals cross, which perspective keeps."""
    c = detections[CORNERS].to_numpy(float).reshape(-1, 4, 2)
    a, b = c[:, 2] - c[:, 0], c[:, 3] - c[:, 1]
    d = c[:, 1] - c[:, 0]
    cross = a[:, 0] * b[:, 1] - a[:, 1] * b[:, 0]
    with np.errstate(invalid="ignore", divide="ignore"):
        s = (d[:, 0] * b[:, 1] - d[:, 1] * b[:, 0]) / cross
    crossing = c[:, 0] + s[:, None] * a
    return np.where(((s > 0) & (s < 1))[:, None], crossing, c.mean(axis=1))


def match_detections(detections, markers, places):
    """Return (row of the detection per marker or -1, bool per detection: false id).

    places  predictions (of predicted_markers) of which one has to be met: a twin stands at its station
            or, where that is unknown or its camera is mounted off it, where the photograph was registered
    """
    row_of = dict(zip(markers[MARKER].itertuples(index=False, name=None), range(len(markers)), strict=True))
    found, nearest = np.full(len(markers), -1), np.full(len(markers), np.inf)
    false = np.ones(len(detections), bool)
    centres = centres_of(detections)
    for k, key in enumerate(detections[MARKER].itertuples(index=False, name=None)):
        m = row_of.get(key)
        if m is None:
            continue
        # In half markers, so that the nearest of two places is the more plausible.
        offset = np.nanmin(
            [np.linalg.norm(centres[k] - p["centre"][m]) / (p["side_px"][m] / 2) for p in places] + [np.inf]
        )
        if offset <= 1:
            false[k] = False
            if offset < nearest[m]:
                nearest[m], found[m] = offset, k
    return found, false


def compare_poses(real, twin):
    """Return arrays of the columns PAIRED and ``flipped`` for detections (n rows) of the same markers."""
    rvec = [side[["rx", "ry", "rz"]].to_numpy(float) for side in (real, twin)]
    alt = [side[["rx_alt", "ry_alt", "rz_alt"]].to_numpy(float) for side in (real, twin)]
    distance = [np.linalg.norm(side[["tx", "ty", "tz"]].to_numpy(float), axis=1) for side in (real, twin)]
    relative = relative_rotvec_deg(*rvec) if len(real) else np.empty((0, 3))
    return {
        "distance_real_m": distance[0],
        "distance_twin_m": distance[1],
        "delta_distance_m": distance[0] - distance[1],
        "rotation_deg": np.linalg.norm(relative, axis=1),
        "rotation_x_deg": relative[:, 0],
        "rotation_y_deg": relative[:, 1],
        "rotation_z_deg": relative[:, 2],
        "flipped": is_flipped(rvec[0], alt[0], rvec[1], alt[1]) if len(real) else np.empty(0, bool),
    }


def unknown_cells(shot, markers, has_real):
    """Return the cells of a capture as long as nothing is known of its markers: not available, not found."""
    names = ("capture", "station", "trial", "height_m", "tilt_deg")
    nothing = dict.fromkeys(("available", "real", "twin", "paired", "flipped"), False)
    nothing |= dict.fromkeys(("range_m", "side_px", *PAIRED), np.nan)
    return markers[MARKER].assign(**{name: shot[name] for name in names}, has_real=has_real, **nothing)


def cells_of_capture(shot, detections, markers, K, width, height, has_real, effects=()):
    """Return (cells, false ids) of one capture: two DataFrames, without camera and detector.

    effects  [(name, parameters)] of the twin's lens, of which a designed experiment knows where they put the markers
    """
    lens = lens_of(K, width, height, shot, effects)
    registered = predicted_markers(markers, K, width, height, shot["T_registered"], lens)
    nominal = shot["T_nominal"] if shot["T_nominal"] is not None else shot["T_registered"]
    places = {
        "real": [registered],
        "twin": [registered, predicted_markers(markers, K, width, height, nominal, lens)],
    }
    by_source, found, wrong = {}, {}, []
    for source in ("real", "twin"):
        by_source[source] = detections[detections.source == source].reset_index(drop=True)
        found[source], false = match_detections(by_source[source], markers, places[source])
        centres = centres_of(by_source[source])
        wrong.append(by_source[source].assign(x=centres[:, 0], y=centres[:, 1])[false])
    cells = unknown_cells(shot, markers, has_real).assign(
        range_m=registered["range_m"],
        side_px=registered["side_px"],
        available=registered["available"],
        real=found["real"] >= 0,
        twin=found["twin"] >= 0,
    )
    both = np.flatnonzero((found["real"] >= 0) & (found["twin"] >= 0))
    pairs = compare_poses(*(by_source[s].iloc[found[s][both]] for s in ("real", "twin")))
    measured = np.isfinite(pairs["rotation_deg"]) & np.isfinite(pairs["delta_distance_m"])
    cells.loc[both[measured], "paired"] = True
    for name in PAIRED:
        cells.loc[both, name] = pairs[name]
    cells.loc[both, "flipped"] = pairs["flipped"]
    return cells, pd.concat(wrong)[["source", "capture", *MARKER, "x", "y"]]


def aggregate_camera(camera, detector, detections, markers, captures, stations, frame, register, effects=()):
    """Return (cells, false ids) of one camera and detector.

    frame     dict with ``fx, fy, cx, cy, width, height`` of the ideal pinhole
    register  table of registered poses, or None without photographs
    effects   [(name, parameters)] of a designed camera's twin that move points
    """
    has_real = bool((captures.camera == camera).any())
    K = camera_matrix(*(frame[name] for name in INTRINSICS))
    cells, false_ids = [], []
    for shot in shots_of(camera, captures, stations, register):
        if shot["T_registered"] is None or not np.isfinite(K).all():
            log.warning("%s: pose or camera unknown, no marker counts as available", shot["capture"])
            cells.append(unknown_cells(shot, markers, has_real))
            continue
        mine = detections[detections.capture == shot["capture"]]
        c, f = cells_of_capture(shot, mine, markers, K, frame["width"], frame["height"], has_real, effects)
        cells.append(c)
        false_ids.append(f)
    names = {"camera": camera, "detector": detector}
    return [pd.concat(part).assign(**names) if part else pd.DataFrame() for part in (cells, false_ids)]


def frame_of(camera, cameras, register_json):
    """Return the ideal pinhole's ``fx, fy, cx, cy, width, height``: as registered, else as stated."""
    row = cameras.set_index("camera").loc[camera].to_dict()
    if register_json:
        registered = json.loads(Path(register_json).read_text())
        row |= {name: registered[name] for name in INTRINSICS if registered.get(name) is not None}
    return row


def write_parquet(table, types, path):
    """Write a DataFrame's columns of ``types`` (name to pyarrow type); the same bytes for the same rows."""
    table = table.reindex(columns=list(types))
    schema = pa.schema(list(types.items()))
    with job.write_atomically(path, "wb") as file:
        pq.write_table(pa.Table.from_pandas(table, schema=schema, preserve_index=False).replace_schema_metadata(), file)


def aggregate_detections(tables, detections, registers, register_jsons, cells_file, false_ids_file, effects=None):
    """Write the cells and the false ids of all cameras and detectors.

    tables          dict of paths: markers, cameras, stations, captures
    detections      paths ``.../CAMERA/DETECTOR.csv``
    registers, register_jsons  paths ``.../CAMERA.csv`` and ``.../CAMERA.json``, empty without photographs
    effects         {camera: [(name, parameters)]} of a designed experiment's twins; None of a campaign
    """
    markers, cameras, stations, captures = (read_table(tables[name], schema) for name, schema in SCHEMAS.items())
    register_of = {Path(path).stem: path for path in registers}
    json_of = {Path(path).stem: path for path in register_jsons}
    cells, false_ids = [], []
    if markers.empty:
        log.info("no markers in this campaign: no cells")
        detections = []
    for path in sorted(map(Path, detections)):
        camera, detector = path.parent.name, path.stem
        register = read_table(register_of[camera], REGISTERED) if camera in register_of else None
        frame = frame_of(camera, cameras, json_of.get(camera))
        found, chosen = read_table(path, DETECTIONS), [(n, p) for n, p in (effects or {}).get(camera, [])]
        c, f = aggregate_camera(camera, detector, found, markers, captures, stations, frame, register, chosen)
        cells.append(c)
        false_ids.append(f)
    order = ["camera", "detector", "capture", "dictionary", "id"]
    for parts, types, file in ((cells, CELL_TYPES, cells_file), (false_ids, FALSE_ID_TYPES, false_ids_file)):
        parts = [part for part in parts if len(part)]
        table = pd.concat(parts) if parts else pd.DataFrame(columns=list(types))
        table = table.sort_values([*order, *[n for n in ("source", "x", "y") if n in types]], kind="stable")
        write_parquet(table, types, file)


if __name__ == "__main__":
    job.run(
        aggregate_detections,
        snakemake,
        tables={name: snakemake.input[name] for name in ("markers", "cameras", "stations", "captures")},
        detections=snakemake.input.detections,
        registers=snakemake.input.get("register", []),
        register_jsons=snakemake.input.get("register_json", []),
        cells_file=snakemake.output.cells,
        false_ids_file=snakemake.output.false_ids,
        effects=snakemake.params.effects,
    )
