"""A marker's pose from its corners, beside the true one: errors, flips, and the covariance that the corners predict."""

import numpy as np
from scipy.stats import chi2

from detectors.contract import estimate_poses
from reporting.metrics import is_flipped, relative_rotvec_deg
from rig.geometry import pixels_by_pose, split_pose
from rig.plates import marker_corners_plate

MEDIANS = {k: chi2.median(k) for k in (1, 2, 3)}  # of chi-square by its degrees of freedom


def poses_from(corners, code_m, K):
    """Return (rvec (n, 3), tvec (n, 3), rvec of the other solution (n, 3)) of corners (n, 4, 2), NaN where there is none."""
    found = np.full((len(corners), 3, 3), np.nan)
    for row, mine in zip(found, corners, strict=True):
        for k, (rvec, tvec, _) in enumerate(estimate_poses(mine, code_m, K)[:2]):
            if k == 0:
                row[:2] = rvec, tvec
            else:
                row[2] = rvec
    return found[:, 0], found[:, 1], found[:, 2]


def pose_errors(corners, T_cam_marker, true_corners, code_m, K):
    """Return {name: (n, ...)} of corners (n, 4, 2) of one marker in one true pose.

    distance_error_m  seen less true distance of the camera
    rotvec_deg (n, 3)  R_seen R_true^T, camera's axes
    flipped           whether the solution is the other one of the plane's two (reporting.metrics.is_flipped)
    NaN, and not flipped, where the corners allow no pose.
    """
    rvec, tvec, other = poses_from(corners, code_m, K)
    true_other = np.repeat(poses_from(true_corners[None], code_m, K)[2], len(corners), axis=0)
    true_rvec, true_tvec = split_pose(T_cam_marker)
    true_rvec = np.repeat(true_rvec[None], len(corners), axis=0)
    turned, known = np.full((len(corners), 3), np.nan), np.isfinite(rvec).all(axis=1)
    turned[known] = relative_rotvec_deg(rvec[known], true_rvec[known])
    return {
        "distance_error_m": np.linalg.norm(tvec, axis=1) - np.linalg.norm(true_tvec),
        "rotvec_deg": turned,
        "flipped": is_flipped(rvec, other, true_rvec, true_other),
    }


def corner_jacobian(T_cam_marker, code_m, K):
    """Return the derivatives (8, 6) of a marker's corners, x before y, pixels, by its pose: a turn about the marker's middle
    in the camera's axes (radians), a step (metres).
    """
    T_middle_marker, T_cam_middle = np.eye(4), np.eye(4)
    T_middle_marker[:3, :3], T_cam_middle[:3, 3] = T_cam_marker[:3, :3], T_cam_marker[:3, 3]
    return pixels_by_pose(K, T_cam_middle, np.zeros(6), T_middle_marker, marker_corners_plate(code_m)).reshape(-1, 6)


def unit_covariances(T_cam_marker, code_m, K):
    """Return (variance of the distance in m^2, covariance (3, 3) of the turn in deg^2) of the least-squares pose where each
    coordinate of each corner is off by 1 px, independently: (J^T J)^-1.
    """
    J = corner_jacobian(T_cam_marker, code_m, K)
    covariance = np.linalg.inv(J.T @ J)
    ray = T_cam_marker[:3, 3] / np.linalg.norm(T_cam_marker[:3, 3])
    return ray @ covariance[3:, 3:] @ ray, np.degrees(np.degrees(covariance[:3, :3]))


def squared_lengths(deviations, covariance):
    """Return the squares (n,) of deviations (n, k) in the unit of a covariance (k, k): 1 a direction where it is right."""
    return np.einsum("ni,ij,nj->n", deviations, np.linalg.inv(covariance), deviations)


def ratio_of(squares, directions):
    """Return by what factor a predicted standard deviation is too small, from squared lengths (n,) of so many directions:
    their median beside chi-square's. NaN where there is none.
    """
    squares = np.asarray(squares, float)
    squares = squares[np.isfinite(squares)]
    return float(np.sqrt(np.median(squares) / MEDIANS[directions])) if len(squares) else np.nan


def spread_of(values):
    """Return the standard deviation of values (n, ...) about their mean, all directions together; NaN below two."""
    if len(values) < 2:
        return np.nan
    return float(np.sqrt(((values - values.mean(axis=0)) ** 2).sum() / (len(values) - 1)))
