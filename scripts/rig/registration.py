"""The pose of a capture from all its markers, with the campaign's tolerance as prior where a nominal pose is known."""

import cv2
import numpy as np
from scipy.optimize import least_squares

from rig.geometry import perturb_pose, project

CORNER_SIGMA_PX = 0.5  # detectors' corners, biased as they are
LOOSE = np.array([np.pi] * 3 + [100.0] * 3)


def register_pose(points_world, pixels, K, T_nominal, sigma_pose):
    """Fit T_cam_world to points (n, 3) and pixels (n, 2) of the ideal pinhole.

    T_nominal (4, 4) or None; sigma_pose (6,) prior standard deviations (rad, m) about it, in the camera's frame.
    Robust (soft L1). Return (T_cam_world, standard errors (6,), RMS length of the residuals in pixels).
    """
    if T_nominal is None:
        T_nominal, sigma_pose = _first_pose(points_world, pixels, K), LOOSE

    def residuals(delta):
        e = np.nan_to_num(project(K, perturb_pose(T_nominal, delta), points_world) - pixels, nan=1e3)
        return np.concatenate([e.ravel() / CORNER_SIGMA_PX, delta / sigma_pose])

    fit = least_squares(residuals, np.zeros(6), loss="soft_l1", x_scale=np.array([1e-3] * 6))
    covariance = np.linalg.pinv(fit.jac.T @ fit.jac)
    T = perturb_pose(T_nominal, fit.x)
    e = project(K, T, points_world) - pixels
    return T, np.sqrt(np.diag(covariance)), float(np.sqrt((e**2).sum(1).mean()))


def _first_pose(points_world, pixels, K):
    from rig.geometry import make_pose

    ok, rvec, tvec = cv2.solvePnP(points_world.astype(float), pixels.astype(float), K, None, flags=cv2.SOLVEPNP_SQPNP)
    if not ok:
        return np.eye(4)
    return make_pose(rvec.ravel(), tvec.ravel())


def warp_real_to_twin(K, T_registered, T_nominal):
    """Return the homography (3, 3) that takes pixels of a capture to those of its station's render, on the plane z = 0."""

    def plane_to_image(T):
        return K @ T[:3, [0, 1, 3]]

    H = plane_to_image(T_nominal) @ np.linalg.inv(plane_to_image(T_registered))
    return H / H[2, 2]
