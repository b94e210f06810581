"""Stations are rendered once, again only when something changed, and a killed or failed run loses nothing."""

import contextlib
import errno
import io
import json
import os
import signal
import subprocess
import sys
import time
from pathlib import Path

import numpy as np
import pandas as pd
import pytest

from inputs import tables
from inputs.render_store import read_station
from rig.geometry import split_pose, station_pose

SCRIPTS = Path(__file__).resolve().parents[2] / "scripts"
SETTINGS = {"device": "cpu", "edge_samples": 32, "overscan": 0.1, "threads": 1}
CODE = """
import json, sys
from pathlib import Path
import job
from render_stations import render_stations
a = json.loads(sys.argv[1])
job.set_up_log()
with job.one_message():
    render_stations(**a)
"""


def write_rig_tables(folder, heights=(0.3, 0.4, 0.5), black=0.05):
    """Write the expanded tables of a small rig; return the arguments of render_stations."""
    expand = folder / "expand"
    columns = list(tables.MARKERS.columns)
    markers = [["DICT_5X5_1000", i, 0.1, 0.13, 0.15 * (i - 1), 0.5, 0, 0, 0, 0] for i in range(3)]
    tables.write_table(pd.DataFrame(markers, columns=columns), expand / "markers.csv", tables.MARKERS)
    cameras = pd.DataFrame([["c", 120, 90, 100.0, 100.0, 59.5, 44.5]], columns=list(tables.CAMERAS.columns))
    tables.write_table(cameras, expand / "cameras.csv", tables.CAMERAS)
    rows = [["c", f"h{h}", h, 30.0, *np.concatenate(split_pose(station_pose(h, 30)))] for h in heights]
    rows.append(["c", "unknown", *[np.nan] * 8])
    stations = pd.DataFrame(rows, columns=list(tables.STATIONS.columns))
    tables.write_table(stations, expand / "stations.csv", tables.STATIONS)
    reflectance = {"white": 0.8, "black": black, "ground": 0.35, "background": 0.3}
    (expand / "scene.json").write_text(json.dumps({"target": None, "reflectance": reflectance}))
    register = folder / "register"
    register.mkdir(exist_ok=True)
    (register / "c.json").write_text(json.dumps({"fx": 100.0, "fy": 100.0, "cx": 59.5, "cy": 44.5}))
    row = ["x", "unknown", 0, "not found", "", 0, *[np.nan] * 13]
    registered = pd.DataFrame([row], columns=list(tables.REGISTERED.columns))
    tables.write_table(registered, register / "c.csv", tables.REGISTERED)
    return {
        "expand": str(expand),
        "register_csv": str(register / "c.csv"),
        "register_json": str(register / "c.json"),
        "camera": "c",
        "effects": [],
        "settings": SETTINGS,
        "out": str(folder / "render" / "c.json"),
        "timing": str(folder / "render" / "c_timing.csv"),
    }


def run(arguments):
    """Render in this process; return the manifest and the stations that were rendered."""
    from render_stations import render_stations

    with contextlib.redirect_stdout(io.StringIO()):
        render_stations(**arguments)
    manifest = json.loads(Path(arguments["out"]).read_text())
    return manifest, sorted(pd.read_csv(arguments["timing"]).station)


def test_only_what_changed_is_rendered(tmp_path):
    """Were keys too coarse, old pixels would stay; too fine, everything would be rendered again and again."""
    arguments = write_rig_tables(tmp_path)
    manifest, rendered = run(arguments)
    assert rendered == ["h0.3", "h0.4", "h0.5"] == sorted(manifest["stations"])
    assert manifest["device"] == "CPU" and manifest["blender"].startswith("5.")
    radiance, margin = read_station(tmp_path / "render", manifest["stations"]["h0.4"])
    assert radiance.shape == (90 + 2 * margin, 120 + 2 * margin) and radiance.dtype == np.float32 and margin == 12
    again, rendered = run(arguments)
    assert rendered == [] and again == manifest
    (tmp_path / "render/c/h0.4.npz").write_bytes(b"cut short")
    again, rendered = run(arguments)
    assert rendered == ["h0.4"] and again == manifest
    write_rig_tables(tmp_path, heights=(0.3, 0.45))
    assert run(arguments)[1] == ["h0.45"]
    write_rig_tables(tmp_path, heights=(0.3, 0.45), black=0.06)
    assert run(arguments)[1] == ["h0.3", "h0.45"]
    assert not list((tmp_path / "render").glob(".*"))


def test_scene_effects_take_part(tmp_path):
    """Were the twin's scene effects ignored, an adopted lamp would never be seen."""
    arguments = write_rig_tables(tmp_path, heights=(0.3,))
    plain, _ = run(arguments)
    arguments["effects"] = [["illumination_gradient", {"gradient_x": 0.5}]]
    lit, rendered = run(arguments)
    assert rendered == ["h0.3"]
    assert lit["stations"]["h0.3"]["pixels_sha256"] != plain["stations"]["h0.3"]["pixels_sha256"]


def test_killed_run_goes_on(tmp_path):
    """Were stations written in one go at the end, a kill in the middle would lose them all."""
    heights = tuple(np.round(np.linspace(0.3, 0.6, 12), 3))
    arguments = write_rig_tables(tmp_path, heights)
    process = subprocess.Popen(
        [sys.executable, "-c", CODE, json.dumps(arguments)],
        cwd=SCRIPTS,
        stdout=subprocess.DEVNULL,
        stderr=subprocess.DEVNULL,
    )
    try:
        end = time.monotonic() + 120
        while len(list((tmp_path / "render").glob("c/h*.npz"))) < 2 and time.monotonic() < end:
            time.sleep(0.02)
    finally:
        process.send_signal(signal.SIGKILL)
        process.wait()
    assert not Path(arguments["out"]).exists()
    kept = {p.stem for p in (tmp_path / "render").glob("c/h*.npz")}
    assert 2 <= len(kept) < 12
    manifest, rendered = run(arguments)
    assert len(manifest["stations"]) == 12 and set(rendered) == set(manifest["stations"]) - kept
    whole = write_rig_tables(tmp_path / "other", heights)
    assert run(whole)[0]["stations"] == manifest["stations"]


@pytest.mark.parametrize("where", ["Blender's file", "the station's file"])
def test_full_disk_is_one_message(tmp_path, monkeypatch, caplog, where):
    """Were a full disk not seen, a station cut short would be taken for a render; earlier results must stay."""
    import blender.renderer
    import job
    from render_stations import render_stations

    arguments = write_rig_tables(tmp_path)
    before, _ = run(arguments)
    write_rig_tables(tmp_path, black=0.07)

    def full(*_):
        raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC), "disk")

    if where == "Blender's file":
        real = blender.renderer._read_exr

        def cut_short(path, shape):
            os.truncate(path, 1000)
            return real(path, shape)

        monkeypatch.setattr(blender.renderer, "_read_exr", cut_short)
    else:
        monkeypatch.setattr("inputs.render_store.write_station", full)
    with caplog.at_level("ERROR"), pytest.raises(SystemExit) as end, job.one_message():
        render_stations(**arguments)
    assert end.value.code == 1
    errors = [r.getMessage() for r in caplog.records if r.levelname == "ERROR"]
    assert len(errors) == 1 and ("No space left" in errors[0] or "disk is full" in errors[0])
    assert json.loads(Path(arguments["out"]).read_text()) == before
    assert not list((tmp_path / "render").glob(".*"))
