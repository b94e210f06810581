"""Observe: measure the cells of a board in all photographs of a camera, patch by patch. Makes diagnosis/CAMERA/patches.npz."""

import json
import logging
from pathlib import Path

import numpy as np
from tqdm import tqdm

import job
from case_files import load_photographs, read_capture, save_observations
from gap.photographs import expected_corners
from inputs import tables
from inputs.campaign import Board
from rig.patches import board_patches

log = logging.getLogger("twingap")


def observe_patches(expand, register_json, campaign, camera, observations, out):
    """Measure a board's patches about where its points, those of the file ``observations``, say that they are."""
    board = Board.model_validate(json.loads((Path(expand) / "scene.json").read_text())["target"])
    case = load_photographs(expand, register_json, camera, board_patches(board))
    captures = tables.read_table(Path(expand) / "captures.csv", tables.CAPTURES).set_index("capture")
    with np.load(observations) as stored:
        points, pixels = stored["points"], stored["pixels"]
    for capture, xy in tqdm(
        list(zip(case.captures, pixels, strict=True)), desc=f"observing {camera}", unit="image", mininterval=5
    ):
        image = read_capture(campaign, captures.loc[capture.view.capture, "image"])
        case.observe_photograph(capture, image, expected_corners(points, xy, case.patches))
    with job.write_atomically(out, "wb") as file:
        save_observations(file, case)
    seen = int(sum(c.observation.measured.sum() for c in case.captures))
    log.info("%s: %d patches of the board measured in %d photographs", camera, seen, len(case.captures))


if __name__ == "__main__":
    job.run(
        observe_patches,
        snakemake,
        expand=Path(snakemake.input.scene).parent,
        register_json=snakemake.input.register_json,
        campaign=snakemake.params.campaign,
        camera=snakemake.wildcards.camera,
        observations=snakemake.input.observations,
        out=snakemake.output.patches,
    )
