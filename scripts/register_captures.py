"""Register: open and check every capture of a camera, calibrate it from boards, and find the pose of each capture."""

import hashlib
import json
import logging
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

import numpy as np
import pandas as pd
from pydantic import ValidationError
from tqdm import tqdm

import job
from effects.base import View
from inputs import tables
from inputs.baseline import MIN_CAPTURES
from inputs.campaign import CalibrationBoard, inside
from inputs.images import read_image
from inputs.photo_facts import a_few, focal_px, photo_facts
from inputs.safe_yaml import load_yaml, validation_message
from register import calibration
from register.board_checks import MIN_PHOTOGRAPHS, check_photographs, check_tilt
from register.finders import (
    board_views,
    by_trusted_finder,
    first_look,
    is_inverted,
    marker_finder,
    save_points,
    usable_views,
    views_of_markers,
)
from register.outcomes import register_board, register_markers
from register.registration import lens_of, prior_of
from rig.errors import InputError
from rig.geometry import camera_matrix, make_pose, split_pose

log = logging.getLogger("twingap")
IMAGES = (".png", ".jpg", ".jpeg", ".tif", ".tiff", ".heic", ".heif")
MAX_MESSAGES = 5
OF_BASELINE = "before_"  # begins the names of the rules that make a baseline's results (rules/baseline.smk)


def look_at_captures(campaign, captures, size, look, threads=1):
    """Open and check every image once; return ({capture: hash of its pixels}, {capture: look(capture, image)}).

    One message for all that is wrong with the images of a camera. On several ``threads`` looks must not share what they change.
    """
    problems, hashes, seen, first = [], {}, {}, {}

    def opened(c):
        try:
            image = read_image(inside(campaign, c.image, f"{campaign}: capture {c.capture}"), size)
        except InputError as error:
            return f"capture {c.capture}: {error}", None, None
        digest = hashlib.sha256(str((image.shape, image.dtype)).encode() + image.tobytes()).hexdigest()
        return None, digest, None if problems else look(c.capture, image)

    rows = list(captures.itertuples())
    with ThreadPoolExecutor(threads) as pool:
        work = zip(rows, pool.map(opened, rows), strict=True)
        for c, (problem, digest, looked) in tqdm(work, "registering captures", len(rows), unit="image", mininterval=5):
            if problem:
                problems.append(problem)
                continue
            if digest in first:
                name, path = first[digest]
                problems.append(f"captures {name} ({path}) and {c.capture} ({c.image}) are the same picture")
            first.setdefault(digest, (c.capture, c.image))
            hashes[c.capture], seen[c.capture] = digest, looked
    if problems:
        more = f" (and {len(problems) - MAX_MESSAGES} more)" if len(problems) > MAX_MESSAGES else ""
        raise InputError("; ".join(problems[:MAX_MESSAGES]) + more)
    return hashes, seen


def nominal_poses(captures, stations):
    """Return {capture: T_cam_world}, None where the pose is unknown."""
    poses = {}
    for c in captures.itertuples():
        pose = stations.loc[c.station, tables.POSE].to_numpy(float)
        poses[c.capture] = make_pose(pose[:3], pose[3:]) if np.isfinite(pose).all() else None
    return poses


def read_board(path):
    """Return the CalibrationBoard of a board.yaml; raises InputError naming file, key and value."""
    try:
        return CalibrationBoard.model_validate(load_yaml(path))
    except ValidationError as error:
        raise InputError(validation_message(path, error, CalibrationBoard)) from None


def calibration_views(campaign, camera, size, messages):
    """Return {file name: BoardPoints} of calibration/<camera>/, empty where there is no such folder, or no image in it.

    Raises InputError where the images do not show the board that is described, as of a campaign's own board.
    """
    folder = Path(campaign) / "calibration" / camera
    if not folder.is_dir():
        return {}
    where = inside(campaign, f"calibration/{camera}/board.yaml", f"{campaign}: board.yaml of {camera}")
    if not where.is_file():
        raise InputError(f"{where}: no such file, but images of a board need its description")
    board = read_board(where)
    names = sorted(p.name for p in folder.iterdir() if p.suffix.lower() in IMAGES)
    paths = {n: inside(campaign, f"calibration/{camera}/{n}", f"{folder}: image {n}") for n in names}
    look = first_look(names, board)
    found = {n: look(n, read_image(p, size)) for n, p in tqdm(paths.items(), desc="calibrating", mininterval=5)}
    if not found:
        messages.append(f"{where}: there is no image beside it")
        return {}
    least = calibration.MIN_VIEWS
    _, seen = views_of_board(found, board, lambda n: read_image(paths[n]), size, str(where), least, messages)
    return usable_views(seen)


def views_of_board(found, board, open_image, size, where, least, messages, threads=1):
    """Return (number of the finder to trust, {name: BoardPoints} by it) of a board's images, {name: [BoardPoints]} as of
    ``register.finders.first_look``.

    open_image is a function of a name, where the file and key of the board's description, for messages.
    Raises InputError where fewer than ``least`` show the board, or they show another one.
    """
    finder, seen = by_trusted_finder(found, open_image, board, size, messages, threads)
    seen = board_views(seen, board, map(open_image, found), where, messages)
    check_photographs(seen, board, open_image, where, least)
    return finder, seen


def calibrations(views, size, campaign, camera):
    """Return register.calibration.calibrate_all's fits; its InputError names the camera."""
    try:
        return calibration.calibrate_all(views, size)
    except InputError as error:
        raise InputError(f"{campaign}: camera {camera}: {error}") from None


