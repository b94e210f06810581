"""Where a moving camera is at any time, and where a rolling shutter shows what it sees: exact truth for each row.

Time runs from the first frame, seconds. Frame k is taken at k / fps: then the middle row is half exposed. The row at
height y (pixels; row r has its middle at y = r) is half exposed at frame time + readout ((y + 0.5) / rows - 0.5).
"""

import numpy as np
from scipy.spatial.transform import Rotation

from job import seed_of
from rig.geometry import make_pose, project

SWAY_WAVES = 5  # sine waves of each axis of hand-held motion
SLOWEST_SHARE = 0.15  # of the fastest wave's frequency
CAMERA_AXES = np.array([[1.0, 0, 0], [0, 0, -1], [0, 1, 0]])  # of a level camera that looks along y, in rows


def look_at(camera_m, look_at_m):
    """Return T_cam_world of a level camera at a place (3,) that looks at another (3,)."""
    d = np.subtract(look_at_m, camera_m)
    return pose_of(camera_m, np.arctan2(-d[0], d[1]), np.arctan2(d[2], np.hypot(d[0], d[1])), 0.0)


def pose_of(centre, pan, tilt, roll):
    """Return T_cam_world of a camera at ``centre`` (3,) metres: pan to the left, tilt up, roll clockwise, radians."""
    turned = Rotation.from_euler("ZXY", [pan, tilt, roll]).as_matrix()
    R = CAMERA_AXES @ turned.T
    T = np.eye(4)
    T[:3, :3], T[:3, 3] = R, -R @ centre
    return T


def smooth_step(s):
    """Return 0 to 1 for s from 0 to 1, speed and acceleration zero at both ends (minimum jerk, Flash and Hogan 1985)."""
    s = np.clip(s, 0, 1)
    return s**3 * (10 - 15 * s + 6 * s**2)


def make_trajectory(motion, duration_s, *names):
    """Return the function t_s -> T_cam_world (4 x 4) of a moving_config motion that lasts ``duration_s``.

    names  what random motion is seeded from
    """
    camera, target = np.array(motion.camera_m), np.array(motion.look_at_m)
    start = look_at(camera, target)
    if motion.kind == "at_rest":
        return lambda t_s: start.copy()
    if motion.kind == "approach":
        way = motion.way_m * (target - camera) / np.linalg.norm(target - camera)
        return lambda t_s: look_at(camera + smooth_step(t_s / duration_s) * way, target)
    if motion.kind == "pan":
        sweep = np.radians(motion.pan_deg)
        return lambda t_s: _pan_by(start, camera, sweep * (smooth_step(t_s / duration_s) - 0.5))
    if motion.kind == "head_turn":
        return lambda t_s: _turn_head(start, camera, motion, t_s)
    return _sway(start, motion, seed_of(*names))


def _pan_by(T_cam_world, axis_m, angle):
    """Return the pose turned to the left by ``angle`` about the upright axis through ``axis_m`` (3,)."""
    turn = make_pose([0, 0, angle], [0, 0, 0])
    there, back = np.eye(4), np.eye(4)
    there[:3, 3], back[:3, 3] = axis_m, -np.asarray(axis_m)
    return T_cam_world @ there @ turn.T @ back


def _turn_head(T_cam_world, camera_m, motion, t_s):
    """Return the pose of a head that turns, stays and turns back about its neck."""
    out = smooth_step((t_s - motion.start_s) / motion.turn_s)
    back = smooth_step((t_s - motion.start_s - motion.turn_s - motion.stay_s) / motion.turn_s)
    behind = T_cam_world[2, :3] * [1, 1, 0]
    neck = camera_m - motion.neck_m * behind / np.linalg.norm(behind)
    return _pan_by(T_cam_world, neck, np.radians(motion.turn_deg) * (out - back))


def _sway(T_cam_world, motion, seed):
    """Return the function of a pose that sways: sums of sine waves, slow ones larger, of random phase."""
    rng = np.random.default_rng(seed)
    hz = motion.fastest_hz * SLOWEST_SHARE ** rng.uniform(0, 1, (6, SWAY_WAVES))
    phase = rng.uniform(0, 2 * np.pi, hz.shape)
    size = 1 / hz
    size *= np.repeat([np.radians(motion.turn_deg), motion.sway_m], 3)[:, None] / np.sqrt(
        (size**2).sum(axis=1, keepdims=True) / 2
    )

    def pose(t_s):
        moved = (size * np.sin(2 * np.pi * hz * t_s + phase)).sum(axis=1)
        return make_pose(moved[:3], moved[3:]) @ T_cam_world

    return pose


def row_delay(y, rows, readout_s):
    """Return how long after the frame's time the row at height y (pixels, any shape) is half exposed, s."""
    return readout_s * ((np.asarray(y, float) + 0.5) / rows - 0.5)


def project_rolling(K, trajectory, frame_s, points_world, rows, readout_s):
    """Return pixels (n, 2) of world points (n, 3) in the frame taken at ``frame_s``; NaN where behind the camera.

    Each point is seen in the row that is exposed while the point stands there: a fixed point of
    y = project(pose(time of row y)).y, found by the secant method. Rows beyond the frame count as if they were read too.
    """
    return np.array([_project_one(K, trajectory, frame_s, p, rows, readout_s) for p in np.asarray(points_world, float)])


def _project_one(K, trajectory, frame_s, point, rows, readout_s):
    def seen_from(y):
        return project(K, trajectory(frame_s + float(row_delay(y, rows, readout_s))), point)

    xy = seen_from((rows - 1) / 2)
    before, error = (rows - 1) / 2, xy[1] - (rows - 1) / 2
    y = xy[1]
    for _ in range(50):
        xy = seen_from(y)
        if not np.isfinite(xy).all():
            return np.full(2, np.nan)
        now = xy[1] - y
        if abs(now) < 1e-9:
            return xy
        slope = (now - error) / (y - before) if y != before else -1.0
        before, error = y, now
        y = y - now / slope if slope < -0.1 else y + now
    return np.full(2, np.nan)
