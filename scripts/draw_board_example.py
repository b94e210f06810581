"""Draw a photograph of a board beside its twin, before and after the effects that were found: the report's first picture.

As diagnose_camera does for rigs: ``example_real.png``, ``example_configured.png``, ``example_explained.png``, here of the board's
part of the photograph. The twins are Blender's render of that photograph, moved along the board's plane to the pose that fits the
points best with these effects, in the light, where nobody declared it, in which this twin shows what the photograph does.
"""

import json
from dataclasses import replace
from pathlib import Path

import cv2
import numpy as np

import job
from effects import library, pipeline
from effects.base import View
from effects.library import effect_named
from gap.boards.capture_light import photograph_light
from gap.problem import encoding_table
from inputs import tables
from inputs.campaign import CalibrationBoard, inside
from inputs.images import read_image
from inputs.render_store import read_station
from inputs.scene import load_scene
from register.boards import MIN_POINTS
from register.finders import board_finders
from register.registration import NO_PRIOR, lens_of, register_pose
from rig.errors import InputError
from rig.geometry import camera_matrix, make_pose
from rig.light import BoardPlace, free_numbers, in_own_light

NAMES = ("real", "configured", "explained")
MARGINS = (0.25, 0.6)  # of the longer side, beyond the frame: a lens may look so far
AROUND = 0.06  # of the board, kept beside it


def twins_of(verdict):
    """Return (effects as configured, effects with what was found) of a verdict's record, without those of the scene."""
    configured = [(e["effect"], e["parameters"]) for e in verdict.get("configured", [])]
    found = dict(configured) | verdict.get("nuisances", {})
    for step in verdict["steps"]:
        found[step["effect"]] = {k: p["value"] for k, p in step["parameters"].items()}
    return tuple(
        [(n, p) for n, p in effects if effect_named(n).STAGE != "scene"] for effects in (configured, found.items())
    )


def registered_view(view, points, effects):
    """Return the View at the pose that takes a board's points (BoardPoints) to the photograph's best behind effects."""
    lens = lens_of(view, effects)
    T, _, _ = register_pose(points.board, points.image, view.K, view.T_cam_world, NO_PRIOR, lens)
    return replace(view, T_cam_world=T)


def drawn(radiance, margin, view, moved, effects, lit):
    """Return the twin (H, W, C) of a moved View from a render (rows, columns) of another pose: the board's plane is z = 0.

    ``lit`` (radiance, View with margin) gives it the photograph's own light.
    """
    H = moved.K @ moved.T_cam_world[:3, [0, 1, 3]] @ np.linalg.inv(view.K @ view.T_cam_world[:3, [0, 1, 3]])
    for share in MARGINS:
        wide = round(share * max(view.width, view.height))
        to, back = np.eye(3), np.eye(3)
        to[:2, 2], back[:2, 2] = wide, -margin
        size = view.width + 2 * wide, view.height + 2 * wide
        seen = cv2.warpPerspective(
            radiance, to @ H @ back, size, flags=cv2.INTER_CUBIC, borderMode=cv2.BORDER_REPLICATE
        )
        try:
            wider = replace(moved, margin=wide)
            return pipeline.form_image(lit(seen, wider), wider, effects, None)
        except InputError:  # the lens looks farther
            if share == MARGINS[-1]:
                raise
    return None


def board_part(points, size):
    """Return (rows, columns), slices, of a board's part of a photograph of a size (width, height)."""
    low, high = points.image.min(axis=0), points.image.max(axis=0)
    around = AROUND * (high - low).max()
    (x0, y0), (x1, y1) = np.maximum(low - around, 0).astype(int), np.minimum(high + around, size).astype(int)
    return slice(y0, y1), slice(x0, x1)


