"""Diagnose a camera from photographs of one calibration board: poses unknown, intrinsics unknown, no levels known.

Only effects that move image points can be named; the verdict says what was not looked at.
"""

import json
import logging
from pathlib import Path

import numpy as np
import pandas as pd

import job
from effects import library
from effects.base import View
from gap import ladder, points
from gap.parameters import fitted_parameters
from gap.search import MAX_PARAMETERS, MIN_GAIN
from gap.select_effects import HARDLY_CLOSED, MAX_FLOOR_GAP
from inputs import tables
from inputs.campaign import Board
from register import calibration
from register.finders import better_finder, board_finder, usable_views
from register.registration import pose_from_plane
from register_captures import look_at_captures

log = logging.getLogger("twingap")
NOT_LOOKED_AT = "board photographs show no known levels, light or stations"


def board_views(found, size, camera):
    """Return ([BoardView], focal length) from {capture: BoardPoints}: ideal pinhole and its poses as a start."""
    views = usable_views(found)
    fit = calibration.ideal_pinhole(views, size)
    K = calibration.matrix_of(fit)
    made = []
    for name, v in sorted(views.items()):
        T = pose_from_plane(v.board, v.image, K)
        made.append(points.BoardView(View(K, *size, 0, T, camera, name, name), v.board, v.image))
    return made, float(K[0, 0])


def evaluated(train, test, effects, free, focal, sigma):
    """Fit on the training views and score on the others: dict of the outcome."""
    focal, effects, poses, covariance, converged = points.fit(
        train, effects, free, focal, np.zeros((len(train), 6)), sigma
    )
    parts = points.held_out(test, effects, focal, sigma)
    losses = np.array([points.rho(p).sum() for p in parts])
    return {
        "focal": focal, "effects": effects, "converged": converged, "losses": losses, "gap": points.gap_of(parts),
        "rms_px": points.rms_px(parts, sigma), "n_points": sum(p.size for p in parts) // 2,
        "errors": dict(zip(free, np.sqrt(np.maximum(np.diag(covariance), 0)), strict=True)),
    }  # fmt: skip


def select_effects(train, test, focal, sigma):
    """Return (base outcome, steps, candidates of the first step); an effect is added while it helps on held-out views.

    What can mimic anything, a warp of many waves, competes only where the others leave a gap. What leaves most of the excess
    where it was is a patch on something else, and gets no name.
    """
    base = evaluated(train, test, [], [], focal, sigma)
    rigid = [n for n in points.point_effects() if len(library.nulls_of(n)) <= MAX_PARAMETERS]
    steps, first = added(base, rigid, train, test, sigma)
    if (steps[-1][2] if steps else base)["gap"] > BOARD_ENOUGH:
        steps, _ = added(base, points.point_effects(), train, test, sigma, steps)
    if steps and share_left(base, steps[-1][2]) > HARDLY_CLOSED:
        steps = []
    return base, steps, first


def share_left(base, outcome):
    """Return the share of a base outcome's held-out loss above the floor that another one leaves."""
    floor = points.RHO_NOISE * 2 * base["n_points"]
    return (outcome["losses"].sum() - floor) / max(base["losses"].sum() - floor, 1.0)


def added(base, names, train, test, sigma, taken=()):
    """Return (steps, candidates of the first step) of adding some effects; ``taken`` are the steps before it."""
    steps, first = list(taken), None
    current = steps[-1][2] if steps else base
    while True:
        tried = {n: candidate(n, current, train, test, sigma) for n in names if n not in dict(current["effects"])}
        first = first or tried
        good = {
            n: o for n, o in tried.items()
            if o["gain"] > MIN_GAIN + 2 * o["parameters"] and o["share"] >= 0.6 and o["gap"] < 0.95 * current["gap"]
        }  # fmt: skip
        if not good:
            break
        best = max(good, key=lambda n: good[n]["gain"] - 2 * good[n]["parameters"])
        near = [n for n, o in good.items() if n != best and o["gain"] > 0.9 * good[best]["gain"]]
        steps.append((best, current, good[best], near))
        current = good[best]
    return steps, first or {}


