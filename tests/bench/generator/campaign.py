"""One campaign: the plates as they really stand, every capture formed and written, the truth sealed in a folder
of its own.
"""

import json
from pathlib import Path

import numpy as np
from PIL import Image
from scipy.spatial.transform import Rotation

from generator import left_open as left_open_effects
from generator import light, nominal, optics, processing, rays, sensor, tracer
from generator.vocabulary import LIBRARY, OUTSIDE, library_parameters


def true_plates(rig, effects, seed_name):
    """Return what stands on a ``nominal.Rig``: rotations (P, 3, 3) plate to world, centres (P, 3) m, cells (P, 7, 7),
    to_code (P, 2, 3).

    ``to_code`` takes plate metres (x right, y up) to module coordinates (u right, v down), through the
    print's errors.
    """
    rng = nominal.rng_of("plates", seed_name)
    rotations, centres, cells, to_code = [], [], [], []
    for m in rig.plates:
        rotation, centre = np.eye(3), np.array([m["x"], m["y"], 0.0])
        if p := effects.get("rail_sag"):
            # Arc of a circle over the chord y_start .. y_end; each plate lies along it.
            middle, half = (p["y_start_m"] + p["y_end_m"]) / 2, (p["y_end_m"] - p["y_start_m"]) / 2
            depth = abs(p["sag_m"])
            radius = (half**2 + depth**2) / (2 * depth)
            d = m["y"] - middle
            z = np.sign(p["sag_m"]) * (radius - depth - np.sqrt(radius**2 - d**2))
            slope = np.arctan2(np.sign(p["sag_m"]) * d, np.sqrt(radius**2 - d**2))
            centre, rotation = centre + np.array([0, 0, z]), Rotation.from_rotvec([slope, 0, 0]).as_matrix()
        if p := effects.get("plate_tilt_jitter"):
            turn = np.radians(p["angle_deg"]) * rng.standard_normal(3)
            rotation = rotation @ Rotation.from_rotvec(turn).as_matrix()
        side = m["code_m"] * effects.get("marker_scale", {"scale": 1.0})["scale"]
        skew = effects.get("print_skew", {"shear": 0.0, "stretch": 0.0})
        printed = np.array([[1 - skew["stretch"] / 2, skew["shear"]], [0.0, 1 + skew["stretch"] / 2]]) * side
        inverse = np.linalg.inv(printed) * nominal.MODULES
        middle = nominal.MODULES / 2
        to_code.append(np.column_stack([inverse * [[1], [-1]], [middle, middle]]))
        rotations.append(rotation)
        centres.append(centre)
        cells.append(nominal.black_modules(m["dictionary"], m["id"]))
    return np.array(rotations), np.array(centres), np.array(cells), np.array(to_code)


