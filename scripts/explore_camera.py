"""Explore: what the page to explore shows of one camera: images to compare, and the numbers of every capture and marker.

Some captures are shown with every twin of the ladder, drawn in their own poses, at full size and without loss; the others
with the twin image that is there already, smaller. Everything lies in one folder, as files that a page may load one by one.
"""

import json
import logging
from dataclasses import dataclass, field
from pathlib import Path

import cv2
import numpy as np
import pandas as pd

import job
from case_files import load_case, load_observations, read_capture
from effects.base import View
from inputs import tables
from inputs.scene import load_scene
from markers.contract import marker_corners_world
from register.registration import lens_of
from reporting.explore_tables import (
    as_js,
    bin_index,
    bins_of,
    cell_sums,
    cells_of_capture,
    height_and_tilt,
    intrinsics,
    place_of,
    plate_sums,
    rounded,
    tilt_bins,
)
from reporting.ladder_images import LadderImages, chosen, rungs_of
from rig.geometry import make_pose, project, transform
from whole_folder import whole_folder

log = logging.getLogger("twingap")

CAPTURES_A_FILE = 16  # their markers' numbers, some 10 kB a capture
SMALL_WIDTH_PX, SMALL_QUALITY = 960, 88  # of images that are shown reduced
LADDER_NUMBERS = ("corner_rmse_px", "intensity_rmse_dn", "detection_disagreement_pct", "gap")
POINTS_A_SIDE = 20  # of a board's outline: a lens bends it
FAR_PX = -(2**15), 2**15 - 1  # beyond any frame: what OpenCV can fill to
POSE = ["rx", "ry", "rz", "tx", "ty", "tz"]


@dataclass
class Measured:
    """The tables of one camera: captures (a row each, in order), and what is known of plates and markers there."""

    captures: pd.DataFrame
    markers: pd.DataFrame
    plates: pd.DataFrame
    cells: pd.DataFrame
    detections: pd.DataFrame
    detectors: list
    marker_of: dict = field(init=False)

    def __post_init__(self):
        names = self.markers.dictionary + "/" + self.markers.id.astype(str)
        self.marker_of = {name: k for k, name in enumerate(names)}


def read_measured(expand, camera, register, plates, cells, detections):
    """Return the Measured tables; ``plates``, ``cells`` are None and ``detections`` empty where there are no markers."""
    captures = tables.read_table(Path(expand) / "captures.csv", tables.CAPTURES)
    captures = captures[captures.camera == camera].sort_values("capture")
    captures = captures.set_index("capture", drop=False).rename_axis("name")
    stations = tables.read_table(Path(expand) / "stations.csv", tables.STATIONS)
    stations = stations[stations.camera == camera].set_index("station")
    registered = tables.read_table(register, tables.REGISTERED).set_index("capture")
    captures = captures.join(stations[["height_m", "tilt_deg"]], on="station").join(registered.rms_px)
    poses = [_pose_of(registered, name, stations, station) for name, station in captures.station.items()]
    captures["T_cam_world"] = poses
    known = [np.nan] * 2, [height_and_tilt(T) if T is not None else (np.nan, np.nan) for T in poses]
    for k, name in enumerate(("height_m", "tilt_deg")):
        captures[name] = captures[name].fillna(pd.Series([pair[k] for pair in known[1]], index=captures.index))
    found = [
        tables.read_table(p, tables.DETECTIONS).assign(detector=Path(p).stem) for p in sorted(map(str, detections))
    ]
    return Measured(
        captures,
        tables.read_table(Path(expand) / "markers.csv", tables.MARKERS),
        pd.read_parquet(plates) if plates else pd.DataFrame(columns=["capture"]),
        pd.read_parquet(cells) if cells else pd.DataFrame(columns=["capture"]),
        pd.concat([f[f.source == "real"] for f in found]) if found else pd.DataFrame(columns=["capture"]),
        [Path(p).stem for p in sorted(map(str, detections))],
    )


def _pose_of(registered, capture, stations, station):
    """Return the registered T_cam_world of a capture, else its station's, else None."""
    for table, name in ((registered, capture), (stations, station)):
        values = table.loc[name, POSE].to_numpy(float)
        if np.isfinite(values).all():
            return make_pose(values[:3], values[3:])
    return None


