"""Detect: one detector on the real captures and the twin images of one camera, with both poses of each marker."""

import json
import logging
import time
from pathlib import Path

import pandas as pd
from tqdm import tqdm

import job
from detect_markers import read_image
from detectors import contract
from inputs.tables import CAPTURES, CORNERS, DETECTION_TIMES, DETECTIONS, MARKERS, read_table, write_table
from rig.errors import InputError
from rig.geometry import camera_matrix

log = logging.getLogger("twingap")


def images_of(camera, captures, campaign, twin_folder, part=None):
    """Return (source, capture, path) of the images of a camera, real before twin, each sorted by capture.

    part (first, after the last): of these captures alone, counted in that order.
    """
    mine = captures[captures.camera == camera].sort_values("capture")
    twin = sorted(Path(twin_folder).glob("*.png"))
    if part:
        mine = mine.iloc[slice(*part)]
        names = set(mine.capture)
        twin = [path for path in twin if path.stem in names]
    real = [("real", c.capture, Path(campaign) / c.image) for c in mine.itertuples()]
    return real + [("twin", path.stem, path) for path in twin]


def pose_columns(corners, code_m, K):
    """Return both poses, each with its reprojection error, as DETECTIONS has them; None where there is none."""
    poses = contract.estimate_poses(corners, code_m, K) if code_m and K is not None else []
    values = []
    for k in range(2):
        values += [*poses[k][0], *poses[k][1], poses[k][2]] if k < len(poses) else [None] * 7
    return values


def detect_image(detector, image, code_of, K):
    """Return (rows without source and capture, milliseconds) of one image."""
    start = time.perf_counter()
    found = detector.detect(image)
    ms = 1000 * (time.perf_counter() - start)
    rows = [
        [d.dictionary, d.id, *d.corners.ravel(), *pose_columns(d.corners, code_of.get((d.dictionary, d.id)), K)]
        for d in found
    ]
    return rows, ms


def detect_all(detector, images, code_of, K):
    """Return (detections, timing) tables of (source, capture, path) triples."""
    rows, timing = [], []
    for number, (source, capture, path) in enumerate(tqdm(images, desc="detecting", unit="image", mininterval=5)):
        image = read_image(path)
        if number == 0:
            detector.detect(image)  # untimed: compilation and first touch of memory are no property of an image
        found, ms = detect_image(detector, image, code_of, K)
        rows += [[source, capture, *row] for row in found]
        timing.append([source, capture, round(ms, 3)])
    detections = pd.DataFrame(rows, columns=list(DETECTIONS.columns))
    detections = detections.sort_values(["source", "capture", "dictionary", "id", *CORNERS], kind="stable")
    return detections, pd.DataFrame(timing, columns=list(DETECTION_TIMES.columns))


def nominal_camera(register_json):
    """Return the 3 x 3 intrinsics of the ideal twin, or None where they are unknown."""
    values = json.loads(Path(register_json).read_text())
    four = [values.get(name) for name in ("fx", "fy", "cx", "cy")]
    return None if any(v is None for v in four) else camera_matrix(*four)


def detect_captures(
    camera, detector, parameters, dictionaries, campaign, captures, markers, register, twin, out, timing, part=None
):
    """Write the detections and the timing of one detector and camera, of a part of its captures where one is given.

    parameters    dict of the detector's parameters that differ from its defaults
    dictionaries  OpenCV's names; empty: those of the markers' table, else both of the paper
    campaign      folder that the images are relative to; None without photographs
    part          (first, after the last) of the camera's sorted captures; None: all
    captures, markers, register, twin  expand/captures.csv, expand/markers.csv, register/CAMERA.json, twin/CAMERA
    """
    rig = read_table(markers, MARKERS)
    code_of = {(m.dictionary, m.id): m.code_m for m in rig.itertuples()}
    dictionaries = dictionaries or sorted(set(rig.dictionary)) or contract.DEFAULT_DICTIONARIES
    finder = contract.make(detector, dictionaries, parameters, where=f"config: detectors.{detector}")
    images = images_of(camera, read_table(captures, CAPTURES), campaign or ".", twin, part)
    if not images:
        raise InputError(f"{captures}: camera {camera} has no capture, and {twin} no twin image")
    found, milliseconds = detect_all(finder, images, code_of, nominal_camera(register))
    write_table(found, out, DETECTIONS)
    write_table(milliseconds, timing, DETECTION_TIMES)
    log.info("%s, %s: %d markers in %d images", camera, detector, len(found), len(images))


if __name__ == "__main__":
    job.run(
        detect_captures,
        snakemake,
        camera=snakemake.wildcards.camera,
        detector=snakemake.wildcards.detector,
        parameters=snakemake.params.parameters,
        dictionaries=snakemake.params.dictionaries,
        campaign=snakemake.params.campaign,
        captures=snakemake.input.captures,
        markers=snakemake.input.markers,
        register=snakemake.input.register,
        twin=snakemake.input.twin,
        out=snakemake.output.detections,
        timing=snakemake.output.timing,
        part=snakemake.params.get("part"),
    )
