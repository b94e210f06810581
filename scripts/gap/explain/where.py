"""Where the twin fails: how much of each observable's gap a covariate explains on captures that were held out."""

import numpy as np
import pandas as pd

from gap.measure.regions import FIELD_COLUMNS, FIELD_ROWS
from gap.observables import COLOUR_FEATURES, COLUMN, FEATURES, NOISE_FEATURES, corners_in
from rig.geometry import invert_pose, transform

COVARIATES = (
    "distance_m", "incidence_deg", "image_radius", "azimuth_deg", "row_px", "column_px", "height_m", "tilt_deg",
    "level_dn", "trial",
)  # fmt: skip
BINS = 5
EVERYWHERE = "everywhere"
ADDS = 0.05  # share that a covariate must explain beyond what is alike everywhere
MAX_PER_OBSERVABLE = 2


def plate_gaps(case, effects, poses, predictions):
    """Return a table, a row a measured plate and capture: covariates, and real minus twin of every plate feature.

    Corners are summed up as ``dx_px``, ``dy_px`` (mean shift), ``d_radial_px`` (away from the image's centre),
    ``d_scale`` (relative growth) and kept singly as well. ``level_dn`` is the ground's in the twin: the capture's would have
    the gap in it. Units as in gap.observables.
    """
    tables, (names, places, normals) = [], case.places()
    for i, prediction in predictions.items():
        capture = case.captures[i]
        o, view = capture.observation, case.view_of(capture, effects, poses[i])
        k = np.flatnonzero(o.measured & prediction.measured)
        if not len(k):
            continue
        gap = o.features[k] - prediction.features[k]
        corners = corners_in(prediction.features[k])
        shift = corners_in(gap)
        centre = corners.mean(1)
        spokes = corners - centre[:, None]
        in_camera = transform(view.T_cam_world, places[k])
        normal = normals[k] @ view.T_cam_world[:3, :3].T
        distance = np.linalg.norm(in_camera, axis=1)
        from_axis = centre - [(view.width - 1) / 2, (view.height - 1) / 2]
        radius = np.linalg.norm(from_axis, axis=1)
        eye = invert_pose(view.T_cam_world)
        forward = eye[:3, 2]
        table = pd.DataFrame(
            {
                "capture": view.capture,
                "station": view.station,
                "plate": [names[j] for j in k],
                "distance_m": distance,
                "incidence_deg": np.degrees(np.arccos(np.clip(-(in_camera * normal).sum(1) / distance, -1, 1))),
                "image_radius": radius / np.hypot(view.width, view.height) * 2,
                "azimuth_deg": np.degrees(np.arctan2(from_axis[:, 1], from_axis[:, 0])),
                "row_px": centre[:, 1],
                "column_px": centre[:, 0],
                "height_m": eye[2, 3],
                "tilt_deg": np.degrees(np.arcsin(np.clip(-forward[2], -1, 1))),
                "trial": capture.trial,
                "dx_px": shift[..., 0].mean(1),
                "dy_px": shift[..., 1].mean(1),
                "d_radial_px": (shift.mean(1) * from_axis).sum(1) / np.maximum(radius, 1e-9),
            }
        )
        if case.codes:
            ground_dn = case.codes.nominal_dn[2]
            table["level_dn"] = ground_dn + prediction.features[k, COLUMN["ground"]]  # off its nominal level
            table["d_scale"] = (shift * spokes).sum((1, 2)) / (spokes**2).sum((1, 2))
        colour = (o.colour[k] - prediction.colour[k]).T
        measured = dict(zip(FEATURES, gap.T, strict=False)) | dict(zip(COLOUR_FEATURES, colour, strict=False))
        tables.append(table.assign(**measured))
    return pd.concat(tables, ignore_index=True) if tables else pd.DataFrame(columns=["capture", "plate"])


EXPLAINED = {
    "corners": ("dx_px", "dy_px", "d_radial_px", "d_scale"),
    "levels": ("white", "black", "ground"),
    "edges": ("spread_x", "spread_y", "overshoot", "ink"),
    "colour": ("red_white", "red_dx", "red_dy", "blue_white", "blue_dx", "blue_dy"),
}


def explained_shares(table, train_captures):
    """Return [{"observable", "group", "covariate", "share"}], largest share first.

    Out of sample: means in bins of the covariate are learned on the training captures and predict the others; the share
    is one minus the ratio of the residual's to the gap's mean square about zero. ``EVERYWHERE`` is one bin of all; of the
    others, those two that explain most are named, where they explain more than it.
    """
    train = table.capture.isin(train_captures)
    if train.all() or not train.any():  # nothing to predict, or nothing to learn from
        return []
    rows = []
    for group, observables in EXPLAINED.items():
        for observable in (o for o in observables if o in table):
            gap = table[observable].clip(*table[observable].quantile([0.01, 0.99]))
            everywhere = _share(gap, pd.Series(0, index=gap.index), train)
            shares = {name: _share(gap, _bins(table[name]), train) for name in COVARIATES if name in table}
            best = sorted((n for n in shares if shares[n] > everywhere + ADDS), key=lambda n: (-shares[n], n))
            for covariate, share in [(EVERYWHERE, everywhere), *((n, shares[n]) for n in best[:MAX_PER_OBSERVABLE])]:
                if share > 0:
                    entry = {"observable": observable, "group": group, "covariate": covariate, "share": round(share, 4)}
                    rows.append(entry)
    return sorted(rows, key=lambda r: (-r["share"], r["observable"], r["covariate"]))


def _bins(covariate):
    """Return the bin (n,) of each value of a covariate: fifths, or the values themselves where there are few."""
    edges = np.unique(covariate.quantile(np.linspace(0, 1, BINS + 1)))
    if len(edges) < 3:
        edges = np.unique(covariate)
    return pd.Series(np.digitize(covariate, edges[1:-1]), index=covariate.index)


def _share(gap, bins, train):
    """Return the share of the held-out gap (n,) that its training means in bins predict, 0 to 1."""
    before = float((gap[~train] ** 2).mean())
    predicted = bins[~train].map(gap[train].groupby(bins[train]).mean()).fillna(0)
    return max(0.0, 1 - float(((gap[~train] - predicted) ** 2).mean()) / before) if before > 0 else 0.0


def field_gaps(case, predictions):
    """Return a table of the ground's and sky's levels over the frame, real minus twin, grey levels, by grid cell."""
    rows = []
    for i, prediction in predictions.items() if case.codes else ():
        gap = case.captures[i].observation.field - prediction.field
        grid = gap.reshape(2, FIELD_ROWS, FIELD_COLUMNS)
        for surface, values in zip(("ground", "sky"), grid, strict=True):
            seen = np.argwhere(np.isfinite(values)).tolist()
            rows += [(case.captures[i].view.capture, surface, r, c, float(values[r, c])) for r, c in seen]
    return pd.DataFrame(rows, columns=["capture", "surface", "row", "column", "gap_dn"])


def noise_gaps(case, predictions):
    """Return a table of the noise features, real and twin (natural logarithms, see gap.measure.regions)."""
    rows = []
    for i, prediction in predictions.items():
        if prediction.noise is None:
            continue
        o = case.captures[i].observation
        for n, name in enumerate(NOISE_FEATURES):
            numbers = (float(of[n]) for of in (o.noise, prediction.noise, o.noise_se))
            rows.append((case.captures[i].view.capture, name, *numbers))
    return pd.DataFrame(rows, columns=["capture", "feature", "real", "twin", "se"])
