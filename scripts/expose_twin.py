"""Expose: from linear renders to the twin's 8-bit images, one a capture, through the camera's effects.

Trials of a station share its render; each has noise of its own, seeded by campaign, camera and capture. The twin of a photograph
of a board has the photograph's own light, where nobody declared it, and what its file says was done to it, as a JPEG's tables do.
"""

import json
import logging
from dataclasses import replace
from pathlib import Path

import cv2
import numpy as np
from tqdm import tqdm

import job
from declared_effects import declared_of
from effects import pipeline
from effects.base import View
from inputs import tables
from inputs.render_store import read_station
from inputs.scene import load_scene
from rig.geometry import camera_matrix, make_pose
from rig.light import BoardPlace, in_own_light
from whole_folder import whole_folder

log = logging.getLogger("twingap")


def views_of(expand, register_json, camera, poses):
    """Yield (capture name, View without margin) of all captures of a camera, of its stations where there are none."""
    facts = json.loads((expand / "scene.json").read_text())
    sizes = tables.read_table(expand / "cameras.csv", tables.CAMERAS).set_index("camera").loc[camera]
    intrinsics = json.loads(Path(register_json).read_text())
    K = camera_matrix(*(intrinsics[k] for k in ("fx", "fy", "cx", "cy")))
    captures = tables.read_table(expand / "captures.csv", tables.CAPTURES)
    captures = captures[captures.camera == camera].sort_values("capture")
    named = list(zip(captures.capture, captures.station, strict=True)) or [(s, s) for s in poses]
    for capture, station in named:
        if station not in poses:
            log.info("%s: no pose is known, so it has no twin image", capture)
            continue
        yield capture, View(
            K, int(sizes.width), int(sizes.height), 0, poses[station], camera, capture, station,
            float(facts["exposure"]), facts["encoding"], float(facts["noise_dn"]),
        )  # fmt: skip


def rendered_poses(record):
    """Return {station: T_cam_world (4, 4)} of a manifest's record: poses that were rendered."""
    return {s: make_pose(e["pose"][:3], e["pose"][3:]) for s, e in record["stations"].items()}


def twin_image(radiance, view, effects, seed, campaign):
    """Return the pixels, uint8 (H, W) or (H, W, 3) in OpenCV's order, of a twin with ``effects`` [(name, parameters)].

    radiance (H + 2m, W + 2m) or (..., 3); its noise is seeded by ``seed``, campaign, camera and capture.
    """
    rng = np.random.default_rng(job.seed_of(seed, campaign, view.camera, view.capture, "expose"))
    image = pipeline.to_uint8(pipeline.form_image(radiance, view, effects, rng))
    return image[..., 0] if image.shape[2] == 1 else image[..., ::-1]


def expose_twin(expand, register_json, manifest, light, files, camera, effects, seed, out):
    """Write the twin image of every capture of a camera as PNG to the folder ``out``.

    manifest of the render stage; light the table of the captures' own lights, None where it is declared; files that of what their
    files say of themselves, None where nobody asks; effects [[name, parameters], ...], scene effects are in the render already.
    """
    expand, out = Path(expand), Path(out)
    record = json.loads(Path(manifest).read_text())
    facts = json.loads((expand / "scene.json").read_text())
    poses = rendered_poses(record)
    chosen = [(n, p) for n, p in effects]
    lights, declared = tables.read_lights(light) if light else {}, declared_of(files)
    place = BoardPlace(load_scene(expand, register_json).plates[0]) if lights else None
    with whole_folder(out) as folder:
        views = list(views_of(expand, register_json, camera, poses))
        for capture, view in tqdm(views, desc=f"exposing {camera}", unit="image", mininterval=5):
            radiance, margin = read_station(Path(manifest).parent, record["stations"][view.station])
            view = replace(view, margin=margin)
            if capture in lights:
                radiance = in_own_light(radiance, lights[capture], view, place)
            own = [e for e in declared.get(capture, []) if e[0] not in dict(chosen)]
            pixels = twin_image(radiance, view, [*chosen, *own], seed, facts["name"])
            ok, data = cv2.imencode(".png", pixels, [cv2.IMWRITE_PNG_COMPRESSION, 3])
            if not ok:
                raise RuntimeError(f"{capture}: PNG encoding failed")
            (folder / f"{capture}.png").write_bytes(data.tobytes())


if __name__ == "__main__":
    job.run(
        expose_twin,
        snakemake,
        expand=Path(snakemake.input.scene).parent,
        register_json=snakemake.input.register,
        manifest=snakemake.input.manifest,
        light=snakemake.input.get("light") or None,
        files=snakemake.input.get("files") or None,
        camera=snakemake.wildcards.camera,
        effects=snakemake.params.effects,
        seed=snakemake.params.seed,
        out=snakemake.output[0],
    )
