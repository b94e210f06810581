"""Normal equations of a robust least-squares problem whose captures each have a pose that is eliminated; errors and updates.

Derivatives are {capture index: (Jt, Jp)}: of the whitened prediction by k free parameters (n, k) and by the pose (n, 6).
"""

import numpy as np

from gap.fit.residuals import GROUPS, NU, flatten
from gap.fit.score import group_gaps
from gap.observables import FEATURE_GROUPS, N_FEATURES

SHARED = 0.25  # of the features' floors, what all plates of all captures may have in common
TELLING = 0.25  # squared standard errors from which a step corrects derivatives


def normal_equations(derivatives, groups, nu, prior):
    """Return (H, g, pose blocks) of a Gauss-Newton step of the free parameters, poses eliminated.

    ``groups`` are the captures' residual groups, ``prior`` (H, g) is what the parameters' priors add.
    """
    (H, g), blocks = (part.copy() for part in prior), []
    for i, (Jt, Jp) in derivatives.items():
        H_i, g_i, block = without_pose(flatten(groups[i]), Jt, Jp, nu)
        H, g = H + H_i, g + g_i
        blocks.append((i, *block))
    return H, g, blocks


def step_within(bounds, theta, H, g, blocks, poses, damping):
    """Return (step (k,) of parameters theta within their bounds (lower, upper), poses (n, 6) that go along).

    ``blocks`` are those of ``normal_equations``; ``damping`` adds its share of H's diagonal (Levenberg and Marquardt).
    """
    d = np.linalg.solve(H + np.diag(np.diag(H) * damping + 1e-12), g) if len(g) else np.zeros(0)
    d = np.clip(theta + d, *bounds) - theta
    poses = poses.copy()
    for i, A, b, C in blocks:
        move = solved(A, b - C @ d)
        poses[i, : len(move)] += move
    return d, poses


def solved(A, b):
    """Return x (m, ...) of A x = b, A (m, m) a pose's block; the shortest where a pose that ran off leaves others untold.

    A candidate may drive a camera into the board, where one point's derivatives are all that numbers hold.
    """
    try:
        return np.linalg.solve(A, b)
    except np.linalg.LinAlgError:
        return np.linalg.lstsq(A, b)[0]


def gains_of_step(d, derivatives, groups, blocks, nu):
    """Return the loss (groups,) in the order of GROUPS that a step d (k,) gains to second order, each pose going along.

    ``blocks`` are those of ``normal_equations``.
    """
    out = dict.fromkeys(GROUPS, 0.0)
    for i, A, b, C in blocks:
        Jt, Jp = derivatives[i]
        y = flatten(groups[i])
        after = y - Jt @ d - Jp @ solved(A, b - C @ d)
        gains, at = (y * y - after * after) / (1 + y * y / nu), 0
        for name in GROUPS:
            if name in groups[i]:
                out[name] += gains[at : at + groups[i][name].size].sum()
                at += groups[i][name].size
    return np.array(list(out.values()))


def errors_of(covariance, derivatives, groups, precision, whiteners):
    """Return (errors, cautious errors) (k,) of parameters whose covariance (k, k) holds for residuals of variance 1.

    Residuals scatter less where a floor is more than the noise (what poses may be off by, and priors of ``precision``
    (k,), are declared and count as such), and those of one capture can be wrong together: the greater of what each by
    itself and each capture as a whole makes of the parameters. Cautious errors take a variance of 1 for the former.
    Both hold the part of the features' floors that is the same for all plates and does not average out; errors only as
    much of it as residuals show of the floors. Sources: White, "A heteroskedasticity-consistent covariance matrix
    estimator" (1980); Liang and Zeger, "Longitudinal data analysis using generalized linear models" (1986).
    """
    single, gradients, shared = np.diag(precision), [], 0.0
    for i, (Jt, Jp) in derivatives.items():
        y, w = flatten(groups[i]), whiteners[i]
        each = weighted_without_pose(y, Jp, Jt)
        scattered = each * scatter_of(groups[i])[:, None]
        single = single + scattered.T @ scattered
        gradients.append(each.T @ y)
        floors = np.tile(SHARED * np.diag(w.floor), (len(w.plates), 1, 1))
        shared = shared + response(y, Jt, Jp, w.whitened_features(floors))
    g = np.array(gradients) - np.mean(gradients, axis=0)
    together = g.T @ g * len(g) / max(len(g) - 1, 1)
    single, together = (np.diag(covariance @ meat @ covariance) for meat in (single, together))
    common = covariance @ shared
    seen = common * shares_shown(groups)[: common.shape[1]]  # a board's points have two features alone
    cautious = np.maximum(together, np.diag(covariance))
    with np.errstate(invalid="ignore"):  # what changes nothing has no error: NaN
        return np.sqrt(np.maximum(together, single) + (seen**2).sum(1)), np.sqrt(cautious + (common**2).sum(1))


def shares_shown(groups):
    """Return the shares (19,), at most 1, of plates' features' floors that captures' residual groups show."""
    gaps, shares = group_gaps(groups, {}), np.ones(N_FEATURES)
    for name, part in FEATURE_GROUPS.items():
        shares[part] = min(gaps.get(name, 1.0), 1.0)
    return shares


def without_pose(y, Jt, Jp, nu):
    """Return (H, g, (A, b, C)) of one capture's residuals y (n,), its pose eliminated by the block (A, b, C)."""
    weight = 1 / (1 + y * y / nu)
    wJp = weight[:, None] * Jp
    A = Jp.T @ wJp + 1e-9 * np.eye(Jp.shape[1])
    b = wJp.T @ y
    C = wJp.T @ Jt
    H = Jt.T @ (weight[:, None] * Jt) - C.T @ solved(A, C)
    return H, Jt.T @ (weight * y) - C.T @ solved(A, b), (A, b, C)


def response(y, Jt, Jp, change):
    """Return (k, m): what changes (n, m) of a capture's residuals y (n,) add to the gradient, its pose eliminated."""
    return Jt.T @ weighted_without_pose(y, Jp, change)


def scatter_of(groups):
    """Return the standard deviations (n,) that a capture's residual groups tell of themselves; 1 of what is declared."""
    return flatten(groups | {"pose": np.ones_like(groups["pose"])}) if "pose" in groups else flatten(groups)


def weighted_without_pose(y, Jp, change):
    """Return changes (n, m) of a capture's residuals y (n,) as far as its pose cannot follow, robustly weighted."""
    weight = (1 / (1 + y * y / NU))[:, None]
    back = solved(Jp.T @ (weight * Jp) + 1e-9 * np.eye(Jp.shape[1]), Jp.T @ (weight * change))
    return weight * (change - Jp @ back)


def updated(derivatives, before, after, d, d_poses, scale):
    """Return derivatives after a step of the parameters (k,) and poses (n, 6) that agree with what it changed.

    ``scale`` (k,) are the parameters' precisions. A step within the errors changes less than predictions are repeatable
    by, and tells nothing. Source: C. G. Broyden, "A class of methods for solving nonlinear
    simultaneous equations" (1965).
    """
    length = (scale * d * d).sum()
    if length < TELLING:
        return derivatives
    out = {}
    for i, (Jt, Jp) in derivatives.items():
        missed = flatten(before[i]) - flatten(after[i]) - Jt @ d - Jp @ d_poses[i]
        out[i] = Jt + np.outer(missed, scale * d) / length, Jp
    return out
