"""Observe: measure the cells of a board in all photographs of a camera: where, in what light, what they show of the camera.

Makes diagnosis/CAMERA/patches.npz.
"""

import logging
from pathlib import Path

import numpy as np
from tqdm import tqdm

import job
from case_files import PATCHES, load_views, save_patches
from gap.boards.capture_light import photograph_light
from gap.problem import encoding_table
from gap.signatures.signature import MIN_PATCHES
from gap.signatures.signature_case import OF_SLOPES
from inputs.scene import load_scene
from photograph_changes import PhotographSet
from rig.light import LIGHT, free_numbers

log = logging.getLogger("twingap")
MAX_PX = 400_000  # of the windows about a photograph's patches, unless MIN_PATCHES have more


def observe_patches(expand, register_json, campaign, camera, observations, out):
    """Measure a board's patches about where its points, those of the file ``observations``, say that they are."""
    facts, _, views = load_views(expand, register_json, camera)
    scene, free = load_scene(expand, register_json), free_numbers(facts["left_open"]) & OF_SLOPES
    lut = encoding_table(facts["encoding"], float(facts["exposure"]))
    of_set = PhotographSet(campaign, expand, register_json, observations)
    photographs = of_set.photographs(camera, {view.capture: view for view in views})
    with np.load(observations) as stored:
        points, pixels = stored["points"], stored["pixels"]
    lights, fewer = np.full((len(views), len(LIGHT)), np.nan), []
    work = list(zip(photographs, pixels, strict=True))
    for k, (photograph, xy) in enumerate(tqdm(work, desc=f"observing {camera}", unit="image", mininterval=5)):
        fewer.append(some_patches(photograph))
        try:
            lights[k] = photograph_light(photograph.image.astype(np.float32), scene, points, xy, lut, free)
        except ValueError as why:
            log.info("%s: %s", photograph.view.capture, why)
    with job.write_atomically(out, "wb") as file:
        save_patches(file, fewer, lights)
    log.info(
        "%s: %d patches of the board measured in %d photographs", camera, sum(len(p.plates) for p in fewer), len(fewer)
    )


def some_patches(photograph):
    """Return a signature.Photograph as PATCHES of its patches show it, fewer where these are large: pixels take the time."""
    some = photograph.fewer(PATCHES)
    if len(some.plates) <= MIN_PATCHES:
        return some
    return photograph.fewer(max(MIN_PATCHES, min(PATCHES, int(PATCHES * MAX_PX / np.prod(some.atlas.shape)))))


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