def in_its_light(twin, effects, photograph, facts, scene, points):
    """Return the image of a ``twin`` (function of what gives a render its light) in a photograph's (H, W, 3) own light, behind
    its effects [(name, parameters)].

    In the nominal light where a campaign's ``facts`` leave nothing open, or too little of the board is seen.
    """
    free, place = free_numbers(facts["left_open"]), BoardPlace(scene.plates[0])

    def lit(light):
        return twin(lambda radiance, view: in_own_light(radiance, light, view, place))

    lut = encoding_table(facts["encoding"], float(facts["exposure"]))
    behind = lit if library.change_levels(effects) else None
    try:
        if free.any():
            return lit(photograph_light(photograph, scene, points.board, points.image, lut, free, behind))
    except ValueError:
        pass  # too little of the board is seen
    return twin(lambda radiance, view: radiance)


def draw_board_example(expand, register_csv, register_json, manifest, campaign, camera, verdict, out):
    """Write the three images, a path each in ``out`` by NAMES; black squares where no photograph shows the board.

    The photograph is the one of those held out that the ideal pinhole fits worst.
    """
    expand = Path(expand)
    facts = json.loads((expand / "scene.json").read_text())
    verdict, record = (json.loads(Path(p).read_text()) for p in (verdict, manifest))
    registered = tables.read_table(register_csv, tables.REGISTERED)
    held = registered[registered.capture.isin(verdict.get("held_out", [])) & (registered.status == "registered")]
    row = held.loc[held.rms_px.idxmax()] if len(held) else None
    images = [np.zeros((8, 8, 3))] * 3 if row is None else _images(
        facts, register_json, manifest, record, expand, campaign, camera, row, twins_of(verdict),
    )  # fmt: skip
    for name, image in zip(NAMES, images, strict=True):
        pixels = np.clip(np.rint(image), 0, 255).astype(np.uint8)[..., ::-1]
        with job.write_atomically(out[name], "wb") as file:
            file.write(cv2.imencode(".png", pixels)[1].tobytes())


def _images(facts, register_json, manifest, record, expand, campaign, camera, row, twins):
    """Return the photograph's board part and the two twins' (H, W, 3), red first."""
    captures = tables.read_table(expand / "captures.csv", tables.CAPTURES).set_index("capture")
    intrinsics = json.loads(Path(register_json).read_text())
    K = camera_matrix(*(intrinsics[k] for k in ("fx", "fy", "cx", "cy")))
    image = read_image(inside(campaign, captures.image[row.capture], f"{campaign}: capture {row.capture}"))
    real = (image // 257 if image.dtype == np.uint16 else image).astype(float)
    real = np.repeat(real[..., None], 3, axis=2) if real.ndim == 2 else real[..., ::-1]
    entry = record["stations"][row.station]
    radiance, margin = read_station(Path(manifest).parent, entry)
    size = real.shape[1], real.shape[0]
    T = make_pose(entry["pose"][:3], entry["pose"][3:])
    view = View(K, *size, 0, T, camera, row.capture, row.station, float(facts["exposure"]), facts["encoding"])
    finders = board_finders(CalibrationBoard.model_validate(facts["target"]))
    points = max((find(image) for find in finders), key=lambda p: len(p.image))
    if len(points.image) < MIN_POINTS:
        return [np.zeros((8, 8, 3))] * 3
    scene = load_scene(expand, register_json)

    def image_of(effects):
        moved = registered_view(view, points, effects)
        return in_its_light(
            lambda lit: drawn(radiance, margin, view, moved, effects, lit), effects, real, facts, scene, points
        )

    drawn_twins = [image_of(effects) for effects in twins]
    part = board_part(points, size)
    return [np.broadcast_to(i, real.shape)[part] for i in (real, *drawn_twins)]


if __name__ == "__main__":
    job.run(
        draw_board_example,
        snakemake,
        expand=Path(snakemake.input.scene).parent,
        register_csv=snakemake.input.register,
        register_json=snakemake.input.register_json,
        manifest=snakemake.input.manifest,
        campaign=snakemake.params.campaign,
        camera=snakemake.wildcards.camera,
        verdict=snakemake.input.verdict,
        out=dict(zip(NAMES, snakemake.output.example, strict=True)),
    )
