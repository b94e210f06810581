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
from case_files import load_measured, read_capture
from effects import library
from gap.changes import changes
from gap.score import floors_of, gap_error, group_gaps, overall_gap
from inputs import tables
from rig.errors import InputError

ARROW = 0.05  # of the picture's width, its longest arrows
log = logging.getLogger("twingap")


def find_changes(before, after, campaigns, camera, candidates, threads, out, out_pictures):
    """Write what has changed, and a picture of each campaign to the two paths ``out_pictures``.

    before, after  of each campaign the paths of expand/CAMERA/scene.json, register/CAMERA.json, the observations and the
    verdict on its own captures alone; campaigns their folders; candidates names of effects
    Raises InputError where a campaign has too few usable photographs.
    """
    alone = [json.loads(Path(paths[3]).read_text()) for paths in (before, after)]
    try:
        # both by the earlier registration: what is another focal length is found, not calibrated away
        problems = [load_measured(Path(p[0]).parent, before[1], camera, p[2]) for p in (before, after)]
        found = changes(*problems, effects_of(*alone), candidates, threads)
    except ValueError as why:
        raise InputError(f"{campaigns[1]} against {campaigns[0]}, camera {camera}: {why}") from None
    pictures, shown = arrows_on(found, before, after, campaigns)
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


def changes_record(found, alone):
    """Return what the result file says of Changes; ``alone`` are the verdicts' records on each campaign by itself."""
    steps, before = [], found.base
    members = found.captures_of(1)
    floors = floors_of(found.problem, {i: found.last.groups[i] for i in members})

    def gap(twin, measure=overall_gap):
        return measure({i: twin.groups[i] for i in members}, floors)

    for change in found.changes:
        steps.append(
            {
                "effect": change.effect,
                "parameters": parameters_of(change.effect, found.last),
                "p": change.p,
                "gap_before": gap(before),
                "gap_after": gap(change.twin),
                "gap_after_se": gap(change.twin, gap_error),
                "confused_with": [n for n in change.one_of if n != change.effect],
            }
            | ({"one_of": list(change.one_of)} if change.one_of else {})
        )
        before = change.twin
    candidates = [
        {"effect": n, "gap_after": gap(found.last), "se": None, "rank": k + 1, "gain": gain, "p": p}
        for k, (n, (p, gain)) in enumerate(sorted(found.asked.items(), key=lambda a: (a[1], a[0])))
    ]
    return {
        "campaign": alone[1]["campaign"],
        "camera": alone[1]["camera"],
        "baseline": alone[0]["campaign"],
        "verdict": found.verdict,
        "steps": steps,
        "candidates": candidates,
        "where": [],
        "floor": floors,
        "suggested_station": None,
        "gap": gap(found.last),
        "gap_se": gap(found.last, gap_error),
        "gap_as_configured": gap(found.base),
        "groups": gap(found.last, group_gaps),
        "p_other": found.p_other,
        "captures": [len(found.captures_of(k)) for k in (0, 1)],
        "held_out": alone[1].get("held_out", []),
        "configured": alone[1].get("configured", []),
        "not_looked_at": alone[1].get("not_looked_at", {}),
        "alone": {k: alone[1].get(k) for k in ("verdict", "gap", "steps", "why") if k in alone[1]},
    }


def arrows_on(found, before, after, campaigns):
    """Return ([picture (H, W, 3) of each campaign], {before, after: capture, times: factor}) of Changes.

    Shown are the later photograph that the earlier camera's twin is farthest off, and the earlier one that is most like it.
    """
    off = {k: {i: found.residuals_of_points(i) for i in found.captures_of(k)} for k in (0, 1)}
    later = max(off[1], key=lambda i: np.median(np.linalg.norm(off[1][i][1], axis=1)))
    middle = off[1][later][0].mean(0)
    earlier = min(off[0], key=lambda i: np.linalg.norm(off[0][i][0].mean(0) - middle))
    longest = np.quantile(np.linalg.norm(off[1][later][1], axis=1), 0.9)
    width = found.problem.captures[later].view.width
    times = float(max(1, round(ARROW * width / max(longest, 1e-3), -1)))
    pictures, shown = [], {"times": times}
    for name, k, i, paths in (("before", 0, earlier, before), ("after", 1, later, after)):
        shown[name] = found.problem.captures[i].view.capture.split("/", 1)[1]
        table = tables.read_table(Path(paths[0]).parent / "captures.csv", tables.CAPTURES).set_index("capture")
        image = read_capture(campaigns[k], table.loc[shown[name], "image"])
        pictures.append(with_arrows(image, *off[k][i], times))
    return pictures, shown


def with_arrows(image, seen, off, times):
    """Return a picture (H, W, 3), blue first, of an image (H, W, C), red first, with arrows that end at points (p, 2) seen.

    They begin where the points were expected, ``off`` (p, 2) longer by a factor.
    """
    picture = np.ascontiguousarray(
        np.repeat(image, 3 // image.shape[2], axis=2)[..., ::-1].clip(0, 255).astype(np.uint8)
    )
    thick = max(1, picture.shape[1] // 640)
    for end, move in zip(seen, off, strict=True):
        points = [tuple(int(v) for v in np.rint(p)) for p in (end - times * move, end)]
        cv2.arrowedLine(picture, *points, (40, 40, 235), thick, cv2.LINE_AA, tipLength=0.25)
    return picture


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
