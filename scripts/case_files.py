"""Between files and the gap library: one camera's case from the expand and register tables, its observations as npz."""

import json
from dataclasses import replace
from pathlib import Path

import cv2
import numpy as np

from effects import library
from effects.base import View
from gap.boards.board import board_case, local_noise_px, without_alternation, without_pixel_locking
from gap.boards.photographs import photographs_case
from gap.fit.split import usable
from gap.measure.capture import Codes, Observation, read_rgb
from gap.observables import N_FEATURES
from gap.problem import MARGIN_PX, Capture, Case, encoding_table
from gap.signatures.signature import MIN_PATCHES
from gap.signatures.signature_case import SignatureCase, is_seen_in_cells, seen_patches, twin_photograph
from inputs import tables
from inputs.campaign import CalibrationBoard
from inputs.images import read_image
from inputs.scene import load_scene
from register.board_checks import MIN_PHOTOGRAPHS, what_it_takes
from register.boards import MIN_POINTS
from register.calibration import NAMES, matrix_of
from register.registration import NO_PRIOR, pose_from_plane, prior_of
from rig.errors import InputError
from rig.geometry import N_POSE, camera_matrix, make_pose, perturb_pose
from rig.light import free_numbers
from rig.patches import CHECKERED, board_patches

PATCHES = 6  # of a photograph, that its signature is measured in
SIGMA_OWN = 1.0  # of a capture's own exposure, gains and slopes of light (1/m) about their null
OBSERVED = ("features", "information", "measured", "colour", "field", "field_n", "noise", "noise_se", "regions")


def load_case(expand, register_json, camera):
    """Return (Case, captures' table) of one camera, nothing measured yet.

    expand is the folder of the expand tables. Raises InputError where the campaign has no captures.
    """
    facts, captures, views = load_views(expand, register_json, camera)
    scene = load_scene(expand, register_json)
    lut = encoding_table(views[0].encoding, views[0].exposure)
    codes = Codes.of(scene.plates, [scene.white, scene.black, scene.ground], lut)
    made = [Capture(view, int(trial)) for view, trial in zip(views, captures.trial, strict=True)]
    own = tuple(library.own_where_open(facts["left_open"]))
    sigma_pose = np.concatenate([prior_of(facts["tolerance"]), np.full(len(own), SIGMA_OWN)])
    nuisances = tuple((n, library.nulls_of(n)) for n in library.shared_where_open(facts["left_open"]))
    return Case(facts["name"], camera, scene, codes, made, sigma_pose, own, nuisances), captures


def load_views(expand, register_json, camera):
    """Return (facts of scene.json, captures' table of a camera, [effects.base.View] of its rows at nominal poses, NaN where
    they are unknown); as ``load_case``. Of markers an unknown pose is the registered one, in whose table it lies beside
    register_json.
    """
    expand = Path(expand)
    facts = json.loads((expand / "scene.json").read_text())
    intrinsics = json.loads(Path(register_json).read_text())
    size = tables.read_table(expand / "cameras.csv", tables.CAMERAS).set_index("camera").loc[camera]
    captures = tables.read_table(expand / "captures.csv", tables.CAPTURES)
    captures = captures[captures.camera == camera].sort_values("capture")
    if captures.empty:
        raise InputError(f"{expand}/captures.csv: camera {camera} has no captures; a diagnosis needs photographs")
    stations = tables.read_table(expand / "stations.csv", tables.STATIONS)
    stations = stations[stations.camera == camera].set_index("station")
    K = camera_matrix(*(float(intrinsics[k]) for k in ("fx", "fy", "cx", "cy")))
    poses = stations.loc[captures.station, tables.POSE].to_numpy(float)
    unknown = ~np.isfinite(poses).all(1)
    if unknown.any() and not facts["target"]:
        registered = tables.read_table(Path(register_json).with_suffix(".csv"), tables.REGISTERED).set_index("capture")
        poses[unknown] = registered.loc[captures.capture[unknown], tables.POSE].to_numpy(float)
    views = []
    for row, pose in zip(captures.itertuples(), poses, strict=True):
        T = make_pose(pose[:3], pose[3:]) if np.isfinite(pose).all() else np.full((4, 4), np.nan)
        views.append(
            View(
                K, int(size.width), int(size.height), MARGIN_PX, T, camera, row.capture, row.station,
                float(facts["exposure"]), facts["encoding"], float(facts["noise_dn"]),
            )
        )  # fmt: skip
    return facts, captures, views


def load_measured(expand, register_json, camera, observations, least=MIN_PHOTOGRAPHS):
    """Return the measured problem of one camera: a gap.problem.Case, of a board a board.BoardCase.

    Raises ValueError where fewer photographs than ``least`` show the board.
    """
    if not json.loads((Path(expand) / "scene.json").read_text())["target"]:
        case, _ = load_case(expand, register_json, camera)
        load_observations(observations, case)
        return case
    facts, captures, views = load_views(expand, register_json, camera)
    with np.load(observations) as stored:
        points, pixels = stored["points"], stored["pixels"]
    sigma_pose = prior_of(facts["tolerance"])
    seen = np.isfinite(pixels).all(2)
    enough = seen.sum(1) >= MIN_POINTS
    if (number := int(enough.sum())) < least:
        raise ValueError(f"{number} of {len(enough)} photographs show the board, and {what_it_takes(number, least)}")
    if not np.isfinite([view.T_cam_world for view in views]).all():
        sigma_pose = NO_PRIOR
        views = [
            replace(v, T_cam_world=pose_from_plane(points[k], xy[k], v.K) if ok else np.eye(4))
            for v, xy, k, ok in zip(views, pixels, seen, enough, strict=True)
        ]
    pixels = np.where(enough[:, None, None], pixels, np.nan)
    is_checkered = facts["target"]["type"] in CHECKERED
    if is_checkered:
        pixels = without_alternation(points, pixels, facts["target"]["square_m"])
    pixels = without_pixel_locking(points, pixels, without_lens(pixels, register_json))
    row = tables.read_table(Path(expand) / "cameras.csv", tables.CAMERAS).set_index("camera").loc[camera]
    noise_px = local_noise_px(points, without_lens(pixels, register_json), int(is_checkered))
    return board_case(
        facts["name"],
        camera,
        load_scene(expand, register_json),
        views,
        captures.trial,
        points,
        pixels,
        noise_px,
        np.isfinite(row.fx),
        sigma_pose,
    )