def candidate(name, current, train, test, sigma):
    """Return the outcome of an effect added to the current one, all effects refitted."""
    start = library.starts_of(name)[0]
    effects = [*current["effects"], (name, start)]
    outcome = evaluated(train, test, effects, fitted_parameters(effects), current["focal"], sigma)
    gain = current["losses"] - outcome["losses"]
    return outcome | {"gain": float(gain.sum()), "share": float((gain > 0).mean()), "parameters": len(start)}


def diagnose_board(expand, campaign, camera, out, out_ladder):
    """Write the verdict and the ladder of one camera."""
    expand = Path(expand)
    facts = json.loads((expand / "scene.json").read_text())
    row = tables.read_table(expand / "cameras.csv", tables.CAMERAS).set_index("camera").loc[camera]
    captures = tables.read_table(expand / "captures.csv", tables.CAPTURES)
    captures = captures[captures.camera == camera].sort_values("capture")
    size = int(row.width), int(row.height)
    look = board_finder(Board.model_validate(facts["target"]))
    found = better_finder(look_at_captures(campaign, captures, size, look)[1], size, [])
    others = sorted(set(library.available_effects()) - set(points.point_effects()))
    result = {"campaign": facts["name"], "camera": camera, "steps": [], "candidates": [], "where": [], "floor": {}}
    result |= {"suggested_station": None, "not_looked_at": dict.fromkeys(others, NOT_LOOKED_AT), "configured": []}
    if len(usable_views(found)) < 2 * calibration.LEAST_VIEWS:
        result |= {"verdict": "unexplained", "gap": None, "why": "too few photographs show the board: nothing held out"}
        return _write(result, pd.DataFrame(columns=[*ladder.COLUMNS, "camera"]), out, out_ladder)
    views, focal = board_views(found, size, camera)
    train, test = views[0::2], views[1::2]
    sigma = max(points.local_noise_px(views) or 0.2, 0.02)
    base, steps, first = select_effects(train, test, focal, sigma)
    gap = steps[-1][2]["gap"] if steps else base["gap"]
    left = "unexplained" if gap > BOARD_ENOUGH else ("explained" if steps else "adequate")
    result |= {
        "verdict": left, "gap": gap, "gap_as_configured": base["gap"], "floor": {"corners_px": sigma},
        "steps": [_step(s, steps[-1][2]) for s in steps],
        "candidates": [
            {"effect": n, "gap_after": o["gap"], "se": None, "rank": k + 1, "gain": o["gain"], "converged": o["converged"]}
            for k, (n, o) in enumerate(sorted(first.items(), key=lambda i: -i[1]["gain"]))
        ],
        "held_out": [v.view.capture for v in test],
    }  # fmt: skip
    log.info(
        "%s: %s; corners %.3f -> %.3f px", camera, left, base["rms_px"], (steps[-1][2] if steps else base)["rms_px"]
    )
    rungs = [("ideal", base)] + [(name, after) for name, _, after, _ in steps]
    rows = [
        {"step": k, "effect": n, "corner_rmse_px": o["rms_px"], "corner_rmse_px_floor": sigma * np.sqrt(2), "gap": o["gap"],
         "gap_floor": 1.0, "camera": camera}
        for k, (n, o) in enumerate(rungs)
    ]  # fmt: skip
    table = pd.DataFrame(rows).reindex(columns=[*ladder.COLUMNS, "camera"])
    return _write(result, table, out, out_ladder)


BOARD_ENOUGH = 2 * MAX_FLOOR_GAP  # a board's corner noise varies over the image; twice the floor is still noise-like


def _step(step, last):
    name, before, after, near = step
    values = dict(last["effects"])[name]
    return {
        "effect": name,
        "parameters": {k: {"value": v, "se": float(last["errors"].get((name, k), np.nan))} for k, v in values.items()},
        "gap_before": before["gap"], "gap_after": after["gap"], "gap_after_se": None, "confused_with": near,
    }  # fmt: skip


def _write(result, table, out, out_ladder):
    with job.write_atomically(out) as file:
        json.dump(result, file, indent=1, sort_keys=True)
    with job.write_atomically(out_ladder) as file:
        table.to_csv(file, index=False, lineterminator="\n")


if __name__ == "__main__":
    job.run(
        diagnose_board,
        snakemake,
        expand=Path(snakemake.input.scene).parent,
        campaign=snakemake.params.campaign,
        camera=snakemake.wildcards.camera,
        out=snakemake.output.verdict,
        out_ladder=snakemake.output.ladder,
    )
