"""Diagnose: from the twin as configured to the verdict: select effects, say what is confused, where the gap lives, what to do.

Makes diagnosis/CAMERA.json, the camera's ladder (held-out errors of every twin on the way), and the tables behind the
pictures: gaps of every plate, level and noise feature for the first and the last twin. Of photographs of a board, whose points
are all that is known, only effects that move points compete, and no pictures are drawn.
"""

import json
import logging
import os
import time
from functools import partial
from importlib.metadata import version
from pathlib import Path

os.environ["OPENBLAS_NUM_THREADS"] = "1"  # before numpy is loaded: captures go side by side, small matrices do not

import cv2
import numpy as np
import pandas as pd

import job
from case_files import load_measured, read_capture
from declared_effects import declared_of
from diagnose_patches import both_looks, gaps_on_the_way, look_at_patches, rows_of_both
from effects import library
from effects.contract import available_effects
from gap.boards.board import scales_alone, seen_by_points
from gap.boards.needs import cannot_tell
from gap.boards.whole_lens import whole_lens_record
from gap.explain import ladder
from gap.explain.next_station import suggested_station
from gap.explain.where import explained_shares, field_gaps, noise_gaps, plate_gaps
from gap.fit.residuals import flatten
from gap.fit.score import gap_error, group_gaps, overall_gap
from gap.problem import without_own
from gap.select.select_effects import verdict
from gap.select.twin import rank
from gap.signatures.needs_of_cells import cells_cannot_tell
from imports import imports_of
from inputs import tables
from job import seed_of
from outcome_store import OutcomeStore
from rig.geometry import N_POSE

log = logging.getLogger("twingap")
MAX_PLACES, MAX_LEFT = 8, 5
IN_THE_TWIN = "in the twin already"
ONLY_POINTS = "a board's own size and mount, and light that is not declared, cannot be told from its photographs"
OF_BOARDS = "only photographs of a calibration board leave it open: a rig's numbers are declared"
OPEN_TO_EACH = "the campaign leaves it open: each capture has its own, which is fitted"
OPEN_TO_ALL = "the campaign leaves it open: it is fitted, alike in all captures"
WITH_ALL = "intrinsics are unknown: fitted with everything"


def step_records(steps, base, floors):
    """Return the steps from a base Twin as the result file has them; gaps in units of the final floor."""
    records, before = [], base.groups
    for step in steps:
        last = steps[-1].twin  # its parameters hold for all steps: they were refitted together
        records.append(
            {
                "effect": step.effect,
                "parameters": last.told(step.effect),
                "gap_before": overall_gap(before, floors),
                "gap_after": overall_gap(step.twin.groups, floors),
                "gap_after_se": gap_error(step.twin.groups, floors),
                "confused_with": list(step.confused_with),
            }
            | ({"one_of": list(step.one_of)} if step.one_of else {})
            | ({"residue": step.residue} if step.residue else {})
        )
        before = step.twin.groups
    return records


def ranked(candidates, floors):
    """Return the candidates as the result file has them, gaps in units of ``floors``."""
    return [
        {
            "effect": c.effect,
            "gap_after": overall_gap(c.twin.groups, floors),
            "se": gap_error(c.twin.groups, floors),
            "rank": k + 1,
            "gain": c.gain,
            "gain_se": c.gain_se,
            "converged": c.twin.converged,
            "parameters": c.parameters,
        }
        for k, c in enumerate(rank(candidates))
    ]


def verdict_record(base, first, outcome, nuisances=()):
    """Return what the result file says of an Outcome that started from a base Twin and its first candidates.

    ``nuisances`` are the names of effects that are fitted in every twin, and are no part of it as configured.
    """
    twin = outcome.twin
    return {
        "verdict": outcome.verdict,
        "gap": twin.gap,
        "gap_se": twin.gap_se,
        "gap_as_configured": overall_gap(base.groups, twin.floors),
        "groups": group_gaps(twin.groups, twin.floors),
        "configured": [{"effect": n, "parameters": p} for n, p in base.effects if n not in nuisances],
        "steps": step_records(outcome.steps, base, twin.floors),
        "candidates": ranked(first, twin.floors),
        "candidates_left": ranked(outcome.left, twin.floors)[:MAX_LEFT],
        "floor": twin.floors,
        "within_budget": outcome.within_budget,
    }


