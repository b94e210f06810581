"""Expand: a campaign's folder, or a designed experiment without photographs, to the same tables.

markers, cameras, stations (with T_cam_world), captures, and scene.json with the rest.
"""

import json
import math
from pathlib import Path

import numpy as np
import pandas as pd

import job
from inputs import tables
from inputs.campaign import load_campaign
from inputs.experiment import load_experiment
from rig.errors import InputError
from rig.geometry import place_name, split_pose, station_pose

POSE = tables.POSE


def station_names(captures):
    """Return the station of each capture: its height and tilt; where it has none, the first capture with its pose."""
    first, names = {}, []
    for c in captures.itertuples():
        if not math.isnan(c.height_m):
            names.append(place_name(c.height_m, c.tilt_deg))
        elif math.isnan(c.rx):
            names.append(c.capture)  # an unknown pose is shared with nobody
        else:
            pose = (c.camera, *(getattr(c, k) for k in POSE))
            names.append(first.setdefault(pose, c.capture))
    return names


def stations_of(captures):
    """Return the stations' table of a captures' table: one row a camera and place."""
    rows = {}
    for c in captures.itertuples():
        if not math.isnan(c.height_m):
            pose = np.concatenate(split_pose(station_pose(c.height_m, c.tilt_deg)))
        else:
            pose = [getattr(c, k) for k in POSE]
        row = [c.camera, c.station, c.height_m, c.tilt_deg, *pose]
        known = rows.setdefault((c.camera, c.station), row)
        if not np.allclose(known[2:], row[2:], rtol=0, atol=1e-6, equal_nan=True):
            raise InputError(f"capture {c.capture!r} has the name of a station elsewhere: rename it")
    return pd.DataFrame(list(rows.values()), columns=["camera", "station", "height_m", "tilt_deg", *POSE])


def cameras_of(cameras):
    """Return the cameras' table of a mapping of nominal cameras."""
    rows = [[name, c.width, c.height, c.fx, c.fy, c.cx, c.cy] for name, c in cameras.items()]
    return pd.DataFrame(rows, columns=["camera", "width", "height", "fx", "fy", "cx", "cy"]).astype(
        {k: float for k in ("fx", "fy", "cx", "cy")}
    )


def facts_of(file):
    """Return what scene.json holds: everything of campaign.yaml that is in no table.

    What ``left_open`` names is what the ideal twin assumes, as nobody has declared it.
    """
    return {
        "name": file.name,
        "origin": file.origin,
        "left_open": list(file.left_open),
        "light": file.assumed("light"),
        "exposure": file.assumed("exposure"),
        "white_balance": file.assumed("white_balance"),
        "reflectance": file.assumed("reflectance").model_dump(),
        "encoding": file.encoding,
        "noise_dn": file.noise_dn,
        "tolerance": file.tolerance.model_dump() if file.tolerance else None,
        "target": file.target.model_dump() if file.target else None,
        "markers_file": file.markers,
    }


def expand_tables(campaign, experiment, camera, out):
    """Write the tables of a campaign's folder or, where that is None, of an experiment's file to the folder ``out``.

    camera None lays out all cameras, a name that one.
    """
    source = load_campaign(campaign) if campaign else load_experiment(experiment)
    captures, cameras = source.captures.copy(), source.file.cameras
    if camera:
        captures, cameras = captures[captures.camera == camera], {camera: cameras[camera]}
    captures["station"] = station_names(captures)
    out = Path(out)
    tables.write_table(source.markers, out / "markers.csv", tables.MARKERS)
    tables.write_table(cameras_of(cameras), out / "cameras.csv", tables.CAMERAS)
    tables.write_table(stations_of(captures), out / "stations.csv", tables.STATIONS)
    if not campaign:
        captures = captures.iloc[:0]
    captures = captures.assign(frame=captures.frame.astype("Int64"))
    tables.write_table(
        captures[["capture", "camera", "station", "trial", "image", "sequence", "frame", "t_s"]],
        out / "captures.csv",
        tables.CAPTURES,
    )
    with job.write_atomically(out / "scene.json") as file:
        json.dump(facts_of(source.file), file, indent=1, sort_keys=True)


if __name__ == "__main__":
    job.run(
        expand_tables,
        snakemake,
        campaign=snakemake.params.campaign,
        experiment=snakemake.params.experiment,
        camera=snakemake.params.camera,
        out=Path(snakemake.output.scene).parent,
    )
