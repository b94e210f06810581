"""The ladder: the twins of one camera in the order in which effects were added, each with its held-out errors.

Errors are taken at each capture's own pose, estimated under its prior, and compared with what real repeats of a twin
(another draw of noise) or repeats of a station would show: the floor.
"""

import numpy as np

from gap.fit.score import overall_gap
from gap.measure.places import wholly_inside
from gap.observables import CORNERS, corners_in
from job import seed_of

MEASURES = (
    "corner_rmse_px", "intensity_rmse_dn", "detection_disagreement_pct", "delta_distance_cm",
    "delta_rotation_deg", "gap",
)  # fmt: skip
COLUMNS = (
    "step", "effect", *MEASURES, *(f"{m}_floor" for m in MEASURES), *(f"{m}_low" for m in MEASURES),
    *(f"{m}_high" for m in MEASURES),
)  # fmt: skip
RESAMPLES = 400


def rungs(solver, twins, indices, images, floors):
    """Return one dict a twin [(effect, effects, poses to start from)]: errors of held-out captures, floors, 95 % intervals.

    images {capture index: real image (H, W, C), red first, grey levels}; empty where points are all that is compared.
    """
    case = solver.problem
    finder = case.finder() if images else None
    real = {i: finder.find(images[i]) for i in images}
    rows, control = [], None
    for step, (effect, effects, poses) in reversed(list(enumerate(twins))):
        poses, groups = solver.score(effects, poses, indices)
        parts = {i: corner_errors(solver, effects, poses[i], i) | {"groups": groups[i]} for i in indices}
        for i in images:
            parts[i] |= capture_errors(solver, finder, effects, poses[i], i, images[i], real[i])
        if control is None:  # the last twin: what a re-noised copy of it differs by from itself
            control = control_errors(solver, finder, effects, poses, indices, images, floors)
        row = {"step": step, "effect": effect}
        row |= {m: summary(parts, m, floors) for m in MEASURES}
        row |= {f"{m}_floor": control[m] for m in MEASURES}
        for m in MEASURES:
            row[f"{m}_low"], row[f"{m}_high"] = interval(parts, m, floors, f"{case.campaign}/{case.camera}/{step}/{m}")
        rows.append(row)
    return sorted(rows, key=lambda r: r["step"])


def corner_errors(solver, effects, delta, i):
    """Return {"corners": squared lengths (n,), px^2} by which a twin's corners lie off one held-out capture's."""
    prediction, o = solver.predictor.predict(i, effects, delta), solver.problem.captures[i].observation
    both = np.flatnonzero(o.measured & prediction.measured)
    off = o.corners[both] - corners_in(prediction.features[both])
    return {"corners": (off.reshape(-1, 2) ** 2).sum(1)}


def capture_errors(solver, finder, effects, delta, i, image, real):
    """Return the raw errors of one held-out capture's image under a twin."""
    case, capture = solver.problem, solver.problem.captures[i]
    radiance = case.radiance_of(capture, effects, delta)
    expected = case.image_of(radiance, capture, effects, delta)
    rng = np.random.default_rng(seed_of(case.campaign, case.camera, capture.view.capture, "ladder"))
    noisy = case.image_of(radiance, capture, effects, delta, rng)
    twin = finder.find(noisy)
    truth = case.corners_of(capture, effects, delta)
    available = wholly_inside(truth, capture.view.width, capture.view.height, border=0.0)
    return {
        "intensity": ((image.mean(axis=2) - expected.mean(axis=2)) ** 2).mean(),
        **finder.compare(real, twin, available),
    }


def control_errors(solver, finder, effects, poses, indices, images, floors):
    """Return the floor of each measure: noise of the corners and levels, and a twin against its re-noised self."""
    case, compared = solver.problem, {}
    for i in images:
        capture = case.captures[i]
        radiance = case.radiance_of(capture, effects, poses[i])
        pair = []
        for draw in ("a", "b"):
            rng = np.random.default_rng(seed_of(case.campaign, case.camera, capture.view.capture, "control", draw))
            pair.append(finder.find(case.image_of(radiance, capture, effects, poses[i], rng)))
        truth = case.corners_of(capture, effects, poses[i])
        available = wholly_inside(truth, capture.view.width, capture.view.height, border=0.0)
        compared[i] = finder.compare(*pair, available) | {"intensity": capture.noise_variance}
    out = {m: summary(compared, m, floors) for m in MEASURES[1:5]}
    corner = [(solver.whiteners[i].feature_sd[:, CORNERS] ** 2).reshape(-1, 2).sum(1) for i in indices]
    out["corner_rmse_px"] = float(np.sqrt(np.concatenate(corner).mean()) * floors.get("corners", 1.0))
    out["gap"] = 1.0
    return out


def summary(parts, measure, floors):
    """Return one measure over captures {index: errors}; NaN where nothing was compared."""
    parts = list(parts.values())
    if measure == "gap":
        return overall_gap({k: p["groups"] for k, p in enumerate(parts)}, floors)
    if measure == "corner_rmse_px":
        values = np.concatenate([p["corners"] for p in parts])
        return float(np.sqrt(values.mean())) if len(values) else float("nan")
    if not parts or "intensity" not in parts[0]:
        return float("nan")
    if measure == "intensity_rmse_dn":
        return float(np.sqrt(np.mean([p["intensity"] for p in parts])))
    if measure == "detection_disagreement_pct":
        n = sum(p["available"] for p in parts)
        return 100 * sum(p["disagree"] for p in parts) / n if n else float("nan")
    key = {"delta_distance_cm": "distance", "delta_rotation_deg": "rotation"}[measure]
    values = np.concatenate([p[key] for p in parts])
    return float(np.mean(values)) if len(values) else float("nan")


def interval(parts, measure, floors, seed):
    """Return the 95 % percentile interval of a measure by resampling captures."""
    rng = np.random.default_rng(seed_of(seed))
    keys = list(parts)
    draws = [
        summary({n: parts[k] for n, k in enumerate(rng.choice(keys, len(keys)))}, measure, floors)
        for _ in range(RESAMPLES)
    ]
    draws = np.array(draws)[np.isfinite(draws)]
    return tuple(np.percentile(draws, [2.5, 97.5])) if len(draws) else (float("nan"), float("nan"))
