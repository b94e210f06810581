"""Tables of the study: what came of each image, of each pose, of each detector."""

import numpy as np
import pandas as pd

from inputs.tables import CORNERS
from poses_study.errors import pose_errors, ratio_of, spread_of, squared_lengths, unit_covariances
from poses_study.views import PLACES, K, pose_of, true_corners
from reporting.metrics import wilson_interval

MAD = 1.4826  # from a median of absolute values to a standard deviation
TURN = ["turn_x_deg", "turn_y_deg", "turn_z_deg"]
OFF = [f"d{name}" for name in CORNERS]
SCATTER = ["distance_scatter_m", "distance_predicted_m", "rotation_scatter_deg", "rotation_predicted_deg"]
DIRECTIONS = {"distance": 1, "rotation": 3}


def image_table(sightings, poses, code_m):
    """Return the sightings of one family and detector, a row an image, with what they are off by.

    side_px, found, flipped; distance_error_m and _pct, TURN, rotation_error_deg, OFF (corners, px): NaN where not found
    corner_px   standard deviation of the corners' coordinates over a pose's draws that are not flipped, and then of these
                distance_scatter_m, rotation_scatter_deg, and distance_predicted_m, rotation_predicted_deg from corner_px
    *_scatter2, *_error2  squares of deviations from the mean, and of errors, in the unit of what corners of 1 px predict
    """
    images = sightings.merge(poses, on="pose", validate="many_to_one").sort_values(["pose", "draw"], ignore_index=True)
    family, number = images.dictionary.iloc[0], int(images.id.iloc[0])
    corners = images[CORNERS].to_numpy(float).reshape(-1, 4, 2)
    parts = []
    for where in images.groupby("pose").indices.values():
        row = images.iloc[where[0]]
        T, true = pose_of(row), true_corners(family, number, row)
        parts.append(_of_pose(corners[where], T, true, code_m))
    told = {name: np.concatenate([part[name] for part in parts]) for name in parts[0]}
    for names, name in ((TURN, "rotvec_deg"), (OFF, "off")):
        told |= dict(zip(names, told.pop(name).T, strict=True))
    told["distance_error_pct"] = 100 * told["distance_error_m"] / images.distance_m.to_numpy()
    return pd.concat([images, pd.DataFrame(told)], axis=1)


def _of_pose(corners, T, true, code_m):
    """Return {name: (n, ...)} of what image_table adds for the corners (n, 4, 2) of one pose."""
    told = pose_errors(corners, T, true, code_m, K)
    told["off"] = (corners - true).reshape(-1, 8)
    told["found"] = np.isfinite(told["distance_error_m"])
    told["rotation_error_deg"] = np.linalg.norm(told["rotvec_deg"], axis=1)
    side_px = np.linalg.norm(true - np.roll(true, 1, axis=0), axis=1).mean()
    once = {"side_px": side_px} | _add_scatter(told, *unit_covariances(T, code_m, K))
    return told | {name: np.full(len(corners), value) for name, value in once.items()}


def _add_scatter(told, distance_var, turn_cov):
    """Add the squares that image_table tells, return its scatter, from the covariances for corners off by 1 px."""
    good = told["found"] & ~told["flipped"]
    n, corner = good.sum(), spread_of(told["off"][good]) / np.sqrt(len(OFF))
    once = {
        "corner_px": corner,
        "distance_predicted_m": corner * np.sqrt(distance_var),
        "rotation_predicted_deg": corner * np.sqrt(np.trace(turn_cov)),
    }
    kinds = (
        ("distance", "m", told["distance_error_m"][good, None], np.array([[distance_var]])),
        ("rotation", "deg", told["rotvec_deg"][good], turn_cov),
    )
    for name, unit, values, cov in kinds:
        once[f"{name}_scatter_{unit}"] = spread_of(values)
        for square in ("error2", "scatter2"):
            told[f"{name}_{square}"] = np.full(len(good), np.nan)
        told[f"{name}_error2"][good] = squared_lengths(values, cov)
        if corner > 0:
            # the mean of few takes part of their scatter with it
            left = (n - 1) / n * corner**2
            told[f"{name}_scatter2"][good] = squared_lengths(values - values.mean(axis=0), cov) / left
    return once


