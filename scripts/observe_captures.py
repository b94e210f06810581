"""Observe: measure every capture of a camera by the fit of the known code, and fit the twin as configured to it.

Makes the observations (npz) and the base of the diagnosis (JSON): effects as configured, pose of each capture, gap.
"""

import json
import logging
from pathlib import Path

from tqdm import tqdm

import job
from case_files import load_case, read_capture, save_observations
from gap.diagnose import Diagnosis, is_promising
from gap.floors import group_gaps

log = logging.getLogger("twingap")


def promises_record(diagnosis):
    """Return {effect: {gain: to first order, fit: whether that is worth a fit}} of all candidates."""
    promises = diagnosis.promises()
    return {name: {"gain": gain, "fit": is_promising(name, promises)} for name, gain in promises.items()}


def observe_captures(
    expand, register_csv, register_json, campaign, camera, effects, free, candidates, out_observations, out_base
):
    """Measure all captures; fit poses and the parameters that the twin's file leaves free.

    effects [[name, parameters], ...] and free [[effect, parameter], ...] of the twin as configured.
    """
    case, captures = load_case(expand, register_json, camera)
    images = dict(zip(captures.capture, captures.image, strict=True))
    for capture in tqdm(case.captures, desc=f"observing {camera}", unit="image", mininterval=5):
        case.observe_real(capture, read_capture(campaign, images[capture.view.capture]))
    out_observations = Path(out_observations)
    out_observations.parent.mkdir(parents=True, exist_ok=True)
    save_observations(out_observations, case)
    seen = int(sum(c.observation.measured.sum() for c in case.captures))
    log.info("%s: %d plates measured in %d captures", camera, seen, len(case.captures))
    diagnosis = Diagnosis(case, candidates)
    base = {"effects": effects, "poses": diagnosis.poses.tolist(), "errors": {}, "usable": diagnosis.is_usable()}
    if diagnosis.is_usable():
        diagnosis.fixed = {n for n, _ in effects} - {n for n, _ in free}
        fit = diagnosis.set_base([(n, p) for n, p in effects], [tuple(f) for f in free])
        base |= {
            "effects": [[n, p] for n, p in diagnosis.effects],
            "poses": diagnosis.poses.tolist(),
            "errors": {f"{n}.{k}": float(e) for (n, k), e in zip(free, fit.errors, strict=True)},
            "gap": diagnosis.base_gap,
            "gap_se": diagnosis.base_gap_se,
            "groups": group_gaps(diagnosis.base_groups, diagnosis.floors),
            "promises": promises_record(diagnosis),
        }
        log.info("%s: gap of the twin as configured %.2f floors", camera, diagnosis.base_gap)
    else:
        base["why"] = diagnosis.why_unusable()
        log.info("%s: %s", camera, base["why"])
    with job.write_atomically(out_base) as file:
        json.dump(base, file, indent=1, sort_keys=True)


if __name__ == "__main__":
    job.run(
        observe_captures,
        snakemake,
        expand=Path(snakemake.input.scene).parent,
        register_csv=snakemake.input.register_csv,
        register_json=snakemake.input.register_json,
        campaign=snakemake.params.campaign,
        camera=snakemake.wildcards.camera,
        effects=snakemake.params.effects,
        free=snakemake.params.free,
        candidates=snakemake.params.candidates,
        out_observations=snakemake.output.observations,
        out_base=snakemake.output.base,
    )
