"""Register: open and check every capture of a camera, calibrate it from boards, and find the pose of each capture."""

import hashlib
import json
import logging
from dataclasses import dataclass
from pathlib import Path

import cv2
import numpy as np
import pandas as pd
from pydantic import ValidationError
from tqdm import tqdm

import job
from rig import boards, calibration, tables
from rig.campaign import Board, inside
from rig.errors import InputError
from rig.geometry import camera_matrix, make_pose, project, split_pose
from rig.images import read_image
from rig.plates import aruco_dictionary, marker_corners_world
from rig.registration import NO_PRIOR, pose_from_markers, pose_from_plane, prior_of, register_pose
from rig.safe_yaml import load_yaml, validation_message

log = logging.getLogger("twingap")
INTRINSICS = ("fx", "fy", "cx", "cy")
IMAGES = (".png", ".jpg", ".jpeg", ".tif", ".tiff")
MOST_MESSAGES = 5
SECTORS_ARE_BETTER = 0.6  # the usual chessboard finder stays unless the other nearly halves the residual


@dataclass
class Markers:
    """The rig's markers in one image: corners (n, 4, 3) in the world and (n, 4, 2) in pixels, sides (n,) in m."""

    world: np.ndarray
    pixels: np.ndarray
    sides_m: np.ndarray

    def __len__(self):
        """Return the number of markers."""
        return len(self.sides_m)

    def select(self, which):
        """Return some of the markers, by a bool array."""
        return Markers(self.world[which], self.pixels[which], self.sides_m[which])


def look_at_captures(campaign, captures, size, look):
    """Open and check every image once; return ({capture: hash of its pixels}, {capture: look(image)}).

    One message for all that is wrong with the images of a camera.
    """
    problems, hashes, seen, first = [], {}, {}, {}
    for c in tqdm(list(captures.itertuples()), desc="registering captures", unit="image", mininterval=5):
        try:
            image = read_image(inside(campaign, c.image, f"{campaign}: capture {c.capture}"), size)
        except InputError as error:
            problems.append(f"capture {c.capture}: {error}")
            continue
        digest = hashlib.sha256(str((image.shape, image.dtype)).encode() + image.tobytes()).hexdigest()
        if digest in first:
            name, path = first[digest]
            problems.append(f"captures {name} ({path}) and {c.capture} ({c.image}) are the same picture")
        first.setdefault(digest, (c.capture, c.image))
        hashes[c.capture] = digest
        if not problems:
            seen[c.capture] = look(image)
    if problems:
        more = f" (and {len(problems) - MOST_MESSAGES} more)" if len(problems) > MOST_MESSAGES else ""
        raise InputError("; ".join(problems[:MOST_MESSAGES]) + more)
    return hashes, seen


def marker_finder(markers):
    """Return a function of an image that returns the Markers of the rig's table seen in it (OpenCV, sub-pixel)."""
    parameters = cv2.aruco.DetectorParameters()
    parameters.cornerRefinementMethod = cv2.aruco.CORNER_REFINE_SUBPIX
    rigs = [
        (cv2.aruco.ArucoDetector(aruco_dictionary(name), parameters), {m.id: m for m in rows.itertuples()})
        for name, rows in markers.groupby("dictionary", sort=True)
    ]

    def find(image):
        grey = boards.grey_8bit(image)
        world, pixels, sides = [], [], []
        for detector, known in rigs:
            quads, ids, _ = detector.detectMarkers(grey)
            for quad, marker in zip(quads, [] if ids is None else np.ravel(ids), strict=True):
                if marker in known:
                    world.append(marker_corners_world(known[marker]))
                    pixels.append(quad.reshape(4, 2))
                    sides.append(known[marker].code_m)
        return Markers(np.reshape(world, (-1, 4, 3)), np.reshape(pixels, (-1, 4, 2)).astype(float), np.array(sides))

    return find


def board_finder(board):
    """Return a function of an image that returns its BoardPoints by each finder: one, for a chessboard two."""

    def find(image):
        found = [boards.find_board(image, board)]
        if board.type == "chessboard":
            found.append(boards.find_chessboard_by_sectors(image, board))
        return found

    return find


def nominal_poses(captures, stations):
    """Return {capture: T_cam_world}, None where the pose is unknown."""
    poses = {}
    for c in captures.itertuples():
        pose = stations.loc[c.station, tables.POSE].to_numpy(float)
        poses[c.capture] = make_pose(pose[:3], pose[3:]) if np.isfinite(pose).all() else None
    return poses


