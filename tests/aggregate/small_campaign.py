"""A hand-made campaign as tables: one camera looks straight down on four markers, detections by hand.

At 1 m height a marker of 0.1 m is 50 px wide. Markers 0 to 2 are in the picture, 3 is cut by its right edge.
"""

import json

import numpy as np
import pandas as pd

from inputs.tables import DETECTIONS, REGISTERED
from markers.contract import marker_corners_world
from rig.geometry import camera_matrix, make_pose, project, split_pose, station_pose

HEIGHT_M, TILT_DEG, FOCAL_PX, SIZE = 1.0, 90.0, 500.0, (400, 300)
K = camera_matrix(FOCAL_PX, FOCAL_PX, 199.5, 149.5)
X_M = [-0.2, 0.0, 0.2, 0.37]
POSE = ["rx", "ry", "rz", "tx", "ty", "tz"]


def markers():
    rows = [["DICT_5X5_1000", k, 0.1, 0.14, x, 0.0, 0.0, 0.0, 0.0, 0.0] for k, x in enumerate(X_M)]
    names = ["dictionary", "id", "code_m", "plate_m", "x", "y", "z", "rx", "ry", "rz"]
    return pd.DataFrame(rows, columns=names)


def detection(source, capture, marker_id, shift_px=0.0, farther_m=0.0, as_id=None, turned_deg=0.0):
    """Return a row: the marker moved by ``shift_px`` in x, its pose farther away and turned about x.

    The second solution is turned the other way.
    """
    T_cam_world = station_pose(HEIGHT_M, TILT_DEG)
    marker = markers().iloc[marker_id]
    corners = project(K, T_cam_world, marker_corners_world(marker))
    corners[:, 0] += shift_px
    poses = []
    for turn in (turned_deg, -turned_deg):
        T_world_marker = make_pose(np.radians([turn, 0, 0]), [marker.x, marker.y, marker.z])
        rvec, tvec = split_pose(T_cam_world @ T_world_marker)
        poses.append([*rvec, *tvec * (1 + farther_m / np.linalg.norm(tvec))])
    name = marker_id if as_id is None else as_id
    return [source, capture, "DICT_5X5_1000", name, *corners.ravel(), *poses[0], 0.1, *poses[1], 0.2]


def write(folder, detections, captures=("a", "b"), the_markers=None, register=True):
    """Write the campaign's tables under ``folder``; return the arguments of ``aggregate_detections``."""
    names = ("markers", "cameras", "stations", "captures")
    tables = {name: folder / f"{name}.csv" for name in names}
    (markers() if the_markers is None else the_markers).to_csv(tables["markers"], index=False)
    pd.DataFrame(
        [["top", *SIZE, FOCAL_PX, FOCAL_PX, K[0, 2], K[1, 2]]],
        columns=["camera", "width", "height", "fx", "fy", "cx", "cy"],
    ).to_csv(tables["cameras"], index=False)
    pose = np.concatenate(split_pose(station_pose(HEIGHT_M, TILT_DEG)))
    pd.DataFrame(
        [["top", "h1", HEIGHT_M, TILT_DEG, *pose]],
        columns=["camera", "station", "height_m", "tilt_deg", *POSE],
    ).to_csv(tables["stations"], index=False)
    pd.DataFrame(
        [[c, "top", "h1", k, f"{c}.png", None, None, None] for k, c in enumerate(captures)],
        columns=["capture", "camera", "station", "trial", "image", "sequence", "frame", "t_s"],
    ).to_csv(tables["captures"], index=False)
    registers, register_jsons = [], []
    if register:
        registers, register_jsons = [folder / "register/top.csv"], [folder / "register/top.json"]
        registers[0].parent.mkdir(exist_ok=True)
        rows = [[c, "h1", k, "registered", "", 3, 0.1, *pose, *np.zeros(6)] for k, c in enumerate(captures)]
        pd.DataFrame(rows, columns=list(REGISTERED.columns)).to_csv(registers[0], index=False)
        register_jsons[0].write_text(json.dumps({"fx": FOCAL_PX, "fy": FOCAL_PX, "cx": K[0, 2], "cy": K[1, 2]}))
    found = folder / "detect/top/aruco.csv"
    found.parent.mkdir(parents=True, exist_ok=True)
    pd.DataFrame(detections, columns=list(DETECTIONS.columns)).to_csv(found, index=False)
    return {
        "tables": tables,
        "detections": [found],
        "registers": registers,
        "register_jsons": register_jsons,
        "cells_file": folder / "cells.parquet",
        "false_ids_file": folder / "false_ids.parquet",
    }


def write_tables(folder, arguments, origin="camera", reference="aruco"):
    """Run both steps; return (cells, false ids, table 1, table 2) as read back."""
    from aggregate_detections import aggregate_detections
    from make_tables import make_tables

    aggregate_detections(**arguments)
    (folder / "scene.json").write_text(json.dumps({"name": "small", "origin": origin}))
    files = {f"{t}.{s}": folder / f"{t}.{s}" for t in ("table1", "table2") for s in ("csv", "md", "tex")}
    files["headlines.json"] = folder / "headlines.json"
    make_tables(arguments["cells_file"], arguments["false_ids_file"], folder / "scene.json", reference, files)
    return (
        pd.read_parquet(arguments["cells_file"]),
        pd.read_parquet(arguments["false_ids_file"]),
        pd.read_csv(files["table1.csv"]),
        pd.read_csv(files["table2.csv"]),
    )