def plate_maps(plates, row_rotations, row_centres):
    """Return maps (P, n, 3, 3) from camera directions to plate metres and the camera's centre in plates'
    frames (P, 3).
    """
    rotations, centres = plates[0], plates[1]
    axes = np.einsum("nij,pjk->pnik", row_rotations, rotations[:, :, :2])
    offset = np.einsum("nij,pnj->pni", row_rotations, centres[:, None] - row_centres[None])
    middle = row_centres[len(row_centres) // 2]
    eyes = np.einsum("pji,pj->pi", rotations, middle - centres)
    return np.linalg.inv(np.concatenate([axes, offset[..., None]], axis=-1)), eyes


def trace_capture(rig, camera, plates, grids, rotation, centre, effects, margin, fine):
    """Return linear light (H, W, 1 or 3) under the lens's spreads, ``margin`` pixels around the frame."""
    poses = rays.row_poses(rotation, centre, camera, effects, margin, fine)
    maps, eyes = plate_maps(plates, *poses)
    up = np.ascontiguousarray(poses[0][:, :, 2])
    ink = effects.get("ink_reflectance", rig.reflectance)
    levels = np.array([ink["white"], ink["black"]] + [rig.reflectance[k] for k in ("ground", "background")])
    side = rig.code_m * effects.get("marker_scale", {"scale": 1.0})["scale"]
    spread = effects.get("ink_spread", {"spread_m": 0.0})["spread_m"] * nominal.MODULES / side
    curl = effects.get("plate_curl", {"rise_m": 0.0, "axis": 0})
    rises = np.full(len(plates[0]), curl["rise_m"])
    net = tracer.SUBPIXEL_NET if fine > 1 else tracer.PIXEL_NET
    channels = []
    for dx, dy in grids:
        radiance, cover = tracer.trace(
            dx,
            dy,
            up,
            maps,
            eyes,
            plates[2],
            rig.plate_m / 2,
            plates[3],
            spread,
            rises,
            curl["axis"],
            levels,
            net,
            4 * fine,
        )
        radiance = light.shade(radiance, cover, dx, dy, rotation, centre, effects)
        if fine > 1:
            depth = light.ground_hits(dx, dy, rotation, centre)[2] if "defocus" in effects else None
            radiance = optics.spread(radiance, depth, camera, effects, margin)
        channels.append(radiance)
    return np.stack(channels, -1)


class CampaignCamera:
    """A camera, its hidden effects and what all captures share: bent rays, true plates, the fixed pattern's
    seed.
    """

    def __init__(self, camera, effects, seed_name, left_open=(), rig=nominal.RIGS["standard"]):
        effects = left_open_effects.shared_effects(left_open, seed_name) | effects
        self.camera, self.effects, self.seed_name, self.left_open = camera, effects, seed_name, left_open
        self.rig = rig
        self.fine = optics.FINE if effects.keys() & set(optics.SPREADS) else 1
        self.margin = optics.margin_of(camera, effects)
        channels = (0, 1, 2) if "lateral_chromatic_aberration" in effects else (1,)
        self.grids = [rays.corner_grid(camera, effects, c, self.margin, self.fine) for c in channels]
        self.plates = true_plates(rig, effects, seed_name)
        self.order = processing.drawn_order(effects, seed_name)

    def effects_of(self, capture):
        """Return the effects of one capture: the camera's, and what it has for itself where the campaign leaves that open."""
        return self.effects | left_open_effects.own_effects(self.left_open, self.seed_name, capture)

    def linear_light(self, rotation, centre, effects=None):
        """Return linear light on the sensor (H, W, 1 or 3), noise-free, of a camera at ``rotation``
        (R_cam_world), ``centre`` m; ``effects`` are the camera's where None.
        """
        effects = self.effects if effects is None else effects
        rotation, centre = rays.capture_pose(rotation, centre, effects)
        image = trace_capture(
            self.rig, self.camera, self.plates, self.grids, rotation, centre, effects, self.margin, self.fine
        )
        image = optics.stray_light(image, self.camera, effects, self.margin)
        m = self.margin
        return image[m : m + self.camera.height, m : m + self.camera.width]

    def photograph(self, rotation, centre, capture):
        """Return the 8-bit RGB image (H, W, 3) of one capture; its noise is seeded by the capture's name."""
        shared = nominal.rng_of("sensor", self.seed_name)
        own = nominal.rng_of("noise", self.seed_name, capture)
        effects = self.effects_of(capture)
        encoded = sensor.read_out(self.linear_light(rotation, centre, effects), self.camera, effects, shared, own)
        noise = own.standard_normal(encoded.shape, dtype=np.float32)
        return processing.process(encoded + self.rig.noise_dn * noise, effects, self.order)


def _captures(rig, camera, stations, seed_name):
    """Yield (capture, height_m, tilt_deg, trial, R_cam_world, centre, pose error) with the tolerance drawn
    per capture.
    """
    for height, tilt in stations:
        for trial in range(rig.trials):
            capture = f"{camera.name}_h{round(height * 100):03d}_t{tilt}_r{trial}"
            rng = nominal.rng_of("pose", seed_name, capture)
            shift = rig.tolerance_position_m * rng.standard_normal(3)
            turn = rig.tolerance_angle_deg * rng.standard_normal(3)
            rotation = Rotation.from_rotvec(turn, degrees=True).as_matrix() @ nominal.station_rotation(tilt)
            yield capture, height, tilt, trial, rotation, np.array([0.0, 0.0, height]) + shift, (shift, turn)


def _write_tables(folder, rig, camera, captures, left_open):
    lines = ["dictionary,id,code_m,plate_m,x,y,z,rx,ry,rz"]
    lines += [
        f"{m['dictionary']},{m['id']},{m['code_m']},{m['plate_m']},{m['x']},{m['y']},0.0,0.0,0.0,0.0"
        for m in rig.plates
    ]
    (folder / "markers.csv").write_text("\n".join(lines) + "\n", encoding="utf-8")
    lines = ["capture,camera,height_m,tilt_deg,trial,image"]
    lines += [f"{c},{camera.name},{h},{t},{r},images/{camera.name}/{c}.png" for c, h, t, r, *_ in captures]
    (folder / "captures.csv").write_text("\n".join(lines) + "\n", encoding="utf-8")
    declared = {"exposure": "1.0", "reflectance": "".join(f"\n  {k}: {v}" for k, v in rig.reflectance.items())}
    declared |= {what: left_open_effects.WORDS[what] for what in left_open}
    declared = "".join(f"{what}: {value}\n" for what, value in declared.items())
    text = (
        f"schema: 1\nname: {folder.name}\norigin: simulated\nmarkers: markers.csv\ncaptures: captures.csv\n"
        f"cameras:\n  {camera.name}:\n    width: {camera.width}\n    height: {camera.height}\n"
        f"    fx: {camera.fx}\n    fy: {camera.fx}\n    cx: {camera.cx}\n    cy: {camera.cy}\n"
        f"{declared}encoding: srgb\nnoise_dn: {rig.noise_dn}\ntolerance:\n"
        f"  position_m: {rig.tolerance_position_m}\n  angle_deg: {rig.tolerance_angle_deg}\n"
    )
    # Last of all: a folder whose making was cut short has no campaign.yaml.
    (folder / "campaign.yaml").write_text(text, encoding="utf-8")


def generate_campaign(
    folder, truth_folder, effects, seed_name, size="standard", camera=None, notes=None, stations=None, left_open=()
):
    """Generate one campaign in ``folder`` (its name becomes the campaign's) and its sealed truth in
    ``truth_folder``/truth.json.

    ``effects``: list of (name, parameters in this generator's units, see ``draw_effect``). ``size``:
    one of ``nominal.RIGS``.
    ``camera``: a name among that size's cameras (default: the first). ``notes``: further keys of the
    truth. ``stations``: [(height_m, tilt_deg)], whole degrees, instead of that size's. ``left_open``: of light, exposure,
    white_balance and reflectance what the campaign does not declare and each capture has for itself. Same arguments, same bytes.
    """
    folder, truth_folder = Path(folder), Path(truth_folder)
    if unknown := [name for name, _ in effects if name not in LIBRARY and name not in OUTSIDE]:
        raise ValueError(f"no such effects: {unknown}; allowed: {[*LIBRARY, *OUTSIDE]}")
    rig = nominal.RIGS[size]
    cameras = {c.name: c for c in rig.cameras}
    camera = cameras[camera] if camera else rig.cameras[0]
    (folder / "images" / camera.name).mkdir(parents=True, exist_ok=True)
    truth_folder.mkdir(parents=True, exist_ok=True)
    made = CampaignCamera(camera, dict(effects), seed_name, left_open, rig)
    captures = list(_captures(rig, camera, stations or rig.stations, seed_name))
    for capture, _, _, _, rotation, centre, _ in captures:
        image = made.photograph(rotation, centre, capture)
        Image.fromarray(image).save(folder / "images" / camera.name / f"{capture}.png", compress_level=1)
    _write_tables(folder, rig, camera, captures, left_open)
    truth = {
        "campaign": folder.name,
        "camera": camera.name,
        "size": size,
        "seed_name": seed_name,
        **(notes or {}),
        "effects": [
            {
                "effect": name,
                "in_library": name in LIBRARY,
                "parameters": parameters,
                "library_parameters": library_parameters(name, parameters, camera),
            }
            for name, parameters in effects
        ],
        "order": made.order,
        "poses": {
            c: {"centre_error_m": list(map(float, e[0])), "rotvec_error_cam_deg": list(map(float, e[1]))}
            for c, *_, e in captures
        },
    }
    (truth_folder / "truth.json").write_text(json.dumps(truth, indent=1) + "\n", encoding="utf-8")
    return truth
