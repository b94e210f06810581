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


def image_table(sightings, poses, code_m):
    """Return the sightings of one family and detector, a row an image, with what they are off by.

    side_px, found, flipped; distance_error_m and _pct, TURN, rotation_error_deg, OFF (corners, px): NaN where not found
    corner_px   standard deviation of the corners' coordinates over a pose's draws that are not flipped, and then of these
                distance_scatter_m, rotation_scatter_deg, and distance_predicted_m, rotation_predicted_deg from corner_px
    *_scatter2, *_error2  squares of deviations from the mean, and of errors, in the unit of what corners of 1 px predict
    """
    merged = sightings.merge(poses, on="pose", validate="many_to_one")
    family, number = merged.dictionary.iloc[0], int(merged.id.iloc[0])
    parts = [_of_pose(group.copy(), family, number, code_m) for _, group in merged.groupby("pose", sort=True)]
    return pd.concat(parts, ignore_index=True)


def _of_pose(images, family, number, code_m):
    """Return the images of one pose with what image_table adds."""
    row = next(images.itertuples())
    T, true = pose_of(row), true_corners(family, number, row)
    corners = images[CORNERS].to_numpy(float).reshape(-1, 4, 2)
    errors = pose_errors(corners, T, true, code_m, K)
    images["side_px"] = np.linalg.norm(true - np.roll(true, 1, axis=0), axis=1).mean()
    images["found"] = np.isfinite(errors["distance_error_m"])
    images["flipped"] = errors["flipped"]
    images["distance_error_m"] = errors["distance_error_m"]
    images["distance_error_pct"] = 100 * errors["distance_error_m"] / row.distance_m
    images[TURN] = errors["rotvec_deg"]
    images["rotation_error_deg"] = np.linalg.norm(errors["rotvec_deg"], axis=1)
    images[OFF] = (corners - true).reshape(-1, 8)
    return _with_scatter(images, *unit_covariances(T, code_m, K))


def _with_scatter(images, distance_var, turn_cov):
    """Add what image_table says of scatter, from the covariances for corners off by 1 px."""
    good = images.found & ~images.flipped
    off, turn = images.loc[good, OFF].to_numpy(), images.loc[good, TURN].to_numpy()
    distance = images.loc[good, ["distance_error_m"]].to_numpy()
    corner = spread_of(off) / np.sqrt(len(OFF))
    images["corner_px"] = corner
    images["distance_scatter_m"], images["rotation_scatter_deg"] = spread_of(distance), spread_of(turn)
    images["distance_predicted_m"] = corner * np.sqrt(distance_var)
    images["rotation_predicted_deg"] = corner * np.sqrt(np.trace(turn_cov))
    for name, values, cov in (("distance", distance, np.array([[distance_var]])), ("rotation", turn, turn_cov)):
        images[f"{name}_error2"] = images[f"{name}_scatter2"] = np.nan
        images.loc[good, f"{name}_error2"] = squared_lengths(values, cov)
        if good.sum() > 1 and corner > 0:
            # the mean of few takes part of their scatter with it
            missing = (len(values) - 1) / len(values) * corner**2
            images.loc[good, f"{name}_scatter2"] = squared_lengths(values - values.mean(axis=0), cov) / missing
    return images


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
    rows = []
    for _, group in images.groupby("pose", sort=True):
        good = group[group.found & ~group.flipped]
        first = group.iloc[0]
        rows.append(
            first[[*keys, *PLACES, "side_px"]].to_dict()
            | {
                "draws": len(group),
                "found": int(group.found.sum()),
                "flipped": int(group.flipped.sum()),
                "false_ids": int(group.false_ids.sum()),
                "corner_error_px": float(np.sqrt((good[OFF].to_numpy() ** 2).mean())) if len(good) else np.nan,
                "distance_error_m": good.distance_error_m.mean(),
                "rotation_error_deg": good.rotation_error_deg.mean(),
                "corner_scatter_px": first.corner_px,
            }
            | {name: first[name] for name in SCATTER}
        )
    return pd.DataFrame(rows)


SCATTER = [f"{name}_{what}" for name in ("distance", "rotation") for what in ("scatter", "predicted")]
SCATTER = [f"{name}_{'m' if name.startswith('distance') else 'deg'}" for name in SCATTER]


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


DIRECTIONS = {"distance": 1, "rotation": 3}


def _share(name, share, count):
    """Return a share in percent and Wilson's interval as of ``count`` independent tries."""
    low, high = wilson_interval(round(share * count), count) if count else (np.nan, np.nan)
    return {name: 100 * share, f"{name}_low": 100 * low, f"{name}_high": 100 * high}
