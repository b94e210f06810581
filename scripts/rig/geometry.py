"""Poses and the pinhole camera, in the conventions of docs/campaign-format.md.

World: metres, x right, y forward along the rig, z up. Camera: OpenCV (x right, y down, z forward).
Pixels: the centre of the top-left pixel is (0, 0). A pose ``T_a_b`` is a 4 x 4 matrix that takes
homogeneous points of frame b to frame a.
"""

import cv2
import numpy as np
from scipy.spatial.transform import Rotation


def make_pose(rvec, tvec):
    """Return the 4 x 4 pose of a rotation vector (radians) and a translation (metres), both of shape (3,)."""
    T = np.eye(4)
    T[:3, :3] = cv2.Rodrigues(np.asarray(rvec, float))[0]
    T[:3, 3] = tvec
    return T


def split_pose(T):
    """Return (rvec, tvec), radians and metres, each of shape (3,), of a 4 x 4 pose."""
    return Rotation.from_matrix(T[:3, :3]).as_rotvec(), T[:3, 3].copy()


def invert_pose(T):
    """Return the inverse of a rigid 4 x 4 pose."""
    R, t = T[:3, :3], T[:3, 3]
    inverse = np.eye(4)
    inverse[:3, :3] = R.T
    inverse[:3, 3] = -R.T @ t
    return inverse


def station_pose(height_m, tilt_deg):
    """Return ``T_cam_world`` of a station: optical centre at (0, 0, height_m), no pan, no roll.

    ``tilt_deg`` is how far the optical axis points below the horizontal (0: straight ahead along y).
    """
    s, c = np.sin(np.radians(tilt_deg)), np.cos(np.radians(tilt_deg))
    T = np.eye(4)
    T[:3, :3] = [[1, 0, 0], [0, -s, -c], [0, c, -s]]
    T[:3, 3] = -T[:3, :3] @ [0, 0, height_m]
    return T


def place_name(height_m, tilt_deg):
    """Return the name of a station: millimetres and degrees, as in ``h0300_t22p5``."""
    return f"h{1000 * height_m:04.10g}_t{tilt_deg:.10g}".replace("-", "m").replace("+", "").replace(".", "p")


N_POSE = 6  # numbers that move a pose: of a capture's nuisances the first, its light follows


def perturb_pose(T_cam_world, delta):
    """Return the pose moved by ``delta`` = (wx, wy, wz in radians, x, y, z in metres) in the camera's frame.

    The move is applied on the left, ``T(delta) @ T_cam_world``: small, it is the camera turning and
    stepping about its own optical centre.
    """
    return make_pose(delta[:3], delta[3:]) @ T_cam_world


def camera_matrix(fx, fy, cx, cy):
    """Return the 3 x 3 intrinsic matrix, in pixels."""
    return np.array([[fx, 0, cx], [0, fy, cy], [0, 0, 1]], float)


def transform(T_a_b, points_b):
    """Return points (..., 3) of frame b in frame a."""
    return points_b @ T_a_b[:3, :3].T + T_a_b[:3, 3]


def project(K, T_cam_world, points_world):
    """Project world points (..., 3) with a pinhole; return pixels (..., 2), NaN where not in front of the camera."""
    p = transform(T_cam_world, np.asarray(points_world, float))
    z = np.where(p[..., 2] > 1e-9, p[..., 2], np.nan)
    return np.stack(
        [K[0, 0] * p[..., 0] / z + K[0, 2], K[1, 1] * p[..., 1] / z + K[1, 2]],
        axis=-1,
    )


def pixels_by_pose(K, T_cam_mount, delta, T_cam_world, points_world):
    """Return d pixels (..., 2, 6) / d delta of world points (..., 3).

    They are seen from T_cam_mount @ ``perturb_pose(T_cam_world, delta)``; NaN where a point is not in front of the camera.
    """
    here = transform(T_cam_world, np.asarray(points_world, float))
    R, by_turn = cv2.Rodrigues(np.asarray(delta[:3], float))
    p = transform(T_cam_mount, here @ R.T + delta[3:])
    turned = np.einsum("kij,...j->...ik", by_turn.reshape(3, 3, 3), here)
    moves = T_cam_mount[:3, :3] @ np.concatenate([turned, np.broadcast_to(np.eye(3), turned.shape)], axis=-1)
    z = np.where(p[..., 2] > 1e-9, p[..., 2], np.nan)[..., None]
    across = [K[k, k] * (moves[..., k, :] - p[..., k, None] / z * moves[..., 2, :]) / z for k in (0, 1)]
    return np.stack(across, axis=-2)


def rotation_angle_deg(R_a, R_b):
    """Return the geodesic angle in degrees between two 3 x 3 rotations."""
    return np.degrees(Rotation.from_matrix(R_a.T @ R_b).magnitude())