def not_registered(nominal):
    """Return the outcome of a capture without a detectable marker: the nominal pose, where there is one."""
    return "no_markers", 0, np.nan, nominal, np.full(6, np.nan)


def register_markers(seen, K, nominal, sigma):
    """Return (status, n_markers, rms_px, T_cam_world, se) of one capture's Markers.

    A marker whose corners lie more than its own side from where the pose has them is a wrong id and is left out.
    """
    start = nominal
    if nominal is None and len(seen):
        start, sigma = pose_from_markers(seen.world, seen.pixels, K, seen.sides_m), NO_PRIOR
    if start is None or not len(seen):
        return not_registered(nominal)
    while len(seen):
        T, se, rms = register_pose(seen.world.reshape(-1, 3), seen.pixels.reshape(-1, 2), K, start, sigma)
        off_px = np.nan_to_num(np.linalg.norm(project(K, T, seen.world) - seen.pixels, axis=-1), nan=np.inf).mean(1)
        side_px = np.linalg.norm(seen.pixels - np.roll(seen.pixels, 1, axis=1), axis=-1).max(1)
        wrong = off_px > side_px
        if not wrong.any():
            return "registered", len(seen), rms, T, se
        wrong &= off_px / side_px == (off_px / side_px).max()  # one at a time: it may have pulled the others off
        seen = seen.select(~wrong)
    return not_registered(nominal)


def register_board(points, K, nominal, sigma):
    """Return (status, n_markers, rms_px, T_cam_world, se) of one capture's BoardPoints; a chessboard's points count."""
    if len(points.image) < boards.LEAST_POINTS:
        return not_registered(nominal)
    start = nominal
    if nominal is None:
        start, sigma = pose_from_plane(points.board, points.image, K), NO_PRIOR
    T, se, rms = register_pose(points.board, points.image, K, start, sigma)
    return "registered", points.markers or len(points.image), rms, T, se


def usable_views(found):
    """Return the BoardPoints of {name: BoardPoints} with enough points to be a view."""
    return {k: v for k, v in found.items() if len(v.image) >= boards.LEAST_POINTS}


def better_finder(found, size, messages):
    """Return {name: BoardPoints} of the finder to trust, from {name: [BoardPoints by each finder]}.

    The sector-based chessboard finder is taken where it sees as many boards and nearly halves the residual.
    """
    usual = {k: v[0] for k, v in found.items()}
    sectors = {k: v[1] for k, v in found.items() if len(v) > 1}
    views = [usable_views(f) for f in (usual, sectors)]
    if len(views[1]) < max(len(views[0]), calibration.LEAST_VIEWS):
        return usual
    rms = [calibration.calibrate(v, size, calibration.MODELS["5"])["rms_px"] if v else np.inf for v in views]
    if rms[1] >= SECTORS_ARE_BETTER * rms[0]:
        return usual
    messages.append(f"sector-based chessboard finder: residual {rms[1]:.3f} px instead of {rms[0]:.3f} px")
    return sectors


def board_views(found, board, size, images, where, messages):
    """Return {name: BoardPoints} of the better finder; wrong colours are said, a wrong legacy flag raises InputError.

    images  iterable over the images, opened again only where no board is found
    where   file and key of the board's description, for messages
    """
    points = better_finder(found, size, messages)
    views = usable_views(points)
    if not views:
        boards.check_legacy_pattern(images, board, where)
        messages.append(f"{where}: no image shows the board")
    inverted = sum(v.inverted for v in views.values())
    if inverted:
        messages.append(
            f"{where}: black and white are swapped in {inverted} of {len(views)} images, whichever way the board is "
            "turned; geometry is not touched by it, but the twin's board looks inverted"
        )
    return points


def read_board(path):
    """Return the Board of a board.yaml; raises InputError naming file, key and value."""
    try:
        return Board.model_validate(load_yaml(path))
    except ValidationError as error:
        raise InputError(validation_message(path, error, Board)) from None


def calibration_views(campaign, camera, size, messages):
    """Return {file name: BoardPoints} of calibration/<camera>/, empty where there is no such folder."""
    folder = Path(campaign) / "calibration" / camera
    if not folder.is_dir():
        return {}
    where = inside(campaign, f"calibration/{camera}/board.yaml", f"{campaign}: board.yaml of {camera}")
    if not where.is_file():
        raise InputError(f"{where}: no such file, but images of a board need its description")
    board = read_board(where)
    names = sorted(p.name for p in folder.iterdir() if p.suffix.lower() in IMAGES)
    paths = {n: inside(campaign, f"calibration/{camera}/{n}", f"{folder}: image {n}") for n in names}
    find = board_finder(board)
    found = {n: find(read_image(p, size)) for n, p in tqdm(paths.items(), desc="calibrating", mininterval=5)}
    images = (read_image(p, size) for p in paths.values())
    return usable_views(board_views(found, board, size, images, str(where), messages))


