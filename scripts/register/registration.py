"""The pose of a capture from all its markers, with the campaign's tolerance as prior where a nominal pose is known."""

from dataclasses import replace

import cv2
import numpy as np
from scipy.optimize import least_squares

from effects import pipeline
from rig.geometry import invert_pose, make_pose, perturb_pose, project
from rig.plates import marker_corners_plate

CORNER_SIGMA_PX = 0.5  # least standard deviation of a detected corner
HUBER = 3.0  # residuals beyond so many standard deviations count by their length, not its square
NO_PRIOR = np.full(6, np.inf)
MIN_PRIOR = 1e-9  # rad and m: a tolerance of zero; its weight 1 / sigma^2 stays finite
BEHIND_PX = 1e4  # residual of a point behind the camera


def prior_of(tolerance):
    """Return the standard deviations (6,), rad then m, of the prior of a pose about its nominal one.

    tolerance is scene.json's: a dict of ``position_m`` and ``angle_deg``, at least ``MIN_PRIOR`` each, or None where
    nothing is known: ``NO_PRIOR``.
    """
    if tolerance is None:
        return NO_PRIOR
    sigma = np.array([np.radians(tolerance["angle_deg"])] * 3 + [tolerance["position_m"]] * 3)
    return np.maximum(sigma, MIN_PRIOR)


def ideal_lens(pixels, _):
    """Return the pixels of a pinhole, as they are: a lens that moves no point, whatever the pose."""
    return pixels


def lens_of(view, effects):
    """Return the function (ideal pixels (..., 2), T_cam_world) that says where a twin's effects [(name, parameters)] move them;
    ``view`` is the effects.base.View of a capture but for its pose.
    """
    if not pipeline.has_geometry(effects):
        return ideal_lens
    return lambda pixels, T: pipeline.map_points(pixels.reshape(-1, 2), replace(view, T_cam_world=T), effects).reshape(
        pixels.shape
    )


def register_pose(points_world, pixels, K, T_start, sigma_pose, lens=ideal_lens):
    """Fit T_cam_world to points (n, 3) and pixels (n, 2) of the pinhole behind a ``lens_of``, robustly (Huber 1964).

    T_start (4, 4) is where the fit starts and where the prior has its mean; sigma_pose (6,) the prior's standard
    deviations (rad, m) in the camera's frame, inf for none. The corners' scatter is the larger of 0.5 px and what the
    residuals themselves show (from their median), as a lens that the pinhole lacks moves corners too.
    Return (T_cam_world, standard errors (6,) in the camera's frame, RMS length of the residuals in pixels).
    """

    def errors_px(delta):
        T = perturb_pose(T_start, delta)
        e = lens(project(K, T, points_world), T) - pixels
        return np.nan_to_num(e, nan=BEHIND_PX).ravel()

    delta, sigma_px = np.zeros(6), CORNER_SIGMA_PX
    for _ in range(2):  # the second time with the scatter that the first has shown
        fit = least_squares(
            lambda d, s=sigma_px: np.concatenate([errors_px(d) / s, d / sigma_pose]),
            delta,
            loss=lambda z: huber_but_prior(z, 2 * len(points_world)),
            x_scale=1e-3,
        )
        delta = fit.x
        sigma_px = max(CORNER_SIGMA_PX, 1.4826 * np.median(np.abs(errors_px(delta))))
    se = np.sqrt(np.diag(np.linalg.pinv(fit.jac.T @ fit.jac)))
    rms = np.sqrt((errors_px(delta) ** 2).sum() / len(points_world))
    return perturb_pose(T_start, delta), se, float(rms)


def huber_but_prior(z, count, bound=HUBER):
    """Return Huber's loss and its derivatives (3, n) of squared residuals; those after ``count`` stay squares."""
    rho = np.stack([z, np.ones_like(z), np.zeros_like(z)])
    far = z > bound**2
    far[count:] = False
    root = np.sqrt(z[far])
    rho[:, far] = [2 * bound * root - bound**2, bound / root, -bound / (2 * root**3)]
    return rho


def pose_from_markers(quads_world, quads_px, K, sides_m):
    """Return a first T_cam_world from markers (n, 4, 3) and their corners (n, 4, 2), or None.

    Each marker alone gives two poses (IPPE); the one that most corners of all markers agree with is taken, so that
    wrong ids do not matter while they are fewer than half.
    """
    best, least = None, np.inf
    for quad, pixels, side in zip(quads_world, quads_px, sides_m, strict=True):
        plate = marker_corners_plate(side)
        T_world_plate = _frame_of(quad)
        _, rvecs, tvecs, _ = cv2.solvePnPGeneric(plate, pixels, K, None, flags=cv2.SOLVEPNP_IPPE_SQUARE)
        for rvec, tvec in zip(rvecs, tvecs, strict=True):
            T = make_pose(rvec.ravel(), tvec.ravel()) @ invert_pose(T_world_plate)
            e = np.linalg.norm(project(K, T, quads_world) - quads_px, axis=-1)
            error = np.median(np.nan_to_num(e, nan=BEHIND_PX))
            if error < least:
                best, least = T, error
    return best


def _frame_of(quad):
    """Return T_world_plate (4, 4) of a marker's corners (4, 3): top left, top right, bottom right, bottom left."""
    x, y = quad[1] - quad[0], quad[0] - quad[3]
    x, y = x / np.linalg.norm(x), y / np.linalg.norm(y)
    T = np.eye(4)
    T[:3, :3] = np.stack([x, y, np.cross(x, y)], axis=1)
    T[:3, 3] = quad.mean(axis=0)
    return T


def pose_from_plane(points_board, pixels, K):
    """Return a first T_cam_board from points (n, 3) of one plane and their pixels (n, 2): the better IPPE pose."""
    _, rvecs, tvecs, errors = cv2.solvePnPGeneric(points_board, pixels, K, None, flags=cv2.SOLVEPNP_IPPE)
    best = int(np.argmin(np.ravel(errors)))
    return make_pose(rvecs[best].ravel(), tvecs[best].ravel())
