"""Between files and the gap library: one camera's case from the expand and register tables, its observations as npz."""

import json
from pathlib import Path

import numpy as np

from effects.base import View
from gap.measure.capture import Codes, Observation, read_rgb
from gap.problem import MARGIN_PX, Capture, Case, encoding_table
from inputs import tables
from inputs.images import read_image
from inputs.scene import load_scene
from register.registration import prior_of
from rig.errors import InputError
from rig.geometry import camera_matrix, make_pose

OBSERVED = (
    "features",
    "information",
    "measured",
    "misfit",
    "colour",
    "field",
    "field_n",
    "noise",
    "noise_se",
    "regions",
)


def load_case(expand, register_json, camera):
    """Return (Case, captures' table) of one camera, nothing measured yet.

    expand is the folder of the expand tables. Raises InputError where the campaign has no markers (boards have a
    way of their own) or the camera no intrinsics.
    """
    expand = Path(expand)
    facts = json.loads((expand / "scene.json").read_text())
    scene = load_scene(expand)
    intrinsics = json.loads(Path(register_json).read_text())
    size = tables.read_table(expand / "cameras.csv", tables.CAMERAS).set_index("camera").loc[camera]
    captures = tables.read_table(expand / "captures.csv", tables.CAPTURES)
    captures = captures[captures.camera == camera].sort_values("capture")
    stations = tables.read_table(expand / "stations.csv", tables.STATIONS)
    stations = stations[stations.camera == camera].set_index("station")
    K = camera_matrix(*(float(intrinsics[k]) for k in ("fx", "fy", "cx", "cy")))
    exposure, encoding, noise_dn = float(facts["exposure"]), facts["encoding"], float(facts["noise_dn"])
    codes = Codes.of(scene.plates, [scene.white, scene.black, scene.ground], encoding_table(encoding, exposure))
    made = []
    for row in captures.itertuples():
        s = stations.loc[row.station]
        T = make_pose([s.rx, s.ry, s.rz], [s.tx, s.ty, s.tz])
        view = View(
            K,
            int(size.width),
            int(size.height),
            MARGIN_PX,
            T,
            camera,
            row.capture,
            row.station,
            exposure,
            encoding,
            noise_dn,
        )
        made.append(Capture(view, int(row.trial)))
    if not made:
        raise InputError(f"{expand}/captures.csv: camera {camera} has no captures; a diagnosis needs photographs")
    case = Case(facts["name"], camera, scene, codes, made, prior_of(facts["tolerance"]))
    return case, captures


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
            parts.append({name: stored[name] for name in stored.files})
    np.savez_compressed(file, **{name: np.concatenate([part[name] for part in parts]) for name in parts[0]})


def load_observations(path, case):
    """Put what ``save_observations`` wrote back into the case's captures."""
    with np.load(path) as stored:
        arrays = {name: stored[name] for name in (*OBSERVED, "noise_variance", "starts")}
    for i, capture in enumerate(case.captures):
        values = {name: arrays[name][i] for name in OBSERVED}
        capture.observation = Observation(**values)
        capture.noise_variance = float(arrays["noise_variance"][i])
        capture.starts = json.loads(str(arrays["starts"][i]))
