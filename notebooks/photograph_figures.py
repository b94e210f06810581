"""What the page on photographs shows: what files say of themselves, how each was registered. Nothing is measured here."""

import html
import json
from pathlib import Path

import numpy as np
import pandas as pd
from IPython.display import HTML

from inputs.photo_facts import said_in_words
from inputs.tables import FILES, REGISTERED, read_table
from rig.geometry import make_pose

POSE = ["rx", "ry", "rz", "tx", "ty", "tz"]
SAYS_NOTHING = "The files say nothing of camera, exposure or compression."


def words(results, cameras):
    """Return an HTML list: per camera what its files say, and what registering them had to say.

    cameras  table of expand/cameras.csv
    """
    lines = []
    for c in cameras.itertuples():
        files = read_table(Path(results) / f"register/{c.camera}/files.csv", FILES).to_dict("records")
        record = json.loads((Path(results) / f"register/{c.camera}.json").read_text())
        said = said_in_words(files, (c.width, c.height)) or [SAYS_NOTHING]
        lines += [f"{c.camera}: {line}" for line in [*said, *record["messages"]]]
    return HTML("<ul>" + "".join(f"<li>{html.escape(line)}</li>" for line in lines) + "</ul>")


def table(results, camera):
    """Return an HTML table, a row a capture: where it was taken from, how well it fits, what its file says."""
    registered = read_table(Path(results) / f"register/{camera}.csv", REGISTERED)
    files = read_table(Path(results) / f"register/{camera}/files.csv", FILES)
    both = registered.merge(files, on="capture", how="left")
    poses = both[POSE].to_numpy(float)
    shown = {
        "capture": both.capture,
        "status": both.status.str.replace("_", " "),
        "markers": both.n_markers,
        "off by, px": both.rms_px.round(2),
        "distance, m": np.round([distance_m(p) for p in poses], 3),
        "seen at, °": np.round([incidence_deg(p) for p in poses], 0),
        "exposed, s": both.exposure_s.map("{:.2g}".format, na_action="ignore"),
        "ISO": both.iso,
        "f/": both.f_number,
        "focal length, mm": both.focal_mm,
        "JPEG quality": both.jpeg_quality,
    }
    told = pd.DataFrame(shown).dropna(axis="columns", how="all")
    return HTML(f'<div class="wide" style="overflow-x:auto">{told.to_html(index=False, na_rep="", border=0)}</div>')


def distance_m(pose):
    """Return how far the camera is from the world's origin, metres; NaN where the pose (6,) is unknown."""
    return float(np.linalg.norm(pose[3:]))


def incidence_deg(pose):
    """Return the angle between the plane z = 0 and being seen straight on, degrees; NaN where the pose (6,) is unknown."""
    if not np.isfinite(pose).all():
        return np.nan
    normal = make_pose(pose[:3], pose[3:])[:3, 2]
    return float(np.degrees(np.arccos(min(abs(normal[2]), 1.0))))