# -- images ---------------------------------------------------------------------------------------------------------


def write_image(path, image):
    """Write grey levels (H, W, C), red first, as a PNG of one channel where all are equal."""
    pixels = np.clip(np.rint(image), 0, 255).astype(np.uint8)
    alike = pixels.shape[2] == 1 or (pixels == pixels[..., :1]).all()
    _, data = cv2.imencode(".png", pixels[..., 0] if alike else pixels[..., ::-1], [cv2.IMWRITE_PNG_COMPRESSION, 4])
    path.write_bytes(data.tobytes())


def write_small(path, image):
    """Write an image (H, W) or (H, W, 3), blue first, as a JPEG at most SMALL_WIDTH_PX wide."""
    height, width = image.shape[:2]
    if width > SMALL_WIDTH_PX:
        size = SMALL_WIDTH_PX, round(height * SMALL_WIDTH_PX / width)
        image = cv2.resize(image, size, interpolation=cv2.INTER_AREA)
    _, data = cv2.imencode(".jpg", image, [cv2.IMWRITE_JPEG_QUALITY, SMALL_QUALITY])
    path.write_bytes(data.tobytes())


def rms_between(real, twin, inside=slice(None)):
    """Return how far two images (H, W, C) differ in grey levels, root mean square of their channels' means.

    Of the pixels (H, W) that lie ``inside``; None where none does.
    """
    off = (real.mean(axis=2) - twin.mean(axis=2))[inside]
    return round(float(np.sqrt((off**2).mean())), 3) if off.size else None


def board_seen(scene, K, T_cam_world, size, effects=()):
    """Return which pixels (H, W) of an image of a size (width, height) show the squares of a scene's board behind effects
    [(name, parameters)].
    """
    plate, share = scene.plates[0], np.linspace(0, 1, POINTS_A_SIDE)[:, None]
    (x0, x1), (y0, y1) = plate.x_m[[1, -2]], plate.y_m[[1, -2]]
    corners = np.array([[x0, y0, 0], [x1, y0, 0], [x1, y1, 0], [x0, y1, 0]])
    outline = np.concatenate([a + share * (b - a) for a, b in zip(corners, np.roll(corners, -1, axis=0), strict=True)])
    lens = lens_of(View(K, *size, 0, T_cam_world, "", "", ""), effects)
    seen = lens(project(K, T_cam_world, outline), T_cam_world)
    mask = np.zeros(size[::-1], np.uint8)
    return cv2.fillPoly(mask, [np.rint(np.clip(seen, *FAR_PX)).astype(np.int32)], 1) > 0


def show_ladder(real, name, ladder, folder, image):
    """Write a capture and its twins of all rungs; return what the page is told of them."""
    write_image(folder / f"{image}_real.png", real)
    measured, steps = ladder.measured(name), []
    for k, shown in enumerate(ladder.of_capture(name)):
        write_image(folder / f"{image}_{k}.png", shown.image)
        off = ((measured - shown.corners) ** 2).sum(-1)
        off_px = round(float(np.sqrt(np.nanmean(off))), 3) if np.isfinite(off).any() else None
        steps.append(
            {"rms_dn": rms_between(real, shown.expected), "off_px": off_px, "corners": _by_marker(shown.corners)}
        )
    return {"measured": _by_marker(measured), "steps": steps}


def _by_marker(corners):
    return {k: rounded(c.ravel(), 2) for k, c in enumerate(corners) if np.isfinite(c).all()}


def show_pair(real, twin_file, folder, image, inside=slice(None)):
    """Write a capture and its twin image, both reduced; return what the page is told of them, of the pixels ``inside``."""
    write_small(folder / f"{image}_real.jpg", np.clip(np.rint(real), 0, 255).astype(np.uint8)[..., ::-1])
    twin = cv2.imread(str(twin_file))
    if twin is None:
        return {"measured": {}, "steps": []}
    write_small(folder / f"{image}_0.jpg", twin)
    return {
        "measured": {},
        "steps": [{"rms_dn": rms_between(real, twin[..., ::-1], inside), "off_px": None, "corners": {}}],
    }