def diagnose_camera(
    expand,
    register_json,
    campaign,
    camera,
    observations,
    patches,
    files,
    effects,
    free,
    candidates,
    budget,
    threads,
    code,
    effect_code,
    kept,
    out,
    out_ladder,
    out_gaps,
):
    """Go from the twin as configured to the verdict and write everything that tells how.

    ``patches`` is the file of what a board's cells show and ``files`` the table of what its photographs' files say, None where
    points alone are looked at. effects [[name, parameters], ...] and free [[effect, parameter], ...] of the twin as configured;
    ``candidates`` are names of effects; ``budget`` counts predictions of one capture. ``kept`` is a folder of earlier outcomes
    (gap.select.kept); what they depend on besides are the measurements and the files of ``code`` and ``effect_code``.
    """
    expand, out_gaps = Path(expand), Path(out_gaps)
    configured = [(n, p) for n, p in effects]
    fixed = {(n, k) for n, p in configured for k in p} - {(n, k) for n, k in free}
    measured = [*code, *effect_code, observations, register_json]
    try:
        case = without_own(load_measured(expand, register_json, camera, observations), dict(configured))
        store = stored_outcomes(kept, measured, expand, (camera, sorted(fixed)), dict(case.own))
        competing, not_looked_at = looked_at(case, candidates)
        search, base, first, outcome = verdict(
            case, configured, competing, fixed, budget, threads, teller(camera), store
        )
    except ValueError as why:
        return _write_undiagnosed(
            json.loads((expand / "scene.json").read_text()), camera, str(why), out, out_ladder, out_gaps
        )
    case, twin = search.problem, outcome.twin
    everything = sorted(search.train + search.test)
    before, after = (tables_of(search.solver, t, everything) for t in (base, twin))
    train = [case.captures[i].view.capture for i in search.train]
    write_gaps(before, after, train, out_gaps)
    at_fault = after if outcome.verdict == "unexplained" else before
    nuisances = {n for n, _ in case.nuisances} - set(dict(configured))
    result = {
        "campaign": case.campaign,
        "camera": camera,
        "not_looked_at": not_looked_at | {n: IN_THE_TWIN for n in competing if n in base.names and n not in nuisances},
        "where": explained_shares(at_fault["plates"], train)[:MAX_PLACES],
        "suggested_station": suggestion(case, outcome.steps) if case.draws else None,
        "held_out": [case.captures[i].view.capture for i in search.test],
    } | verdict_record(base, first, outcome, nuisances)
    if case.own:
        result["own"] = own_record(case, twin, everything)
    if nuisances:
        result["nuisances"] = {n: p for n, p in twin.effects if n in nuisances}
    images = _images(expand, campaign, camera, case, search.test) if case.draws else {}
    rungs = ladder_twins(base, outcome.steps, len(nuisances))
    rows = ladder.rungs(search.solver, rungs, search.test, images, twin.floors)
    if not case.draws:
        result["floor"] = {"corners_px": case.noise_px} | twin.floors
        result |= telling_record(result["steps"], *cannot_tell(search, twin, competing))
        result["whole_lens"] = whole_lens_record(search, twin)
        result |= motion_record(case)
    store.drop_unused()
    if patches:
        facts = camera, sorted(fixed), twin.effects, twin.poses.tobytes()
        declared = declared_of(files)
        in_all = {name for own in declared.values() for name, _ in own}
        store = stored_outcomes(f"{kept}/patches", [*measured, patches, files], expand, facts, in_all)
        of_camera = expand, register_json, camera, patches
        look = partial(look_at_patches, of_camera, case, outcome, list(not_looked_at), fixed, declared, budget, threads)
        result, rows = with_cells(result, rows, base, outcome, not_looked_at, partial(look, teller(camera), store))
        store.drop_unused()
    with job.write_atomically(out) as file:
        json.dump(job.clean(result), file, indent=1, sort_keys=True)
    with job.write_atomically(out_ladder) as file:
        pd.DataFrame(rows).assign(camera=camera).to_csv(file, index=False, lineterminator="\n")
    if case.draws:
        worst = max(search.test, key=lambda i: np.mean(flatten(base.groups[i]) ** 2))
        write_example(search.solver, worst, images[worst], (base, twin), out_gaps)
    told = camera, result["verdict"], result["gap_as_configured"], result["gap"]
    log.info("%s: %s; gap %.2f -> %.2f floors", *told)


