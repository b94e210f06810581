"""Find changes: what is another in a camera's photographs than in those of an earlier campaign, from how much to how much.

Makes diagnosis/CAMERA.json of the later campaign: its steps are the changes, and ``alone`` says what its own captures tell.
Beside it two pictures: a photograph of each campaign with arrows from where the earlier camera would have shown what is seen.
"""

import json
import logging
import os
from pathlib import Path

os.environ["OPENBLAS_NUM_THREADS"] = "1"  # before numpy is loaded: captures go side by side, small matrices do not

import cv2
import numpy as np

import job
from change_pictures import arrows_on, squares_of
from effects import library
from gap.bounds import MAX_P
from gap.fit.score import floors_of, gap_error, group_gaps, overall_gap, root_mean_square
from gap.signatures.signature_changes import competing
from photograph_changes import PhotographSet, what_changed
from rig.errors import InputError

log = logging.getLogger("twingap")


def find_changes(before, after, campaigns, camera, candidates, threads, out, out_pictures):
    """Write what has changed, and a picture of each campaign to the two paths ``out_pictures``.

    before, after  of each campaign the paths of expand/CAMERA/scene.json, register/CAMERA.json, the observations and the
    verdict on its own captures alone; campaigns their folders; candidates names of effects
    Raises InputError where a campaign has too few usable photographs.
    """
    alone = [json.loads(Path(paths[3]).read_text()) for paths in (before, after)]
    # both by the earlier registration: what is another focal length is found, not calibrated away
    sets = [
        PhotographSet(campaign, Path(p[0]).parent, before[1], p[2])
        for campaign, p in zip(campaigns, (before, after), strict=True)
    ]
    try:
        found = what_changed(sets, camera, effects_of(*alone), candidates, threads)
    except ValueError as why:
        raise InputError(f"{campaigns[1]} against {campaigns[0]}, camera {camera}: {why}") from None
    if signatures_first(found):
        pictures, shown = squares_of(found)
    else:
        pictures, shown = arrows_on(found.points, before, after, campaigns)
    record = changes_record(found, alone) | {"shown": shown}
    for path, picture in zip(out_pictures, pictures, strict=True):
        with job.write_atomically(path, "wb") as file:
            file.write(cv2.imencode(".png", picture)[1].tobytes())
    with job.write_atomically(out) as file:
        json.dump(job.clean(record), file, indent=1, sort_keys=True)
    log.info("%s: %s", camera, record["verdict"])


def effects_of(*verdicts):
    """Return [(effect, parameters)] that any of some verdicts' records has, the first one's values first."""
    effects = {}
    for verdict in reversed(verdicts):
        effects |= {e["effect"]: e["parameters"] for e in verdict.get("configured", [])}
        effects |= {s["effect"]: {k: p["value"] for k, p in s["parameters"].items()} for s in verdict["steps"]}
    return list(effects.items())


def changes_record(what, alone):
    """Return what the result file says of a WhatChanged; ``alone`` are the verdicts' records on each campaign by itself.

    Gaps are the root mean square over two groups: points, and signatures where they were compared.
    """
    found = what.points
    members = found.captures_of(1)
    floors = floors_of(found.problem, {i: found.last.groups[i] for i in members})

    def gap(twin, measure=overall_gap):
        return measure({i: twin.groups[i] for i in members}, floors)

    of_points = [(gap(found.base), None)]
    for change in found.changes:
        of_points.append((gap(change.twin), point_step(change, found.last, gap(change.twin, gap_error))))
    of_signatures = [(what.signatures[0].before if what.signatures else None, None)]
    of_signatures += [(change.after, signature_step(change)) for change in what.signatures]
    steps = steps_told(of_points, of_signatures, signatures_first(what))
    candidates = [
        {"effect": n, "gap_after": gap(found.last), "se": None, "rank": k + 1, "gain": a.gain, "p": a.p}
        for k, (n, a) in enumerate(sorted(found.asked.items(), key=lambda asked: (asked[1].p, asked[1].gain, asked[0])))
    ]
    last = _together(of_points[-1][0], of_signatures[-1][0])
    return {
        "campaign": alone[1]["campaign"],
        "camera": alone[1]["camera"],
        "baseline": alone[0]["campaign"],
        "verdict": verdict_of(what),
        "steps": steps,
        "candidates": candidates,
        "where": [],
        "floor": floors,
        "suggested_station": None,
        "gap": last,
        "gap_se": gap(found.last, gap_error),
        "gap_as_configured": _together(of_points[0][0], of_signatures[0][0]),
        "groups": gap(found.last, group_gaps) | ({"signature": of_signatures[-1][0]} if what.signatures else {}),
        "p_other": found.p_other,
        "p_signature": what.p_left,
        "captures": [len(found.captures_of(k)) for k in (0, 1)],
        "held_out": alone[1].get("held_out", []),
        "configured": alone[1].get("configured", []),
        "not_looked_at": not_compared(what, alone[1].get("not_looked_at", {})),
        "least_seen": amounts_seen(what.least_seen),
        "not_told": not_told(what.least_seen),
        "alone": {k: alone[1].get(k) for k in ("verdict", "gap", "steps", "why") if k in alone[1]},
    }


