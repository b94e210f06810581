"""Which effect is missing when only points are known: hand-held photographs of a board, null intrinsics, no levels.

Poses are free; the focal length of the ideal twin (fx = fy, centre of the image) is fitted with every candidate.
Only effects that move image points can be named; everything else is said not to have been looked at.
"""

from dataclasses import dataclass, replace

import numpy as np

from effects import library, pipeline
from effects.base import View
from gap.parameters import bounds_of, get_parameter, priors_of, small_step, with_parameters
from gap.residuals import NU, RHO_NOISE, rho
from rig.geometry import camera_matrix, make_pose, perturb_pose, project

FOCAL_STEP = 1e-5
# Where a free focal length is told apart from an effect: any view with the ground in sight
SOME_VIEW = View(
    K=camera_matrix(600.0, 600.0, 320.0, 240.0), width=640, height=480, margin=0,
    T_cam_world=make_pose([0.0, 0.0, 0.0], [0.0, 0.0, 1.0]), camera="", capture="", station="",
)  # fmt: skip
SCALED_PX = 1e-6  # off a scaling about the principal point, up to which a map is one


@dataclass
class BoardView:
    """One photograph: board points (n, 3), metres, image points (n, 2), pixels, and a first pose T_cam_world."""

    view: object
    board: np.ndarray
    image: np.ndarray


def local_noise_px(views):
    """Return the standard deviation per axis of corners about a smooth map of their own view.

    A cubic polynomial in the coordinates that a homography predicts takes up pose, lens and paper; what is left is
    corner noise. None where no view has enough points.
    """
    squares, freedom = 0.0, 0
    for v in views:
        n = len(v.image)
        if n < 24:
            continue
        p = project(v.view.K, v.view.T_cam_world, v.board)
        q = (p - p.mean(0)) / max(p.std(), 1e-9)
        x, y = q.T
        powers = np.stack([x**i * y**j for i in range(4) for j in range(4 - i)], axis=1)
        residual = v.image - powers @ np.linalg.lstsq(powers, v.image, rcond=None)[0]
        scale = 1.4826 * np.median(np.abs(residual - np.median(residual, 0)), axis=0)
        squares += (scale**2).sum() * (n - powers.shape[1])
        freedom += 2 * (n - powers.shape[1])
    return float(np.sqrt(squares / freedom)) if freedom else None


def predict(v, focal, effects, delta):
    """Return image points (n, 2) of a view with focal length (pixels), effects and a pose moved by delta (6,)."""
    K = camera_matrix(focal, focal, v.view.K[0, 2], v.view.K[1, 2])
    view = replace(v.view, K=K, T_cam_world=perturb_pose(v.view.T_cam_world, delta))
    pixels = project(K, view.T_cam_world, v.board)
    return pipeline.map_points(pixels, view, effects) if effects else pixels


def residuals(v, focal, effects, delta, sigma):
    """Return whitened residuals (2n,) of a view."""
    e = (v.image - predict(v, focal, effects, delta)) / sigma
    return np.nan_to_num(e, nan=1e3).ravel()


def _pose_columns(v, focal, effects, delta, sigma):
    columns = []
    for k in range(6):
        h = np.zeros(6)
        h[k] = 1e-6
        columns.append(
            -(residuals(v, focal, effects, delta + h, sigma) - residuals(v, focal, effects, delta - h, sigma)) / 2e-6
        )
    return np.stack(columns, axis=1)