def own_record(case, twin, indices):
    """Return {"effect parameter": {capture: value}} of the captures' own numbers, where the campaign leaves them open."""
    seen = {case.captures[i].view.capture: dict(case.seen_with(twin.effects, twin.poses[i])) for i in indices}
    return {f"{name} {key}": {c: effects[name][key] for c, effects in seen.items()} for name, key in case.own}


def motion_record(case):
    """Return what the result file says of how a BoardCase's photographs move while they are read; {} where they do not."""
    if case.gap_at_rest is None:
        return {}
    return {"motion": {"usual_turn_rad": float(case.sigma_pose[N_POSE]), "gap_at_rest": case.gap_at_rest}}


def telling_record(steps, hidden, alike, needs):
    """Return what the result file says of what photographs cannot tell (needs.py, needs_of_cells.py), ``steps`` among it."""
    steps = [s | ({"one_of": [s["effect"], *alike[s["effect"]]]} if s["effect"] in alike else {}) for s in steps]
    return {"steps": steps, "not_told": hidden, "needs": needs}


def with_cells(result, rows, base, outcome, not_looked_at, look):
    """Return (record, ladder's rows) with what a board's cells tell added to what its points did; as they are where too few
    are seen.

    base and outcome are of the points, ``not_looked_at`` {effect: why} what these do not show; ``look`` looks at the cells
    (diagnose_patches.look_at_patches).
    """
    unseen = {n: why for n, why in not_looked_at.items() if library.is_pure_geometry(n)}
    try:
        search, own, tried, closer, hidden = look()
    except ValueError as why:
        of_cells = {n: str(why) for n in not_looked_at if n not in unseen}
        return result | {"not_looked_at": result["not_looked_at"] | of_cells}, rows
    gaps = gaps_on_the_way(base, outcome, own, closer)
    steps = [step.effect for step in closer.steps]
    rows = rows_of_both(rows, f"{result['campaign']}/{result['camera']}", steps, gaps)
    of_cells = verdict_record(own, tried, closer)
    of_cells |= telling_record(of_cells["steps"], *cells_cannot_tell(search, closer.twin, closer.steps))
    result = both_looks(result, of_cells, gaps)
    return result | {"not_looked_at": hidden | unseen}, rows


def teller(camera):
    """Return a function that logs an effect that was added, the time it took, and how long the budget lasts at that pace."""
    start = time.monotonic()

    def tell(effect, share):
        spent_s = time.monotonic() - start
        lasts_min = spent_s / max(share, 1e-9) / 60
        log.info("%s: + %s after %.0f s; the budget lasts %.0f min at this pace", camera, effect, spent_s, lasts_min)

    return tell


def stored_outcomes(folder, files, expand, facts, in_all):
    """Return the OutcomeStore of a camera: ``files`` its code and measurements, ``expand`` the folder of its tables, ``in_all``
    the names of effects that captures have of their own, whatever a twin has.
    """
    known = available_effects().keys() - set(in_all)
    own = {f for f in files if Path(f).parent.name == "effects" and Path(f).stem in known}
    of_effects = {Path(f).stem: [f, *sorted(own.intersection(imports_of(f)))] for f in own}
    shared = {*files, *(f for f in Path(expand).iterdir() if f.is_file())} - own
    versions = [version(package) for package in ("numpy", "scipy", "numba", "opencv-contrib-python-headless")]
    return OutcomeStore(folder, map(Path, shared), (facts, versions), of_effects)


def looked_at(case, candidates):
    """Return (names of the candidates that can compete, {name: why it does not} of the others)."""
    if not case.is_board:
        why = {n: OF_BOARDS for n in candidates if library.is_of_boards(n)}
        why |= dict.fromkeys(dict(case.nuisances), OPEN_TO_ALL) | dict.fromkeys(dict(case.own), OPEN_TO_EACH)
        return [n for n in candidates if n not in why], {n: w for n, w in why.items() if n in candidates}
    seen = seen_by_points(candidates)
    fitted = {n for n in seen if case.nuisances and scales_alone(n)}
    why = {n: WITH_ALL if n in fitted else ONLY_POINTS for n in candidates if n not in seen or n in fitted}
    return [n for n in candidates if n not in why], why


