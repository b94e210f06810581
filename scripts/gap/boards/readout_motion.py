"""Photographs taken by hand: the camera or the board moves while rows are read, in each photograph otherwise.

To first order a point then lies off by what the pose moves from the first row to the last, times when the point's row is read.
That is free in each photograph, about no motion; how much is usual the photographs say themselves. Source: B. Efron and
C. Morris, "Stein's estimation rule and its competitors" (1973).
"""

import numpy as np

from gap.fit.normal_equations import without_pose
from rig.geometry import N_POSE, transform

SIGMAS_RAD = 10.0 ** np.arange(-5, -0.9, 0.25)  # of how far photographs turn while they are read, that are tried


def with_motion(problem, equations, nu):
    """Return equations {capture: (y (n,), Jt (n, k), Jp (n, 6))} of a BoardCase with a motion of each capture's own beside its
    pose, Jp (n + 6, 12) and the prior's rows last; None where motion makes what is left no more likely.

    y are residuals of a twin in which nothing moves, ``nu`` is that of their robust loss.
    """
    motions = {i: _by_motion(problem.captures[i], problem.points, Jp) for i, (_, _, Jp) in equations.items()}
    left = [without_pose(y, motions[i], Jp, nu)[:2] for i, (y, _, Jp) in equations.items()]
    sigma_rad = max(SIGMAS_RAD, key=lambda sigma: _log_likelihood(left, sigma))
    if _log_likelihood(left, sigma_rad) <= 0:
        return None
    return {i: _with_prior(*equations[i], motions[i] * sigma_rad) for i in equations}


def _by_motion(capture, points, Jp):
    """Return d (twin, whitened) / d motion (n, 6) of a capture of points (p, 3): turns, rad; steps, shares of the distance."""
    seen = capture.observation.features[capture.observation.measured]
    when = (seen[:, 1] + 0.5) / capture.view.height - 0.5  # from -0.5, the first row, to 0.5
    away_m = transform(capture.view.T_cam_world, points.mean(axis=0))[2]
    of_rows = np.zeros(len(Jp))  # the pose's prior comes last
    of_rows[: 2 * len(when)] = np.repeat(when, 2)
    return of_rows[:, None] * Jp[:, :N_POSE] * np.repeat([1.0, away_m], 3)


def _log_likelihood(left, sigma):
    """Return twice the logarithm of how much more likely what is left, [(H (6, 6), g (6,))] of motions, is with ``sigma``."""
    eye = np.eye(N_POSE)
    return sum(g @ np.linalg.solve(H + eye / sigma**2, g) - np.linalg.slogdet(eye + sigma**2 * H)[1] for H, g in left)


def _with_prior(y, Jt, Jp, motion):
    """Return an equation (y, Jt, Jp) with columns of a motion in standard deviations, and the rows of its prior."""
    none, k = np.zeros((N_POSE, Jt.shape[1])), Jp.shape[1]
    own = np.block([[Jp, motion], [np.zeros((N_POSE, k)), np.eye(N_POSE)]])
    return np.append(y, np.zeros(N_POSE)), np.vstack([Jt, none]), own