def amounts_seen(least_seen):
    """Return {effect: {parameter: difference from its null} or None} of {effect: as power.least_seen}; what only says in
    which form an effect acts is no amount.
    """
    amounts = {}
    for name, seen in least_seen.items():
        specs = {key: s for key, s in library.parameters_of(name).items() if not (s.auxiliary or s.is_choice)}
        amounts[name] = seen and {key: seen[1][key] - s.null for key, s in specs.items() if seen[1][key] != s.null}
    return amounts


def not_told(least_seen):
    """Return the effects of {effect: as power.least_seen} of which even a clear change would most likely go unseen."""
    return [name for name, seen in least_seen.items() if seen is None or seen[0] > 1]


def verdict_of(what):
    """Return the verdict on a WhatChanged.

    Where points have moved, signatures that differ without a name leave nothing open: a lens stretches what it shows.
    """
    signatures_open = what.p_left <= MAX_P and not what.points.changes
    if what.points.verdict == "unexplained" or signatures_open:
        return "unexplained"
    return "explained" if what.signatures or what.points.changes else "adequate"


def signatures_first(what):
    """Return whether what changed in signatures explains more than what changed in points."""
    points = what.points
    of_points = points.base.loss - points.changes[0].twin.loss if points.changes else 0.0
    return sum(change.explained for change in what.signatures[:1]) > of_points


def steps_told(of_points, of_signatures, signatures_first):
    """Return the steps of two ways [(gap, step)], each from a gap without one, told one after the other in common gaps."""
    first, second = (of_signatures, of_points) if signatures_first else (of_points, of_signatures)
    told, here = [], [first[0][0], second[0][0]]
    for k, way in enumerate((first, second)):
        for after, step in way[1:]:
            before = _together(*here)
            here[k] = after
            told.append(step | {"gap_before": before, "gap_after": _together(*here)})
    return told


def _together(*gaps):
    return root_mean_square(g for g in gaps if g is not None)


def point_step(change, twin, error):
    """Return a step of the record that a changes.Change is, parameters as the last JointTwin has them."""
    return _step(change.effect, change.one_of, change.p) | {
        "parameters": parameters_of(change.effect, twin),
        "gap_after_se": error,
    }


def signature_step(change):
    """Return a step of the record that a SignatureChange is: parameters from the null, or less: to it.

    They count beyond what those captures show that have less of it, which may be more than nothing.
    """
    parameters = {}
    for key, value in change.parameters.items():
        null, error = library.parameters_of(change.effect)[key].null, change.errors.get(key)
        there, here = (value, null) if change.less else (null, value)
        parameters[key] = {"from": there, "to": here, "se": error, "value": here}
    step = _step(change.effect, change.one_of, change.p)
    return step | {
        "parameters": parameters,
        "gap_after_se": None,
        "like_light": change.like_light,
        "beyond": "later" if change.less else "earlier",
    }


def _step(effect, one_of, p):
    step = {"effect": effect, "p": p, "confused_with": [n for n in one_of if n != effect]}
    return step | ({"one_of": list(one_of)} if one_of else {})


def not_compared(what, reasons):
    """Return {effect: why it was not compared}, of reasons why one set alone does not show them."""
    if what.why_points_alone:
        return {name: what.why_points_alone for name in reasons}
    compared = competing(what.photographs, reasons)
    return {name: why for name, why in reasons.items() if name not in compared}


def parameters_of(effect, twin):
    """Return {parameter: {from, to, se, value}} of an effect that has changed; se is that of the difference."""
    before, after = (dict(effects)[effect] for effects in twin.effects)
    out = {}
    for key in library.parameters_of(effect):
        errors = [e.get((effect, key), np.nan) for e in twin.errors]
        out[key] = {"from": before[key], "to": after[key], "se": float(np.hypot(*errors)), "value": after[key]}
    return out


if __name__ == "__main__":
    job.run(
        find_changes,
        snakemake,
        before=snakemake.input.before,
        after=snakemake.input.after,
        campaigns=snakemake.params.campaigns,
        camera=snakemake.wildcards.camera,
        candidates=snakemake.params.candidates,
        threads=snakemake.threads,
        out=snakemake.output.verdict,
        out_pictures=snakemake.output.pictures,
    )