def ladder_twins(base, steps, ideal):
    """Return [(effect, effects, poses)] of the ladder: the ideal twin, the effects as configured one by one, the steps.

    The first ``ideal`` effects of the base are fitted in every twin.
    """
    twins = [("ideal", list(base.effects[:ideal]), base.poses)]
    for k, (name, _) in enumerate(base.effects[ideal:], ideal):
        twins.append((name, list(base.effects[: k + 1]), base.poses))
    return twins + [(s.effect, list(s.twin.effects), s.twin.poses) for s in steps]


EXAMPLES = ("real", "configured", "explained")


def write_example(solver, i, image, twins, folder):
    """Write one capture as three images: example_real.png, and what the first and the last twin show in its place."""
    case, capture = solver.problem, solver.problem.captures[i]
    shown = [image]
    for twin in twins:
        effects = list(twin.effects)
        poses, _ = solver.score(effects, twin.poses, [i])
        rng = np.random.default_rng(seed_of(case.campaign, case.camera, capture.view.capture, "example"))
        radiance = case.radiance_of(capture, effects, poses[i])
        shown.append(case.image_of(radiance, capture, effects, poses[i], rng))
    for name, picture in zip(EXAMPLES, shown, strict=True):
        _, data = cv2.imencode(".png", np.clip(np.rint(picture), 0, 255).astype(np.uint8)[..., ::-1])
        with job.write_atomically(folder / f"example_{name}.png", "wb") as file:
            file.write(data.tobytes())


def _images(expand, campaign, camera, case, indices):
    table = tables.read_table(Path(expand) / "captures.csv", tables.CAPTURES).set_index("capture")
    return {i: read_capture(campaign, table.loc[case.captures[i].view.capture, "image"]) for i in indices}


def tables_of(solver, twin, indices):
    """Return {plates, fields, noise}: tables of real minus twin."""
    effects, case = list(twin.effects), solver.problem
    poses, _ = solver.score(effects, twin.poses, indices)
    predictions = {i: solver.predictor.predict(i, effects, poses[i]) for i in indices}
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


def suggestion(case, steps):
    """Return the station that would tell the last effect from what it is confused with, None where nothing is."""
    for step in reversed(steps):
        if step.confused_with:
            other = next(c for c in step.candidates if c.effect == step.confused_with[0])
            mine = next(c for c in step.candidates if c.effect == step.effect)
            found = suggested_station(case, list(mine.twin.effects), list(other.twin.effects))
            return found and found | {"tells_apart": [step.effect, other.effect]}
    return None


def _write_undiagnosed(facts, camera, why, out, out_ladder, out_gaps):
    result = {
        "campaign": facts["name"], "camera": camera, "verdict": "unexplained", "why": why, "steps": [],
        "candidates": [], "where": [], "floor": {}, "suggested_station": None, "gap": None,
    }  # fmt: skip
    with job.write_atomically(out) as file:
        json.dump(result, file, indent=1, sort_keys=True)
    with job.write_atomically(out_ladder) as file:
        pd.DataFrame(columns=[*ladder.COLUMNS, "camera"]).to_csv(file, index=False, lineterminator="\n")
    out_gaps.mkdir(parents=True, exist_ok=True)
    for name in () if facts["target"] else EXAMPLES:
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
        patches=snakemake.input.get("patches") or None,
        files=snakemake.input.get("files") or None,
        effects=snakemake.params.effects,
        free=snakemake.params.free,
        candidates=snakemake.params.candidates,
        budget=snakemake.params.budget,
        threads=snakemake.threads,
        code=snakemake.input.code,
        effect_code=snakemake.input.effect_code,
        kept=snakemake.params.kept,
        out=snakemake.output.verdict,
        out_ladder=snakemake.output.ladder,
        out_gaps=Path(snakemake.output.plates).parent,
    )
