"""The shape of a board as photographs show it: paper that is not flat, faults of the print, what the finder makes of each point.

It is the same in all photographs of a board, so it is estimated from them, one small offset a point, and says nothing of the
camera. Source: K. H. Strobl and G. Hirzinger, "More accurate pinhole camera calibration with imperfect planar target" (2011).
"""

import numpy as np

from gap.fit.residuals import NU

STEP_M = 1e-5  # of derivatives
PRIOR_SHARE = 0.002  # of the board's longer side, an offset's standard deviation


def offsets_of(problem, twin, belongs, indices):
    """Return offsets (p, 3), metres, of a BoardCase's points with which a JointTwin shows them where captures do.

    belongs (n,) is the set of each capture. Each point's least squares over the captures, weighted as residuals are, with a
    prior about no offset.
    """
    points = problem.points
    prior = 1 / (PRIOR_SHARE * np.ptp(points[:, :2], axis=0).max()) ** 2
    H, g = np.tile(prior * np.eye(3), (len(points), 1, 1)), np.zeros((len(points), 3))
    for i in indices:
        capture, effects = problem.captures[i], list(twin.effects[belongs[i]])
        here = problem.corners_of(capture, effects, twin.poses[i])[:, 0]
        moved = [
            problem.corners_of(capture, effects, twin.poses[i], (points + step)[:, None])[:, 0]
            for step in STEP_M * np.eye(3)
        ]
        J = np.stack([m - here for m in moved], axis=-1) / STEP_M
        whiten = np.linalg.cholesky(capture.observation.information).transpose(0, 2, 1)
        J, off = whiten @ J, (whiten @ (capture.observation.features - here)[..., None])[..., 0]
        seen = capture.observation.measured & np.isfinite(off).all(1) & np.isfinite(J).all((1, 2))
        weight = 1 / (1 + off[seen] ** 2 / NU)
        H[seen] += J[seen].transpose(0, 2, 1) @ (weight[..., None] * J[seen])
        g[seen] += np.einsum("pij,pi->pj", J[seen], weight * off[seen])
    return np.linalg.solve(H, g[..., None])[..., 0]