# -- the whole ------------------------------------------------------------------------------------------------------


def ladder_records(rungs, verdict, ladder_file):
    """Return a dict a rung: effect, parameters with errors, and the held-out errors of its row in the ladder."""
    rows = pd.read_csv(ladder_file).to_dict("records")
    known = {s["effect"]: s["parameters"] for s in verdict["steps"]}
    known = {
        e["effect"]: {k: {"value": v} for k, v in e["parameters"].items()} for e in verdict.get("configured", [])
    } | known
    records = []
    for k, (effect, _) in enumerate(rungs):
        row = rows[k] if len(rows) == len(rungs) else {}
        errors = {m: [row.get(m), row.get(f"{m}_floor")] for m in LADDER_NUMBERS}
        records.append({"effect": effect, "parameters": known.get(effect, {}), "errors": errors})
    return records


def capture_columns(measured, drawn):
    """Return the captures' table as columns for the page."""
    c = measured.captures
    by_twin = {twin: _corner_rms(measured.plates, twin) for twin in ("configured", "explained")}
    if measured.markers.empty:  # of a board the registration's residuals are known
        by_twin["configured"] = c.rms_px.round(4).to_dict()
    return {
        "name": c.capture.tolist(),
        "station": c.station.tolist(),
        "trial": c.trial.tolist(),
        "height_m": rounded(c.height_m, 4),
        "tilt_deg": rounded(c.tilt_deg, 2),
        "tilt": c.tilt_bin.tolist(),
        "drawn": [int(name in drawn) for name in c.capture],
        "before_px": [by_twin["configured"].get(name) for name in c.capture],
        "after_px": [by_twin["explained"].get(name) for name in c.capture],
    }


def _corner_rms(plates, twin):
    if "dx_px" not in plates:
        return {}
    mine = plates[plates.twin == twin]
    squares = (mine[[f"corner_{axis}{k}" for k in range(4) for axis in "xy"]] ** 2).sum(axis=1) / 4
    return np.sqrt(squares.groupby(mine.capture).mean()).round(4).to_dict()


def write_captures(measured, campaign, twin_folder, camera, K, size, ladder, drawn, board, out):
    """Write images and cells of all captures; some in a file: the page loads them when one of them is asked for.

    ``board`` is (Scene, effects as configured) of a board, whose surroundings are not modelled, else None.
    """
    cells = {name: part for name, part in measured.cells.groupby("capture")}
    found = {name: part for name, part in measured.detections.groupby("capture")}
    world = [marker_corners_world(m).mean(axis=0) for m in measured.markers.itertuples()]
    empty = pd.DataFrame()
    for first in range(0, len(measured.captures), CAPTURES_A_FILE):
        told = {}
        for k, row in enumerate(measured.captures.iloc[first : first + CAPTURES_A_FILE].itertuples(), first):
            real = read_capture(campaign, row.image)
            image = f"{k:05d}"
            if row.capture in drawn:
                shown = show_ladder(real, row.capture, ladder, out, image)
            else:
                inside = (
                    board_seen(board[0], K, row.T_cam_world, size, board[1])
                    if board and row.T_cam_world is not None
                    else slice(None)
                )
                shown = show_pair(real, Path(twin_folder) / f"{row.capture}.png", out, image, inside)
            if K is not None and row.T_cam_world is not None:
                shown["place"] = place_of(K, *size, row.T_cam_world)
                if world:
                    shown["range_m"] = rounded(np.linalg.norm(transform(row.T_cam_world, np.array(world)), axis=1), 4)
            mine = cells.get(row.capture, empty), found.get(row.capture, empty)
            told[k] = shown | {"found": cells_of_capture(*mine, measured.detectors, measured.marker_of)}
        number = first // CAPTURES_A_FILE
        (out / f"cells_{number:04d}.js").write_text(as_js(f"cells/{camera}/{number}", told), encoding="utf-8")


