"""The statistics behind Tables 1 and 2: counts with intervals, agreement, pose differences, flips.

docs/metrics.md says in words what each means and why it is defined so.
"""

import numpy as np
from scipy.spatial.transform import Rotation

CONFIDENCE = 0.95
RESAMPLES = 2000
# Solutions closer than this are one pose for any use; near a frontal view both merge and swap by chance.
FLIP_DEG = 10.0


def wilson_interval(successes, trials, confidence=CONFIDENCE):
    """Return (low, high) of Wilson's score interval of a share, both in 0..1; NaN without trials.

    Source: Wilson, JASA 22 (1927) 209.
    """
    from scipy.stats import binomtest  # a second to import, for tables alone

    if trials == 0:
        return np.nan, np.nan
    interval = binomtest(successes, trials).proportion_ci(confidence, method="wilson")
    return float(interval.low), float(interval.high)


def cohen_kappa(both, only_real, only_twin, neither):
    """Return Cohen's kappa of the 2 x 2 table of counts (numbers or arrays), at most 1.

    NaN where chance alone would agree always (both sides always say the same one thing).
    Source: Cohen, Educational and Psychological Measurement 20 (1960) 37.
    """
    both, only_real, only_twin, neither = (np.asarray(a, float) for a in (both, only_real, only_twin, neither))
    n = both + only_real + only_twin + neither
    with np.errstate(invalid="ignore", divide="ignore"):
        observed = (both + neither) / n
        real, twin = (both + only_real) / n, (both + only_twin) / n
        chance = real * twin + (1 - real) * (1 - twin)
        return np.where(chance < 1, (observed - chance) / (1 - chance), np.nan)


def resampled_sums(sums_by_capture, rng, resamples=RESAMPLES):
    """Return sums (resamples, k) over captures drawn with replacement, from the sums of each capture (n, k).

    Markers of one capture share its pose and its errors, so captures are drawn, not markers.
    """
    n = len(sums_by_capture)
    weights = rng.multinomial(n, np.full(n, 1 / n), size=resamples)
    return weights @ np.asarray(sums_by_capture, float)


def percentile_interval(values, confidence=CONFIDENCE):
    """Return (low, high) of the finite resampled values; NaN where there is none."""
    values = values[np.isfinite(values)]
    if not len(values):
        return np.nan, np.nan
    return tuple(np.quantile(values, [0.5 - confidence / 2, 0.5 + confidence / 2]))


def mean_with_interval(values, captures, rng):
    """Return (mean, low, high) of values (n,) whose captures (n,) are resampled; NaN where there are too few.

    One capture alone tells nothing of the spread between captures: its interval is NaN.
    """
    if not len(values):
        return np.nan, np.nan, np.nan
    _, index = np.unique(captures, return_inverse=True)
    sums = np.stack([np.bincount(index, values), np.bincount(index)], axis=1)
    if len(sums) < 2:
        return float(np.mean(values)), np.nan, np.nan
    drawn = resampled_sums(sums, rng)
    return (float(np.mean(values)), *percentile_interval(drawn[:, 0] / drawn[:, 1]))


def kappa_with_interval(real, twin, captures, rng):
    """Return (kappa, low, high) of two boolean arrays (n,), captures (n,) resampled."""
    if not len(real):
        return np.nan, np.nan, np.nan
    cells = np.stack([real & twin, real & ~twin, ~real & twin, ~real & ~twin], axis=1)
    kappa = float(cohen_kappa(*cells.sum(axis=0)))
    _, index = np.unique(captures, return_inverse=True)
    sums = np.stack([np.bincount(index, cell) for cell in cells.T], axis=1)
    if len(sums) < 2 or np.isnan(kappa):
        return kappa, np.nan, np.nan
    return (kappa, *percentile_interval(cohen_kappa(*resampled_sums(sums, rng).T)))


def relative_rotvec_deg(rvec_real, rvec_twin):
    """Return rotation vectors (n, 3), degrees, camera's axes, that take the twin's marker to the real one's.

    Rotation vectors do not subtract; R_real R_twin^T is the difference, and its length the geodesic angle.
    """
    real, twin = Rotation.from_rotvec(rvec_real), Rotation.from_rotvec(rvec_twin)
    return np.degrees((real * twin.inv()).as_rotvec())


def angle_deg(rvec_a, rvec_b):
    """Return geodesic angles (n,) in degrees between rotation vectors (n, 3)."""
    return np.linalg.norm(relative_rotvec_deg(rvec_a, rvec_b), axis=1)


def is_flipped(real, real_alt, twin, twin_alt):
    """Return which pairs (n,) chose opposite solutions of the planar ambiguity, from rotation vectors (n, 3).

    A plane seen from afar has two poses that fit almost equally well. Of the two ways to match both sides'
    solutions the one with the smaller sum of angles is right; if it crosses, one side flipped. Pairs that
    agree to FLIP_DEG are never called flipped, nor are pairs without a second solution (NaN).
    """
    flipped = np.zeros(len(real), bool)
    known = np.isfinite(np.hstack([real, real_alt, twin, twin_alt])).all(axis=1)
    if known.any():
        r, ra, t, ta = (a[known] for a in (real, real_alt, twin, twin_alt))
        straight = angle_deg(r, t)
        crossed = angle_deg(r, ta) + angle_deg(ra, t)
        flipped[known] = (straight > FLIP_DEG) & (crossed < straight + angle_deg(ra, ta))
    return flipped