def guess(size):
    """Return plain intrinsics with which a coverage of 0 can be reported: nothing is known, nothing can be fitted."""
    return [float(max(size))] * 2 + [(size[0] - 1) / 2, (size[1] - 1) / 2]


def ideal_intrinsics(views, boards_of_folder, size, messages):
    """Return (fx, fy, cx, cy) of the ideal twin where nothing is known, from the captures or else the calibration."""
    for source in (views, boards_of_folder):
        if len(source) >= calibration.LEAST_VIEWS:
            fit = calibration.ideal_pinhole(source, size)
            messages.append(f"ideal pinhole fitted to {len(source)} images: residual {fit['rms_px']:.3f} px")
            return [fit["parameters"][k] for k in INTRINSICS]
    messages.append(f"intrinsics unknown and fewer than {calibration.LEAST_VIEWS} images to fit them: a guess is used")
    return guess(size)


def views_of_markers(seen):
    """Return {capture: BoardPoints} of {capture: Markers}, for the fit of unknown intrinsics."""
    return usable_views(
        {k: boards.BoardPoints(m.world.reshape(-1, 3), m.pixels.reshape(-1, 2), len(m)) for k, m in seen.items()}
    )


def register_captures(expand, campaign, camera, out_csv, out_json):
    """Check and register all captures of a camera; a designed experiment passes on its nominal intrinsics.

    expand is the folder of the tables. Writes the table and the JSON that docs/register.md describes. Raises
    InputError for captures that can't be what the tables say.
    """
    expand, messages = Path(expand), []
    facts = json.loads((expand / "scene.json").read_text())
    row = tables.read_table(expand / "cameras.csv", tables.CAMERAS).set_index("camera").loc[camera]
    size = int(row.width), int(row.height)
    known = None if np.isnan(row.fx) else [float(row[k]) for k in INTRINSICS]
    captures = tables.read_table(expand / "captures.csv", tables.CAPTURES)
    captures = captures[captures.camera == camera].sort_values("capture")
    stations = tables.read_table(expand / "stations.csv", tables.STATIONS)
    nominal = nominal_poses(captures, stations[stations.camera == camera].set_index("station"))
    hashes, outcomes, fits = {}, {}, {}
    if len(captures):
        folder_views = calibration_views(campaign, camera, size, messages)
        if facts["target"]:
            board = Board.model_validate(facts["target"])
            hashes, found = look_at_captures(campaign, captures, size, board_finder(board))
            images = (read_image(Path(campaign) / c.image) for c in captures.itertuples())
            seen = board_views(found, board, size, images, f"{campaign}/campaign.yaml: target", messages)
            views, register = usable_views(seen), register_board
        else:
            markers = tables.read_table(expand / "markers.csv", tables.MARKERS)
            hashes, seen = look_at_captures(campaign, captures, size, marker_finder(markers))
            views, register = views_of_markers(seen), register_markers
        fits = calibration.calibrate_all(folder_views or (views if facts["target"] else {}), size)
        known = known or ideal_intrinsics(views, folder_views, size, messages)
        K, sigma = camera_matrix(*known), prior_of(facts["tolerance"])
        outcomes = {c: register(seen[c], K, nominal[c], sigma) for c in captures.capture}
    known = known or guess(size)
    count = sum(outcome[0] == "registered" for outcome in outcomes.values())
    if count < len(captures):
        messages.append(f"{len(captures) - count} of {len(captures)} captures show no marker or board")
    for message in messages:
        log.info("%s: %s", camera, message)
    _write(captures, hashes, outcomes, out_csv)
    record = dict(zip(INTRINSICS, known, strict=True)) | {"calibrations": fits, "views": count, "messages": messages}
    with job.write_atomically(out_json) as file:
        json.dump(record, file, indent=1, sort_keys=True)


def _write(captures, hashes, outcomes, out_csv):
    rows = []
    for c in captures.itertuples():
        status, n, rms, T, se = outcomes[c.capture]
        pose = np.concatenate(split_pose(T)) if T is not None else np.full(6, np.nan)
        rows.append([c.capture, c.station, c.trial, status, hashes[c.capture], n, rms, *pose, *se])
    tables.write_table(pd.DataFrame(rows, columns=list(tables.REGISTERED.columns)), out_csv, tables.REGISTERED)


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