def opener(campaign, captures):
    """Return a function of a capture's name that returns its image."""
    images = dict(zip(captures.capture, captures.image, strict=True))
    return lambda capture: read_image(Path(campaign) / images[capture])


def exif_focal_px(campaign, captures, size):
    """Return the focal length in pixels by the EXIF of a few of a camera's photographs, None where these say nothing."""
    said = (photo_facts(Path(campaign) / image)["focal_35mm"] for image in a_few(captures.image.tolist()))
    return next((focal_px(focal_35mm, size) for focal_35mm in said if focal_35mm), None)


def register_captures(
    expand, campaign, camera, out_csv, out_json, out_points=None, effects=(), least=MIN_PHOTOGRAPHS, threads=1
):
    """Check and register all captures of a camera; a designed experiment passes on its nominal intrinsics.

    expand is the folder of the tables; effects [(name, parameters)] of the twin that move points, behind which the poses are
    fitted, the intrinsics not; of a board at least so many photographs must be usable. Writes the table and the JSON that
    docs/register.md describes, and to ``out_points``, where given, a board's points in all captures. Raises InputError for
    captures that can't be what the tables say.
    """
    expand, messages = Path(expand), []
    facts = json.loads((expand / "scene.json").read_text())
    row = tables.read_table(expand / "cameras.csv", tables.CAMERAS).set_index("camera").loc[camera]
    size = int(row.width), int(row.height)
    known = None if np.isnan(row.fx) else [float(row[k]) for k in calibration.INTRINSICS]
    captures = tables.read_table(expand / "captures.csv", tables.CAPTURES)
    captures = captures[captures.camera == camera].sort_values("capture")
    stations = tables.read_table(expand / "stations.csv", tables.STATIONS)
    nominal = nominal_poses(captures, stations[stations.camera == camera].set_index("station"))
    hashes, outcomes, fits, inverted = {}, {}, {}, False
    if len(captures):
        folder_views = calibration_views(campaign, camera, size, messages)
        if facts["target"]:
            board = CalibrationBoard.model_validate(facts["target"])
            look = first_look(list(captures.capture), board)
            hashes, found = look_at_captures(campaign, captures, size, look, threads)
            where, open_image = f"{campaign}/campaign.yaml: target", opener(campaign, captures)
            finder, seen = views_of_board(found, board, open_image, size, where, least, messages, threads)
            views, register = usable_views(seen), register_board
            if out_points:
                with job.write_atomically(out_points, "wb") as file:
                    save_points(file, list(seen.values()), finder)
                number = sum(len(points.image) for points in seen.values())
                log.info("%s: %d points found in %d captures", camera, number, len(seen))
        else:
            markers = tables.read_table(expand / "markers.csv", tables.MARKERS)
            find = marker_finder(markers)
            hashes, seen = look_at_captures(campaign, captures, size, lambda _, image: find(image))
            views, register = views_of_markers(seen), register_markers
        fits = calibrations(folder_views or (views if facts["target"] else {}), size, campaign, camera)
        exif_px = None if known else exif_focal_px(campaign, captures, size)
        if known is None and facts["target"] and not folder_views:
            check_tilt(views, fits["5"], f"{campaign}/campaign.yaml: cameras.{camera}", exif_px)
        if inverted := is_inverted(views):
            messages.append("the twin's board has its black and white swapped too")
        known = known or calibration.ideal_intrinsics(views, folder_views, size, messages, exif_px)
        K, sigma = camera_matrix(*known), prior_of(facts["tolerance"])
        lens = lens_of(View(K, *size, 0, np.eye(4), camera, "", ""), effects)
        outcomes = {c: register(seen[c], K, nominal[c], sigma, lens) for c in captures.capture}
    known = known or calibration.guess(size)
    count = sum(outcome[0] == "registered" for outcome in outcomes.values())
    if count < len(captures):
        messages.append(f"{len(captures) - count} of {len(captures)} captures show no marker or board")
    for message in messages:
        log.info("%s: %s", camera, message)
    _write(captures, hashes, outcomes, out_csv)
    record = dict(zip(calibration.INTRINSICS, known, strict=True)) | {
        "calibrations": fits,
        "inverted": inverted,
        "views": count,
        "messages": messages,
    }
    with job.write_atomically(out_json) as file:
        json.dump(record, file, indent=1, sort_keys=True)


def _write(captures, hashes, outcomes, out_csv):
    rows = []
    for c in captures.itertuples():
        status, n, rms, T, se = outcomes[c.capture]
        pose = np.concatenate(split_pose(T)) if T is not None else np.full(6, np.nan)
        rows.append([c.capture, c.station, c.trial, status, hashes[c.capture], n, rms, *pose, *se])
    tables.write_table(pd.DataFrame(rows, columns=list(tables.REGISTERED.columns)), out_csv, tables.REGISTERED)


def least_usable(rule, baseline):
    """Return how many photographs of a board a rule must find usable, in a run with a baseline's folder or None.

    It is no parameter of the rule: a campaign's results are the same alone and compared, and would all be made again.
    """
    return MIN_CAPTURES if baseline or rule.startswith(OF_BASELINE) else MIN_PHOTOGRAPHS


if __name__ == "__main__":
    job.run(
        register_captures,
        snakemake,
        expand=Path(snakemake.input.scene).parent,
        campaign=snakemake.params.campaign,
        camera=snakemake.wildcards.camera,
        out_csv=snakemake.output.table,
        out_json=snakemake.output.intrinsics,
        out_points=snakemake.output.observations or None,
        effects=[(n, p) for n, p in snakemake.params.effects],
        least=least_usable(snakemake.rule, snakemake.config["baseline"]),
        threads=snakemake.threads,
    )
