"""Register: open and check every capture of a camera, calibrate it from boards, and find the pose of each capture."""

import hashlib
import json
import logging
from pathlib import Path

import cv2
import numpy as np
import pandas as pd
from tqdm import tqdm

import job
from rig import boards, calibration, tables
from rig.campaign import Board, inside
from rig.errors import InputError
from rig.geometry import camera_matrix, make_pose, split_pose
from rig.images import read_image
from rig.plates import aruco_dictionary, marker_corners_world
from rig.registration import register_pose
from rig.safe_yaml import load_yaml

log = logging.getLogger("twingap")
SE = [f"se_{k}" for k in tables.POSE]
COLUMNS = ["capture", "station", "trial", "status", "sha256", "n_markers", "rms_px", *tables.POSE, *SE]
MOST_MESSAGES = 5
SECTORS_ARE_BETTER = 0.6


def read_captures(campaign, captures, size):
    """Return {capture: pixels hash} after opening every image; one message for all that is wrong with them."""
    problems, hashes, first = [], {}, {}
    for c in tqdm(list(captures.itertuples()), desc="checking captures", unit="image", mininterval=5):
        try:
            image = read_image(inside(campaign, c.image, f"{campaign}: capture {c.capture}"), size)
        except InputError as error:
            problems.append(f"capture {c.capture}: {error}")
            continue
        digest = hashlib.sha256(str((image.shape, image.dtype)).encode() + image.tobytes()).hexdigest()
        if digest in first:
            problems.append(f"captures {first[digest]} and {c.capture} are the same picture ({c.image})")
        first.setdefault(digest, c.capture)
        hashes[c.capture] = digest
    if problems:
        more = f" (and {len(problems) - MOST_MESSAGES} more)" if len(problems) > MOST_MESSAGES else ""
        raise InputError("; ".join(problems[:MOST_MESSAGES]) + more)
    return hashes


