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
    motions = by_motion(problem, equations)
    sigma_rad = usual_turn_rad(motions, equations, nu)
    return {i: _with_prior(*equations[i], motions[i] * sigma_rad) for i in equations} if sigma_rad else None


def usual_turn_rad(motions, equations, nu):
    """Return the standard deviation, rad, of how far photographs turn while they are read, 0.0 where none makes what is left more
    likely; motions as of ``by_motion``, the rest as of ``with_motion``.
    """
    left = [without_pose(y, motions[i], Jp, nu)[:2] for i, (y, _, Jp) in equations.items()]
    best = max(SIGMAS_RAD, key=lambda sigma: _log_likelihood(left, sigma))
    return float(best) if _log_likelihood(left, best) > 0 else 0.0


def when_read(rows, height):
    """Return when rows, pixels, of an image are read: from -0.5, the first row, to 0.5."""
    return (rows + 0.5) / height - 0.5


def distance_m(problem, capture):
    """Return how far a board is away in a capture at its nominal pose."""
    return transform(capture.view.T_cam_world, problem.points.mean(axis=0))[2]


def by_motion(problem, equations):
    """Return {capture: d (twin, whitened) / d motion (n, 6)}: turns, rad; steps, shares of the distance."""
    return {i: _by_motion(problem, problem.captures[i], Jp) for i, (_, _, Jp) in equations.items()}


def _by_motion(problem, capture, Jp):
    when = when_read(capture.observation.features[capture.observation.measured][:, 1], capture.view.height)
    of_rows = np.zeros(len(Jp))  # the pose's prior comes last
    of_rows[: 2 * len(when)] = np.repeat(when, 2)
    return of_rows[:, None] * Jp[:, :N_POSE] * np.repeat([1.0, distance_m(problem, capture)], 3)


def _log_likelihood(left, sigma):
    """Return twice the logarithm of how much more likely what is left, [(H (6, 6), g (6,))] of motions, is with ``sigma``."""
    eye = np.eye(N_POSE)
    return sum(g @ np.linalg.solve(H + eye / sigma**2, g) - np.linalg.slogdet(eye + sigma**2 * H)[1] for H, g in left)


def _with_prior(y, Jt, Jp, motion):
    """Return an equation (y, Jt, Jp) with columns of a motion in standard deviations, and the rows of its prior."""
    none, k = np.zeros((N_POSE, Jt.shape[1])), Jp.shape[1]
    own = np.block([[Jp, motion], [np.zeros((N_POSE, k)), np.eye(N_POSE)]])
    return np.append(y, np.zeros(N_POSE)), np.vstack([Jt, none]), own
