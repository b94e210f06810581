"""Two sets of captures by one camera as one problem: what is common is fitted to both, poses to each capture."""

from dataclasses import replace

import numpy as np

from gap.boards.board import BoardCase
from rig.geometry import N_POSE

SETS = ("before", "after")  # what prefixes the captures' names: two sets may use the same ones


def joined(before, after):
    """Return (problem, set of each capture (n,): 0 or 1) of two gap.problem.Case, or board.BoardCase, of one camera.

    Captures without anything measured are left out. The first gives the scene; of poses the wider prior holds.
    """
    if isinstance(before, BoardCase):
        before, after = on_the_same_points(before, after)
    captures, belongs = [], []
    for k, problem in enumerate((before, after)):
        for capture in problem.captures:
            if capture.observation.measured.any():
                name = f"{SETS[k]}/{capture.view.capture}"
                captures.append(replace(capture, view=replace(capture.view, capture=name)))
                belongs.append(k)
    before = _with_open(before, after)
    return replace(before, captures=captures), np.array(belongs)


def _with_open(problem, other):
    """Return a problem in which all that it or another leaves open is open, and of poses the wider prior holds."""
    own = dict.fromkeys([*problem.own, *other.own])
    sigmas = [dict(zip(p.own, p.sigma_pose[N_POSE:], strict=True)) for p in (other, problem)]
    of_own = [(sigmas[0] | sigmas[1])[key] for key in own]
    sigma_pose = np.maximum(problem.sigma_pose[:N_POSE], other.sigma_pose[:N_POSE])
    alone = {name for name, _ in own}
    nuisances = {n: p for n, p in (*problem.nuisances, *other.nuisances) if n not in alone}
    return replace(
        problem, own=tuple(own), sigma_pose=np.concatenate([sigma_pose, of_own]), nuisances=tuple(nuisances.items())
    )


def on_the_same_points(*problems):
    """Return BoardCases whose points are those that any of them has, all with the noise of the first.

    Noise is told beyond the lens of the first's calibration, which another lens would be taken for.
    """
    points = np.unique(np.concatenate([p.points for p in problems]).round(9), axis=0)
    return [_with_points(p, points, problems[0].noise_px) for p in problems]


def _with_points(problem, points, noise_px):
    """Return a BoardCase with other points (p, 3), its own among them, and the noise of their x and y."""
    place = np.abs(points[:, None] - problem.points[None]).max(2).argmin(0)
    captures = [replace(c, observation=_placed(c.observation, place, len(points), noise_px)) for c in problem.captures]
    return replace(problem, captures=captures, points=points, noise_px=noise_px)


def _placed(observation, place, n, noise_px):
    """Return an Observation of n points with some noise, a board's k-th being the ``place[k]``-th; the rest are not seen."""

    def spread(values, fill):
        out = np.full((n, *values.shape[1:]), fill, values.dtype)
        out[place] = values
        return out

    return replace(
        observation,
        features=spread(observation.features, np.nan),
        information=np.tile(np.eye(2) / noise_px**2, (n, 1, 1)),
        measured=spread(observation.measured, False),
        colour=spread(observation.colour, np.nan),
    )