def detect_corners(image, markers):
    """Return (world points (n, 3), pixels (n, 2), number of markers) of the rig's markers seen in an image."""
    grey = image if image.ndim == 2 else cv2.cvtColor(image, cv2.COLOR_BGR2GRAY)
    grey = (grey // 257).astype(np.uint8) if grey.dtype == np.uint16 else grey
    parameters = cv2.aruco.DetectorParameters()
    parameters.cornerRefinementMethod = cv2.aruco.CORNER_REFINE_SUBPIX
    points, pixels = [], []
    for name, rows in markers.groupby("dictionary", sort=True):
        known = {m.id: m for m in rows.itertuples()}
        found, ids, _ = cv2.aruco.ArucoDetector(aruco_dictionary(name), parameters).detectMarkers(grey)
        for quad, marker in zip(found, [] if ids is None else np.ravel(ids), strict=True):
            if marker in known:
                points.append(marker_corners_world(known[marker]))
                pixels.append(quad.reshape(4, 2))
    if not points:
        return np.zeros((0, 3)), np.zeros((0, 2)), 0
    return np.concatenate(points), np.concatenate(pixels).astype(float), len(points)


def register_markers(campaign, captures, stations, markers, K, tolerance):
    """Return {capture: (status, n_markers, rms_px, T_cam_world, se)} of captures of a rig of markers."""
    sigma = np.array([np.radians(tolerance["angle_deg"])] * 3 + [tolerance["position_m"]] * 3) if tolerance else None
    out = {}
    for c in tqdm(list(captures.itertuples()), desc="registering", unit="image", mininterval=5):
        pose = stations.loc[c.station, tables.POSE].to_numpy(float)
        nominal = make_pose(pose[:3], pose[3:]) if np.isfinite(pose).all() else None
        points, pixels, n = detect_corners(read_image(Path(campaign) / c.image), markers)
        if n == 0 or (nominal is None and n < 1):
            out[c.capture] = ("no_markers", 0, np.nan, nominal, np.full(6, np.nan))
            continue
        prior = np.maximum(sigma, 1e-9) if sigma is not None else np.array([0.5] * 3 + [1.0] * 3)
        T, se, rms = register_pose(points, pixels, K, nominal, prior)
        out[c.capture] = ("registered", n, rms, T, se)
    return out


def find_boards(campaign, captures, board):
    """Return {capture: BoardPoints}; the sector-based chessboard finder is taken where it nearly halves the residual."""
    images = {c.capture: read_image(Path(campaign) / c.image) for c in captures.itertuples()}
    found = {k: boards.find_board(image, board) for k, image in images.items()}
    if not any(len(v.image) >= boards.LEAST_POINTS for v in found.values()):
        boards.check_legacy_pattern(images.values(), board)
    if board.type == "chessboard":
        by_sectors = {k: boards.find_chessboard_by_sectors(image, board) for k, image in images.items()}
        size = next(iter(images.values())).shape[1::-1]
        rms = [_rms_of_5(usable_views(f), size) for f in (found, by_sectors)]
        if rms[1] < SECTORS_ARE_BETTER * rms[0]:
            log.info("sector-based chessboard finder: residual %.3f px instead of %.3f px", rms[1], rms[0])
            return by_sectors
    return found




def usable_views(found):
    """Return the BoardPoints with enough points to be a view."""
    return [v for v in found.values() if len(v.image) >= boards.LEAST_POINTS]


def _rms_of_5(views, size):
    if len(views) < calibration.LEAST_VIEWS:
        return np.inf
    return calibration.calibrate(views, size, calibration.MODELS["5"])["rms_px"]


def register_board(campaign, captures, size, board, known):
    """Return (registered, intrinsics, fits) of captures of one board: poses of the ideal pinhole.

    known: (fx, fy, cx, cy), or None where the ideal twin's pinhole is fitted (fx = fy, centre of the image).
    """
    found = find_boards(campaign, captures, board)
    views = usable_views(found)
    nothing = {c: ("no_markers", 0, np.nan, None, np.full(6, np.nan)) for c in found}
    if not views or (known is None and len(views) < calibration.LEAST_VIEWS):
        return nothing, known, {}
    if known is None:
        K = calibration.ideal_pinhole(views, size)["parameters"]
        known = [K[k] for k in ("fx", "fy", "cx", "cy")]
    out = dict(nothing)
    for capture, v in found.items():
        if len(v.image) >= boards.LEAST_POINTS:
            T, se, rms = register_pose(v.board, v.image, camera_matrix(*known), None, None)
            out[capture] = ("registered", v.markers or len(v.image), rms, T, se)
    return out, known, calibration.calibrate_all(views, size)


def calibration_folder(campaign, camera):
    """Return {model: fit} of the images in calibration/<camera>/, where there is such a folder."""
    folder = Path(campaign) / "calibration" / camera
    if not (folder / "board.yaml").is_file():
        return {}
    board = Board.model_validate(load_yaml(folder / "board.yaml"))
    paths = sorted(p for p in folder.iterdir() if p.suffix.lower() in (".png", ".jpg", ".jpeg", ".tif", ".tiff"))
    images = [read_image(p) for p in paths]
    views = [v for v in (boards.find_board(image, board) for image in images) if len(v.image) >= boards.LEAST_POINTS]
    if not views:
        boards.check_legacy_pattern(images, board)
    return calibration.calibrate_all(views, images[0].shape[1::-1]) if images else {}


def register_captures(expand, campaign, camera, out_csv, out_json):
    """Check and register all captures of a camera; a designed experiment passes on its nominal intrinsics."""
    expand = Path(expand)
    facts = json.loads((expand / "scene.json").read_text())
    row = tables.read_table(expand / "cameras.csv", tables.CAMERAS).set_index("camera").loc[camera]
    size = int(row.width), int(row.height)
    known = None if np.isnan(row.fx) else [float(row[k]) for k in ("fx", "fy", "cx", "cy")]
    captures = tables.read_table(expand / "captures.csv", tables.CAPTURES)
    captures = captures[captures.camera == camera].sort_values("capture")
    stations = tables.read_table(expand / "stations.csv", tables.STATIONS)
    stations = stations[stations.camera == camera].set_index("station")
    hashes, registered, fits = {}, {}, {}
    if len(captures):
        hashes = read_captures(campaign, captures, size)
        if facts["target"]:
            board = Board.model_validate(facts["target"])
            registered, known, fits = register_board(campaign, captures, size, board, known)
        else:
            if known is None:
                raise InputError(f"{campaign}/campaign.yaml: camera {camera}: a rig of markers needs fx, fy, cx and cy")
            markers = tables.read_table(expand / "markers.csv", tables.MARKERS)
            registered = register_markers(
                campaign, captures, stations, markers, camera_matrix(*known), facts["tolerance"]
            )
        fits = fits or calibration_folder(campaign, camera)
    if known is None:  # nothing can be fitted: a plain guess, so that the coverage of 0 can be reported
        known = [float(max(size))] * 2 + [(size[0] - 1) / 2, (size[1] - 1) / 2]
    _write(captures, hashes, registered, out_csv)
    record = dict(zip(("fx", "fy", "cx", "cy"), known, strict=True))
    record["calibrations"] = {k: {n: v for n, v in f.items() if n != "poses"} for k, f in fits.items()}
    record["views"] = int(sum(r[0] == "registered" for r in registered.values()))
    with job.write_atomically(out_json) as file:
        json.dump(record, file, indent=1, sort_keys=True)


def _write(captures, hashes, registered, out_csv):
    rows = []
    for c in captures.itertuples():
        status, n, rms, T, se = registered[c.capture]
        pose = np.concatenate(split_pose(T)) if T is not None else np.full(6, np.nan)
        rows.append([c.capture, c.station, c.trial, status, hashes[c.capture], n, rms, *pose, *se])
    table = pd.DataFrame(rows, columns=COLUMNS)
    with job.write_atomically(out_csv) as file:
        table.to_csv(file, index=False, lineterminator="\n")


if __name__ == "__main__":
    job.run(
        register_captures,
        snakemake,
        expand=Path(snakemake.input.scene).parent,
        campaign=snakemake.params.campaign,
        camera=snakemake.wildcards.camera,
        out_csv=snakemake.output.table,
        out_json=snakemake.output.intrinsics,
    )
