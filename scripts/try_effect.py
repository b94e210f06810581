"""Try: one candidate effect added to a camera's twin as configured, fitted on some stations, scored on the others."""

import json
import math
from pathlib import Path

import job


def restored(expand, register_json, camera, observations, base):
    """Return (Diagnosis with the base restored, base record); the Diagnosis is None where nothing can be held out."""
    from case_files import load_case, load_observations  # most candidates need no fit, and these take longer to load
    from gap.diagnose import Diagnosis

    case, _ = load_case(expand, register_json, camera)
    load_observations(observations, case)
    record = json.loads(Path(base).read_text())
    diagnosis = Diagnosis(case)
    if not record["usable"]:
        return None, record
    diagnosis.restore(record)
    return diagnosis, record


def clean(value):
    """Return a value that JSON can hold: NaN and infinity become null."""
    if isinstance(value, float):
        return value if math.isfinite(value) else None
    if isinstance(value, dict):
        return {k: clean(v) for k, v in value.items()}
    if isinstance(value, list | tuple):
        return [clean(v) for v in value]
    return value


def try_effect(expand, register_json, camera, effect, observations, base, out):
    """Write the candidate's outcome (JSON)."""
    record = json.loads(Path(base).read_text())
    if not record["usable"]:
        outcome = {"effect": effect, "skipped": "nothing could be held out"}
    elif effect not in record["promises"]:
        outcome = {"effect": effect, "skipped": "in the twin already"}
    elif not record["promises"][effect]["fit"]:
        outcome = {"effect": effect, "promise": record["promises"][effect]["gain"]}
    else:
        diagnosis, _ = restored(expand, register_json, camera, observations, base)
        outcome = diagnosis.try_effect(effect).as_record()
    with job.write_atomically(out) as file:
        json.dump(clean(outcome), file, indent=1, sort_keys=True)


if __name__ == "__main__":
    job.run(
        try_effect,
        snakemake,
        expand=Path(snakemake.input.scene).parent,
        register_json=snakemake.input.register_json,
        camera=snakemake.wildcards.camera,
        effect=snakemake.wildcards.effect,
        observations=snakemake.input.observations,
        base=snakemake.input.base,
        out=snakemake.output[0],
    )
