"""Diagnose: from all candidates' outcomes to the verdict: climb, say what is confused, where the gap lives, what to do.

Makes diagnosis/CAMERA.json, the camera's ladder (held-out errors of every twin on the way), and the tables behind the
pictures: gaps of every plate, level and noise feature for the first and the last twin.
"""

import json
import logging
from pathlib import Path

import cv2
import numpy as np
import pandas as pd

import job
from case_files import read_capture
from gap import ladder
from gap.climb import conclude
from gap.diagnose import Candidate, rank
from gap.fit import flatten
from gap.floors import gap_error, group_gaps, overall_gap
from gap.next_station import suggested_station
from gap.where import explained_shares, field_gaps, noise_gaps, plate_gaps
from job import seed_of
from rig import tables
from try_effect import clean, restored

log = logging.getLogger("twingap")
MOST_PLACES = 8


def candidate_records(paths, diagnosis):
    """Return ([Candidate], {effect: why it was skipped}) of the candidates' files."""
    candidates, skipped = [], {}
    for path in sorted(map(str, paths)):
        record = json.loads(Path(path).read_text())
        if "skipped" in record:
            skipped[record["effect"]] = record["skipped"]
        elif "promise" in record:
            candidates.append(diagnosis.null_candidate(record["effect"]))
        else:
            candidates.append(Candidate.from_record(record))
    return candidates, skipped


def step_records(steps, base, floors):
    """Return the steps of the climb as the result file has them; gaps in units of the final floor."""
    records, before = [], base
    for step in steps:
        records.append(
            {
                "effect": step.effect,
                "parameters": {
                    k: {"value": v, "se": step.errors.get((step.effect, k))}
                    for k, v in dict(step.effects)[step.effect].items()
                },
                "gap_before": overall_gap(before, floors),
                "gap_after": overall_gap(step.groups, floors),
                "gap_after_se": gap_error(step.groups, floors),
                "confused_with": step.confused_with,
            }
        )
        before = step.groups
    # parameters of the last twin hold for all steps: they were refitted together
    if steps:
        final, errors = dict(steps[-1].effects), steps[-1].errors
        for record in records:
            name = record["effect"]
            record["parameters"] = {k: {"value": v, "se": errors.get((name, k))} for k, v in final[name].items()}
    return records


def ranked(candidates, floors):
    """Return the candidates as the result file has them, gaps in units of ``floors``."""
    gaps = {c.effect: c.gap_in(floors) for c in candidates}
    return [
        {
            "effect": c.effect,
            "gap_after": gaps[c.effect],
            "se": c.gap_se * gaps[c.effect] / c.gap if c.gap else c.gap_se,
            "rank": k + 1,
            "gain": c.gain,
            "gain_se": c.gain_se,
            "converged": c.converged,
            "parameters": c.parameters,
        }
        for k, c in enumerate(rank(candidates))
    ]


def diagnose_camera(
    expand, register_json, campaign, camera, observations, base, candidate_files, most_steps, out, out_ladder, out_gaps
):
    """Climb from the twin as configured to the verdict and write everything that tells how."""
    expand, out_gaps = Path(expand), Path(out_gaps)
    diagnosis, record = restored(expand, register_json, camera, observations, base)
    if diagnosis is None:
        _write_undiagnosed(expand, camera, record, out, out_ladder, out_gaps)
        return
    case = diagnosis.case
    candidates, skipped = candidate_records(candidate_files, diagnosis)
    diagnosis.candidates = [c.effect for c in candidates]
    start_effects, start_poses, start_groups = list(diagnosis.effects), diagnosis.poses, diagnosis.base_groups
    found = conclude(diagnosis, candidates, most_steps, lambda e: log.info("%s: + %s", camera, e))
    steps, left, verdict = found.steps, found.left, found.verdict
    floors, gap, gap_se = diagnosis.floors, diagnosis.base_gap, diagnosis.base_gap_se
    everything = sorted(diagnosis.train + diagnosis.test)
    first = tables_of(diagnosis, start_effects, start_poses, everything)
    last = tables_of(diagnosis, diagnosis.effects, diagnosis.poses, everything)
    train = [case.captures[i].view.capture for i in diagnosis.train]
    write_gaps(first, last, train, out_gaps)
    at_fault = last if verdict == "unexplained" else first
    result = {
        "campaign": case.campaign,
        "camera": camera,
        "verdict": verdict,
        "gap": gap,
        "gap_se": gap_se,
        "gap_as_configured": overall_gap(start_groups, floors),
        "groups": group_gaps(diagnosis.base_groups, floors),
        "configured": [{"effect": n, "parameters": p} for n, p in start_effects],
        "steps": step_records(steps, start_groups, floors),
        "candidates": ranked(candidates, floors),
        "candidates_left": ranked(left, floors)[:5],
        "not_looked_at": skipped,
        "where": explained_shares(at_fault["plates"], train)[:MOST_PLACES],
        "floor": floors,
        "suggested_station": suggestion(case, steps, left, diagnosis),
        "held_out": [case.captures[i].view.capture for i in diagnosis.test],
    }
    with job.write_atomically(out) as file:
        json.dump(clean(result), file, indent=1, sort_keys=True)
    twins = [("ideal", [], None)]
    configured = []
    for name, p in start_effects:
        configured = [*configured, (name, p)]
        twins.append((name, configured, None))
    twins += [(s.effect, s.effects, s.poses) for s in steps]
    images = _images(expand, campaign, camera, case, diagnosis.test)
    rows = ladder.rungs(diagnosis, twins, images, floors)
    with job.write_atomically(out_ladder) as file:
        pd.DataFrame(rows).assign(camera=camera).to_csv(file, index=False, lineterminator="\n")
    worst = max(diagnosis.test, key=lambda i: np.mean(flatten(start_groups[i]) ** 2))
    write_example(diagnosis, worst, images[worst], [(start_effects, start_poses), (diagnosis.effects, None)], out_gaps)
    log.info("%s: %s; gap %.2f -> %.2f floors", camera, verdict, result["gap_as_configured"], gap)