def explore_camera(
    expand, register, register_json, campaign, camera, verdict, ladder_file, observations, plates, cells, detections,
    twin_folder, most, seed, out,
):  # fmt: skip
    """Write the folder ``out`` of one camera: ``camera.js``, ``cells_NNNN.js`` and the images they name.

    verdict, ladder_file     diagnosis/CAMERA.json and CAMERA/ladder.csv
    observations, plates, cells, detections  of a campaign with markers; None, None, None and [] without
    most                     captures that are shown with all twins of the ladder
    """
    expand, out = Path(expand), Path(out)
    verdict = json.loads(Path(verdict).read_text())
    record = json.loads(Path(register_json).read_text())
    measured = read_measured(expand, camera, register, plates, cells, detections)
    labels, measured.captures["tilt_bin"] = tilt_bins(measured.captures.tilt_deg)
    ladder, drawn, rungs = None, set(), rungs_of(verdict)
    facts = json.loads((expand / "scene.json").read_text())
    configured = [(e["effect"], e["parameters"]) for e in verdict.get("configured", [])]
    board = (load_scene(expand, register_json), configured) if facts["target"] else None
    if observations:
        case, _ = load_case(expand, register_json, camera)
        load_observations(observations, case)
        ladder = LadderImages(case, rungs, lambda name: job.seed_of(seed, case.campaign, camera, name, "explore"))
        drawn = chosen(measured.captures, most)
    row = tables.read_table(expand / "cameras.csv", tables.CAMERAS).set_index("camera").loc[camera]
    size = int(row.width), int(row.height)
    plain = measured.captures.drop(columns="T_cam_world")
    ranges = measured.cells.range_m if len(measured.cells) else pd.Series(dtype=float)
    edges = bins_of(ranges[measured.cells.available] if len(measured.cells) else ranges)
    K = intrinsics(record)
    told = {
        "camera": camera, "width": size[0], "height": size[1], "verdict": verdict["verdict"],
        "steps": ladder_records(rungs, verdict, ladder_file), "held_out": verdict.get("held_out", []),
        "captures": capture_columns(measured, drawn), "tilts": labels, "edges_m": edges,
        "captures_a_file": CAPTURES_A_FILE,
        "in_bins": _markers_in_bins(measured, edges),
        "stands": [None if T is None or K is None else place_of(K, *size, T)["at"] for T in measured.captures.T_cam_world],
        "plates": plate_sums(measured.plates, plain, edges, measured.marker_of),
        "cells": cell_sums(measured.cells, plain, edges, measured.marker_of, measured.detectors),
    }  # fmt: skip
    with whole_folder(out) as folder:
        (folder / "camera.js").write_text(as_js(f"camera/{camera}", told), encoding="utf-8")
        write_captures(measured, campaign, twin_folder, camera, K, size, ladder, drawn, board, folder)
    log.info("%s: %d captures, %d of them with the ladder's %d twins", camera, len(plain), len(drawn), len(rungs))


def _markers_in_bins(measured, edges):
    """Return, a capture, a number whose bit k says that a marker at a distance in bin k is in the picture."""
    if not len(measured.cells):
        return []
    seen = measured.cells[measured.cells.available]
    bits = pd.Series(1 << bin_index(seen.range_m, edges), index=seen.index).groupby(seen.capture)
    known = bits.agg(lambda b: int(np.bitwise_or.reduce(b.to_numpy()))).to_dict()
    return [known.get(name, 0) for name in measured.captures.capture]


if __name__ == "__main__":
    job.run(
        explore_camera,
        snakemake,
        expand=Path(snakemake.input.scene).parent,
        register=snakemake.input.register,
        register_json=snakemake.input.register_json,
        campaign=snakemake.params.campaign,
        camera=snakemake.wildcards.camera,
        verdict=snakemake.input.verdict,
        ladder_file=snakemake.input.ladder,
        observations=snakemake.input.get("observations"),
        plates=snakemake.input.get("plates"),
        cells=snakemake.input.get("cells"),
        detections=snakemake.input.get("detections", []),
        twin_folder=snakemake.input.twin,
        most=snakemake.params.most,
        seed=snakemake.params.seed,
        out=snakemake.output[0],
    )
