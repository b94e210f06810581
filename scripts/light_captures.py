"""Light: what light each photograph of a board was taken in, by the board's own white and black. Makes light/CAMERA.csv.

A vignetting, a curve or a glare that the twin has is not counted again as light.
"""

import json
import logging
from dataclasses import replace
from pathlib import Path

import numpy as np
import pandas as pd
from tqdm import tqdm

import job
from case_files import read_capture
from effects import library, pipeline
from expose_twin import rendered_poses, views_of
from gap.boards.capture_light import photograph_light
from gap.problem import encoding_table
from inputs import tables
from inputs.render_store import read_station
from inputs.scene import load_scene
from rig.light import LIGHT, BoardPlace, free_numbers, in_own_light

log = logging.getLogger("twingap")


def twins_in_light(expand, register_json, manifest, camera, effects, place):
    """Return {capture: function LIGHT -> its twin's grey levels (H, W, C)} by effects [(name, parameters)] that change levels.

    ``place`` is the BoardPlace of the board. Empty where no effect does: light alone makes the levels then.
    """
    if not library.change_levels(effects):
        return {}
    stations = json.loads(Path(manifest).read_text())["stations"]

    def twin_of(view):
        def levels(light):
            radiance, margin = read_station(Path(manifest).parent, stations[view.station])
            wider = replace(view, margin=margin)
            return pipeline.form_image(in_own_light(radiance, light, wider, place), wider, effects, None)

        return levels

    poses = rendered_poses({"stations": stations})
    return {capture: twin_of(view) for capture, view in views_of(expand, register_json, camera, poses)}


def light_captures(expand, register_json, manifest, campaign, camera, observations, effects, out):
    """Write the LIGHT of each capture of a camera; empty where too little of the board is seen.

    manifest of the render stage; ``observations`` is the file of the board's points in all captures; effects [[name, parameters],
    ...] of the twin that act after the render. What the campaign declares stays as declared.
    """
    expand = Path(expand)
    facts, scene = json.loads((expand / "scene.json").read_text()), load_scene(expand, register_json)
    captures = tables.read_table(expand / "captures.csv", tables.CAPTURES)
    captures = captures[captures.camera == camera].sort_values("capture")
    with np.load(observations) as stored:
        points, found = stored["points"], stored["pixels"]
    lut = encoding_table(facts["encoding"], float(facts["exposure"]))
    free, rows = free_numbers(facts["left_open"]), []
    place = BoardPlace(scene.plates[0])
    twins = twins_in_light(expand, register_json, manifest, camera, [(n, p) for n, p in effects], place)
    work = list(zip(captures.capture, captures.image, found, strict=True))
    for capture, image, pixels in tqdm(work, desc=f"light of {camera}", unit="image", mininterval=5):
        try:
            photograph = read_capture(campaign, image)
            light = photograph_light(photograph, scene, points, pixels, lut, free, twins.get(capture))
        except ValueError as why:
            log.info("%s: %s: its twin has the nominal light", capture, why)
            light = np.full(len(LIGHT), np.nan)
        rows.append([capture, *light])
    tables.write_table(pd.DataFrame(rows, columns=["capture", *LIGHT]), out, tables.LIGHTS)


if __name__ == "__main__":
    job.run(
        light_captures,
        snakemake,
        expand=Path(snakemake.input.scene).parent,
        register_json=snakemake.input.register_json,
        manifest=snakemake.input.manifest,
        campaign=snakemake.params.campaign,
        camera=snakemake.wildcards.camera,
        observations=snakemake.input.observations,
        effects=snakemake.params.effects,
        out=snakemake.output[0],
    )