EXAMPLES = ("real", "configured", "explained")


def write_example(diagnosis, i, image, twins, folder):
    """Write one capture as three images: example_real.png, and what the first and the last twin show in its place."""
    case, capture = diagnosis.case, diagnosis.case.captures[i]
    shown = [image]
    for effects, poses in twins:
        poses, _ = diagnosis.fitter.score(effects, diagnosis.poses if poses is None else poses, [i])
        rng = np.random.default_rng(seed_of(case.campaign, case.camera, capture.view.capture, "example"))
        shown.append(case.image_of(diagnosis.fitter.radiance(i, effects, poses[i]), capture, effects, poses[i], rng))
    for name, picture in zip(EXAMPLES, shown, strict=True):
        _, data = cv2.imencode(".png", np.clip(np.rint(picture), 0, 255).astype(np.uint8)[..., ::-1])
        with job.write_atomically(folder / f"example_{name}.png", "wb") as file:
            file.write(data.tobytes())


def _images(expand, campaign, camera, case, indices):
    table = tables.read_table(Path(expand) / "captures.csv", tables.CAPTURES).set_index("capture")
    return {i: read_capture(campaign, table.loc[case.captures[i].view.capture, "image"]) for i in indices}


def tables_of(diagnosis, effects, poses, indices):
    """Return {plates, fields, noise}: tables of real minus twin."""
    poses, _ = diagnosis.fitter.score(effects, poses, indices)
    predictions = {i: diagnosis.fitter.predict(i, effects, poses[i]) for i in indices}
    case = diagnosis.case
    return {
        "plates": plate_gaps(case, effects, poses, predictions),
        "fields": field_gaps(case, predictions),
        "noise": noise_gaps(case, predictions),
    }


def write_gaps(first, last, train, folder):
    """Write the tables of the first and last twin as Parquet; ``twin`` says which, ``fitted`` whether a capture was."""
    folder.mkdir(parents=True, exist_ok=True)
    for name in ("plates", "fields", "noise"):
        both = pd.concat(
            [first[name].assign(twin="configured"), last[name].assign(twin="explained")], ignore_index=True
        )
        both["fitted"] = both["capture"].isin(train)
        with job.write_atomically(folder / f"{name}.parquet", "wb") as file:
            both.to_parquet(file, index=False)


def suggestion(case, steps, left, diagnosis):
    """Return the station that would tell the last effect from what it is confused with, None where nothing is."""
    for step in reversed(steps):
        if step.confused_with:
            other = next(c for c in step.candidates if c.effect == step.confused_with[0])
            mine = next(c for c in step.candidates if c.effect == step.effect)
            if mine.state is None or other.state is None:
                continue
            found = suggested_station(case, mine.state.effects, other.state.effects)
            return found | {"tells_apart": [step.effect, other.effect]}
    return None


def _write_undiagnosed(expand, camera, record, out, out_ladder, out_gaps):
    facts = json.loads((Path(expand) / "scene.json").read_text())
    result = {
        "campaign": facts["name"], "camera": camera, "verdict": "unexplained", "why": record["why"], "steps": [],
        "candidates": [], "where": [], "floor": {}, "suggested_station": None, "gap": None,
    }  # fmt: skip
    with job.write_atomically(out) as file:
        json.dump(result, file, indent=1, sort_keys=True)
    with job.write_atomically(out_ladder) as file:
        pd.DataFrame(columns=[*ladder.COLUMNS, "camera"]).to_csv(file, index=False, lineterminator="\n")
    out_gaps.mkdir(parents=True, exist_ok=True)
    for name in EXAMPLES:
        with job.write_atomically(out_gaps / f"example_{name}.png", "wb") as file:
            file.write(cv2.imencode(".png", np.zeros((8, 8), np.uint8))[1].tobytes())
    for name in ("plates", "fields", "noise"):
        with job.write_atomically(out_gaps / f"{name}.parquet", "wb") as file:
            pd.DataFrame({"capture": np.array([], str), "twin": np.array([], str)}).to_parquet(file, index=False)


if __name__ == "__main__":
    job.run(
        diagnose_camera,
        snakemake,
        expand=Path(snakemake.input.scene).parent,
        register_json=snakemake.input.register_json,
        campaign=snakemake.params.campaign,
        camera=snakemake.wildcards.camera,
        observations=snakemake.input.observations,
        base=snakemake.input.base,
        candidate_files=snakemake.input.candidates,
        most_steps=snakemake.params.most_steps,
        out=snakemake.output.verdict,
        out_ladder=snakemake.output.ladder,
        out_gaps=Path(snakemake.output.plates).parent,
    )
