"""Observe: measure every capture of a camera by the fit of the known code, or find its board's points. Makes the observations."""

import json
import logging
from pathlib import Path

from tqdm import tqdm

import job
from case_files import load_case, read_capture, save_observations, save_points
from inputs import tables
from inputs.campaign import Board
from inputs.images import read_image
from register.finders import board_finder, board_views, by_finder, trusted_finder
from register_captures import look_at_captures

log = logging.getLogger("twingap")


def observe_captures(expand, register_json, campaign, camera, out, part=None):
    """Measure the captures of a camera; part (first, after the last): these alone, in the order of their names."""
    target = json.loads((Path(expand) / "scene.json").read_text())["target"]
    if target:
        return observe_board(expand, campaign, camera, Board.model_validate(target), out)
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


def observe_board(expand, campaign, camera, board, out):
    """Find a board's points in all captures of a camera."""
    row = tables.read_table(Path(expand) / "cameras.csv", tables.CAMERAS).set_index("camera").loc[camera]
    captures = tables.read_table(Path(expand) / "captures.csv", tables.CAPTURES)
    captures = captures[captures.camera == camera].sort_values("capture")
    size = int(row.width), int(row.height)
    found = look_at_captures(campaign, captures, size, board_finder(board))[1]
    images = (read_image(Path(campaign) / image) for image in captures.image)
    finder = trusted_finder(found, size, [])
    found = board_views(by_finder(found, finder), board, images, f"{campaign}/campaign.yaml: target", [])
    with job.write_atomically(out, "wb") as file:
        save_points(file, [found[name] for name in captures.capture], finder)
    log.info("%s: %d points found in %d captures", camera, sum(len(v.image) for v in found.values()), len(found))


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
