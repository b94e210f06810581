"""Observe: measure every capture of a camera by the fit of the known code. Makes the observations."""

import logging
from pathlib import Path

from tqdm import tqdm

import job
from case_files import load_case, read_capture, save_observations

log = logging.getLogger("twingap")


def observe_captures(expand, register_json, campaign, camera, out, part=None):
    """Measure the captures of a camera; part (first, after the last): these alone, in the order of their names."""
    case, captures = load_case(expand, register_json, camera)
    if part:
        case.captures = case.captures[slice(*part)]
    images = dict(zip(captures.capture, captures.image, strict=True))
    for capture in tqdm(case.captures, desc=f"observing {camera}", unit="image", mininterval=5):
        case.observe_real(capture, read_capture(campaign, images[capture.view.capture]))
    with job.write_atomically(out, "wb") as file:
        save_observations(file, case)
    seen = int(sum(c.observation.measured.sum() for c in case.captures))
    log.info("%s: %d plates measured in %d captures", camera, seen, len(case.captures))


if __name__ == "__main__":
    job.run(
        observe_captures,
        snakemake,
        expand=Path(snakemake.input.scene).parent,
        register_json=snakemake.input.register_json,
        campaign=snakemake.params.campaign,
        camera=snakemake.wildcards.camera,
        out=snakemake.output.observations,
        part=snakemake.params.get("part"),
    )