def corner_sigma(images):
    """Return how far corners are from the truth, pixels, in all images of a detector that are not flipped: the standard
    deviation of a normal distribution of that median. One number, as a user has it who knows the tracker.
    """
    off = images.loc[images.found & ~images.flipped, OFF].to_numpy()
    return float(MAD * np.median(np.abs(off))) if len(off) else np.nan


def with_trust(images):
    """Return the images of one detector with errors in the unit of what ``corner_sigma`` predicts."""
    sigma = corner_sigma(images)
    return images.assign(**{f"{name}_error2": images[f"{name}_error2"] / sigma**2 for name in ("distance", "rotation")})


def by_pose(images):
    """Return a row a pose of one family and detector: where, how often found and flipped, errors without flips, scatter."""
    keys = ["dictionary", "id", "pose", "detector"]
    grouped = images.groupby("pose", sort=True)
    table = grouped[[*keys, *PLACES, "side_px"]].first().set_index("pose", drop=False).rename_axis(None)
    table["draws"] = grouped.size()
    for name in ("found", "flipped", "false_ids"):
        table[name] = grouped[name].sum().astype(int)
    good = images[images.found & ~images.flipped]
    mean = good.assign(square=(good[OFF] ** 2).mean(axis=1)).groupby("pose")
    table["corner_error_px"] = np.sqrt(mean.square.mean())
    for name in ("distance_error_m", "rotation_error_deg"):
        table[name] = mean[name].mean()
    return table.join(grouped[["corner_px", *SCATTER]].first()).rename(columns={"corner_px": "corner_scatter_px"})


def by_detector(images):
    """Return a dict of one family and detector: coverage and flips with intervals, errors without flips, ratios.

    Intervals count poses, not images: draws of one pose are much alike. *_scatter_ratio: seen by predicted scatter;
    *_error_ratio: errors by what ``corner_sigma`` predicts. NaN where nothing was found.
    """
    good = images[images.found & ~images.flipped]
    relative = good.distance_error_pct
    poses, shares = images.pose.nunique(), images.groupby("pose")[["found", "flipped"]].sum()
    seen = shares[shares.found > 0]
    return {
        "dictionary": images.dictionary.iloc[0],
        "detector": images.detector.iloc[0],
        "id": int(images.id.iloc[0]),
        "poses": poses,
        "images": len(images),
        **_share("coverage_pct", images.found.mean(), poses),
        "false_ids": int(images.false_ids.sum()),
        **_share("flip_rate_pct", images.flipped.sum() / images.found.sum() if len(seen) else np.nan, len(seen)),
        "corner_error_px": corner_sigma(images),
        "corner_scatter_px": float(images.drop_duplicates("pose").corner_px.median()),
        "distance_error_pct": float(relative.abs().median()),
        "distance_error_95_pct": float(relative.abs().quantile(0.95)),
        "distance_bias_pct": float(relative.median()),
        "rotation_error_deg": float(good.rotation_error_deg.median()),
        "rotation_error_95_deg": float(good.rotation_error_deg.quantile(0.95)),
        **{f"{name}_scatter_ratio": ratio_of(images[f"{name}_scatter2"], n) for name, n in DIRECTIONS.items()},
        **{f"{name}_error_ratio": ratio_of(images[f"{name}_error2"], n) for name, n in DIRECTIONS.items()},
    }


def _share(name, share, count):
    """Return a share in percent and Wilson's interval as of ``count`` independent tries."""
    low, high = wilson_interval(round(share * count), count) if count else (np.nan, np.nan)
    return {name: 100 * share, f"{name}_low": 100 * low, f"{name}_high": 100 * high}