def save_patches(file, photographs, lights):
    """Write what signature.Photographs show of their patches, at most PATCHES of each, and their LIGHT (n, 11), NaN where it
    is unknown, to an open npz file.
    """
    n = len(photographs)
    plates, features = np.full((n, PATCHES), -1), np.full((n, PATCHES, N_FEATURES), np.nan)
    for k, photograph in enumerate(photographs):
        plates[k, : len(photograph.plates)] = photograph.plates
        features[k, : len(photograph.plates)] = photograph.features
    signs = np.array([p.signature() for p in photographs])
    channels = np.array([p.image.shape[2] for p in photographs])
    np.savez_compressed(file, plates=plates, features=features, signs=signs, lights=lights, channels=channels)


def load_patches(expand, register_json, camera, patches, points, twin, declared):
    """Return the SignatureCase of what was measured in ``patches``, a file; poses and lens are those of a twin of the BoardCase
    ``points``; declared {capture: effects [(name, parameters)]} are what photographs' files say of themselves.

    Raises ValueError where too few photographs show patches.
    """
    drawn = load_photographs(expand, register_json, camera)
    with np.load(patches) as stored:
        arrays = dict(stored)
    showing = ((arrays["plates"] >= 0).sum(1) >= MIN_PATCHES) & np.isfinite(arrays["lights"]).all(1)
    chosen = usable(np.flatnonzero(showing), points)  # others have no pose
    if len(chosen) < MIN_PHOTOGRAPHS:
        raise ValueError("too few photographs show the board's cells, white and black, at a size that can be measured")
    given = [(n, p) for n, p in twin.effects if not is_seen_in_cells(n)]
    free = free_numbers(json.loads((Path(expand) / "scene.json").read_text())["left_open"])
    captures, twins = [], []
    for i in chosen:
        theirs = points.captures[i].view
        view = replace(theirs, T_cam_world=perturb_pose(theirs.T_cam_world, twin.poses[i, :N_POSE]))
        kept = arrays["plates"][i] >= 0
        plates, features = arrays["plates"][i][kept], arrays["features"][i][kept]
        captures.append(Capture(view, points.captures[i].trial, seen_patches(len(drawn.patches), plates, features)))
        in_colour = bool(arrays["channels"][i] > 1)
        own = declared.get(view.capture, ())
        twins.append(twin_photograph(drawn, view, given, arrays["lights"][i], plates, features, in_colour, own))
    return SignatureCase(drawn.campaign, camera, captures, twins, arrays["signs"][chosen], free, drawn, tuple(given))


def load_photographs(expand, register_json, camera):
    """Return the PhotographsCase of one camera's photographs of a board by its patches, nothing measured yet."""
    facts, captures, views = load_views(expand, register_json, camera)
    made = [Capture(view, int(trial)) for view, trial in zip(views, captures.trial, strict=True)]
    scene = load_scene(expand, register_json)
    patches = board_patches(CalibrationBoard.model_validate(facts["target"]), scene.plates[0])
    return photographs_case(facts["name"], camera, scene, made, patches)


def without_lens(pixels, register_json):
    """Return pixels (..., 2) as a camera without distortion would have them, by the camera's calibration where it has one."""
    fit = json.loads(Path(register_json).read_text())["calibrations"].get("5")
    if fit is None:
        return pixels
    K, distortion = matrix_of(fit), np.array([fit["parameters"][k] for k in NAMES[4:9]])
    return cv2.undistortPoints(pixels.reshape(-1, 1, 2), K, distortion, P=K).reshape(pixels.shape)


def read_capture(campaign, image):
    """Return an image (H, W, C) of grey levels, float32, red first; raises InputError where it can't be read."""
    pixels = read_image(Path(campaign) / image)
    return read_rgb(pixels[..., :3] if pixels.ndim == 3 else pixels)


def save_observations(file, case):
    """Write what was measured in all captures to an open npz file; the same bytes for the same numbers."""
    arrays = {name: np.stack([getattr(c.observation, name) for c in case.captures]) for name in OBSERVED}
    arrays["noise_variance"] = np.array([c.noise_variance for c in case.captures])
    arrays["starts"] = np.array([json.dumps(c.starts, sort_keys=True) for c in case.captures])
    np.savez_compressed(file, **arrays)


def join_observations(paths, file):
    """Write the observations of a camera's parts, in their order, to an open npz file as those of the whole."""
    parts = []
    for path in paths:
        with np.load(path) as stored:
            parts.append(dict(stored))
    np.savez_compressed(file, **{name: np.concatenate([part[name] for part in parts]) for name in parts[0]})


def load_observations(path, case):
    """Put what ``save_observations`` wrote back into the case's captures."""
    with np.load(path) as stored:
        arrays = dict(stored)
    for i, capture in enumerate(case.captures):
        values = {name: arrays[name][i] for name in OBSERVED}
        capture.observation = Observation(**values)
        capture.noise_variance = float(arrays["noise_variance"][i])
        capture.starts = json.loads(str(arrays["starts"][i]))
