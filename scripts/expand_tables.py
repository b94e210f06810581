"""Expand: a campaign's folder, or a designed experiment without photographs, to the same tables.

markers, cameras, stations (with T_cam_world), captures, and scene.json with the rest.
"""

import json
import math
from pathlib import Path

import numpy as np
import pandas as pd

import job
from rig import tables
from rig.campaign import load_campaign
from rig.experiment import load_experiment
from rig.geometry import split_pose, station_pose

POSE = tables.POSE


def station_name(row):
    """Return the station's name of a capture: its height and tilt, or the capture itself where it has no station."""
    if math.isnan(row.height_m):
        return row.capture
    return f"h{round(row.height_m * 1000):04d}_t{row.tilt_deg:g}".replace("-", "m").replace(".", "p")


def stations_of(captures):
    """Return the stations' table of a captures' table: one row a camera and place."""
    rows = {}
    for c in captures.itertuples():
        if not math.isnan(c.height_m):
            pose = np.concatenate(split_pose(station_pose(c.height_m, c.tilt_deg)))
        else:
            pose = [getattr(c, k) for k in POSE]
        rows[(c.camera, c.station)] = [c.camera, c.station, c.height_m, c.tilt_deg, *pose]
    return pd.DataFrame(list(rows.values()), columns=["camera", "station", "height_m", "tilt_deg", *POSE])


def cameras_of(cameras):
    """Return the cameras' table of a mapping of nominal cameras."""
    rows = [[name, c.width, c.height, c.fx, c.fy, c.cx, c.cy] for name, c in cameras.items()]
    return pd.DataFrame(rows, columns=["camera", "width", "height", "fx", "fy", "cx", "cy"]).astype(
        {k: float for k in ("fx", "fy", "cx", "cy")}
    )


def facts_of(file):
    """Return what scene.json holds: everything of campaign.yaml that is in no table."""
    return {
        "name": file.name,
        "origin": file.origin,
        "reflectance": file.reflectance.model_dump(),
        "exposure": file.exposure,
        "encoding": file.encoding,
        "noise_dn": file.noise_dn,
        "tolerance": file.tolerance.model_dump() if file.tolerance else None,
        "target": file.target.model_dump() if file.target else None,
        "markers_file": file.markers,
    }


def expand_tables(campaign, experiment, out):
    """Write the tables of a campaign's folder or, where that is None, of an experiment's file to the folder ``out``."""
    source = load_campaign(campaign) if campaign else load_experiment(experiment)
    captures = source.captures.copy()
    captures["station"] = [station_name(c) for c in captures.itertuples()]
    out = Path(out)
    tables.write_table(source.markers, out / "markers.csv", tables.MARKERS)
    tables.write_table(cameras_of(source.file.cameras), out / "cameras.csv", tables.CAMERAS)
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
        out=Path(snakemake.output.scene).parent,
    )