def fit(views, effects, free, focal, poses, sigma, fit_focal=True, iterations=25, scale=64.0):
    """Fit the focal length, free parameters and poses; return (focal, effects, poses, covariance, converged).

    Robust loss annealed from ``scale`` times its width; covariance of the free parameters.
    """
    effects = [(n, dict(p)) for n, p in effects]
    theta = np.array([np.log(focal)] + [get_parameter(effects, f) for f in free])
    steps = np.array([FOCAL_STEP] + [small_step(f) for f in free])
    lower, upper = bounds_of(free)
    lower, upper = np.append(theta[0] - 1.5, lower), np.append(theta[0] + 1.5, upper)
    k = len(theta)
    null, precision = (np.append(0.0, part) for part in priors_of(free))
    best, damping, converged = np.inf, 1e-6, False
    poses = poses.copy()

    def total(theta, poses, nu):
        e = with_parameters(effects, free, theta[1:])
        return (precision * (theta - null) ** 2).sum() + sum(
            (nu * np.log1p(residuals(v, np.exp(theta[0]), e, poses[i], sigma) ** 2 / nu)).sum()
            for i, v in enumerate(views)
        )

    for _ in range(iterations):
        nu = NU * scale**2
        H, g, blocks = np.diag(precision), precision * (null - theta), []
        current = with_parameters(effects, free, theta[1:])
        loss = total(theta, poses, nu)
        for i, v in enumerate(views):
            y = residuals(v, np.exp(theta[0]), current, poses[i], sigma)
            weight = 1 / (1 + y * y / nu)
            Jp = _pose_columns(v, np.exp(theta[0]), current, poses[i], sigma)
            Jt = np.zeros((len(y), k))
            for n in range(0 if fit_focal else 1, k):
                h = np.zeros(k)
                h[n] = steps[n]
                pair = [
                    residuals(v, np.exp(t[0]), with_parameters(effects, free, t[1:]), poses[i], sigma)
                    for t in (theta + h, theta - h)
                ]
                Jt[:, n] = -(pair[0] - pair[1]) / (2 * steps[n])
            A = Jp.T @ (weight[:, None] * Jp)
            b, C = Jp.T @ (weight * y), Jp.T @ (weight[:, None] * Jt)
            H += Jt.T @ (weight[:, None] * Jt) - C.T @ np.linalg.solve(A, C)
            g += Jt.T @ (weight * y) - C.T @ np.linalg.solve(A, b)
            blocks.append((A, b, C))
        for _ in range(6):
            d = np.linalg.solve(H + np.diag(np.diag(H) * damping + 1e-9), g)
            if not fit_focal:
                d[0] = 0
            d = np.clip(theta + d, lower, upper) - theta
            moved = np.array([p + np.linalg.solve(A, b - C @ d) for p, (A, b, C) in zip(poses, blocks, strict=True)])
            if total(theta + d, moved, nu) <= loss * (1 + 1e-9):
                break
            damping = max(damping, 1e-4) * 10
        else:
            converged = scale <= 1
            if converged:
                break
            scale = max(1.0, scale * 0.5)
            continue
        theta, poses = theta + d, moved
        damping = max(damping * 0.1, 1e-9)
        if scale <= 1 and abs(best - loss) < 1e-6 * loss:
            converged = True
            break
        best = loss
        scale = max(1.0, scale * 0.5)
    covariance = np.linalg.pinv(H)[1:, 1:]
    return float(np.exp(theta[0])), with_parameters(effects, free, theta[1:]), poses, covariance, converged


def held_out(views, effects, focal, sigma):
    """Fit only the poses of the views; return [whitened residuals (2n,)]."""
    out = []
    for v in views:
        _, _, poses, _, _ = fit([v], effects, [], focal, np.zeros((1, 6)), sigma, fit_focal=False)
        out.append(residuals(v, focal, effects, poses[0], sigma))
    return out


def gap_of(parts):
    """Return the gap of whitened residuals, in units of the floor."""
    return float(np.sqrt(rho(np.concatenate(parts)).mean() / RHO_NOISE))


def rms_px(parts, sigma):
    """Return the RMS length of the residual vectors in pixels."""
    e = np.concatenate(parts) * sigma
    return float(np.sqrt(2 * (e**2).mean()))


def point_effects():
    """Return the names of the effects that board photographs can show: maps of points that are no other focal length."""
    return [
        name
        for name in library.available_effects()
        if library.is_pure_geometry(name) and library.moves_points(name) and not scales_alone(name)
    ]


def scales_alone(name):
    """Return whether all that an effect does is to scale the image about the principal point."""
    xy = np.stack(np.meshgrid([20.0, 150.0, 500.0], [30.0, 300.0, 460.0]), axis=-1).reshape(-1, 2)
    away = xy - SOME_VIEW.K[:2, 2]
    for key, p in library.parameters_of(name).items():
        moved = pipeline.map_points(xy, SOME_VIEW, [(name, {key: p.null + p.matters})]) - xy
        scale = (moved * away).sum() / (away * away).sum()
        if np.abs(moved - scale * away).max() > SCALED_PX:
            return False
    return True
