"""Light: what light each photograph of a board was taken in, by the board's own white and black. Makes light/CAMERA.csv."""

import json
import logging
from pathlib import Path

import numpy as np
import pandas as pd
from tqdm import tqdm

import job
from case_files import read_capture
from gap.capture_light import photograph_light
from gap.problem import encoding_table
from inputs import tables
from inputs.scene import load_scene
from rig.light import LIGHT, free_numbers

log = logging.getLogger("twingap")


def light_captures(expand, register_json, campaign, camera, observations, out):
    """Write the LIGHT of each capture of a camera; empty where too little of the board is seen.

    ``observations`` is the file of the board's points in all captures. What the campaign declares stays as declared.
    """
    expand = Path(expand)
    facts, scene = json.loads((expand / "scene.json").read_text()), load_scene(expand, register_json)
    captures = tables.read_table(expand / "captures.csv", tables.CAPTURES)
    captures = captures[captures.camera == camera].sort_values("capture")
    with np.load(observations) as stored:
        points, found = stored["points"], stored["pixels"]
    lut = encoding_table(facts["encoding"], float(facts["exposure"]))
    free, rows = free_numbers(facts["left_open"]), []
    work = list(zip(captures.capture, captures.image, found, strict=True))
    for capture, image, pixels in tqdm(work, desc=f"light of {camera}", unit="image", mininterval=5):
        try:
            light = photograph_light(read_capture(campaign, image), scene, points, pixels, lut, free)
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
        campaign=snakemake.params.campaign,
        camera=snakemake.wildcards.camera,
        observations=snakemake.input.observations,
        out=snakemake.output[0],
    )
