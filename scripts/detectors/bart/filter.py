"""Kalman filter of a tracked pose, and which of a square's two planar poses it is."""

import cv2
import numpy as np

from kernels import njit
from rig.plates import marker_corners_plate

NIS_GATE = 16.8  # squared normalised innovation of a pose that one in a hundred exceeds (chi squared, 6 degrees)
MEMORY = 0.85  # of innovations, from frame to frame: white ones then have a lag of (1 - 0.85) / (1 + 0.85) = 0.08
LAGS = (0.2, 0.45, 0.9)  # from even motion to a filter that is always behind, and beside them
SHARES = (0.02, 1.0, 30.0)  # how much of the assumed accelerations is then allowed for
STILL_M_S, STILL_RAD_S = 0.002, 0.01  # speeds that count as none


@njit(cache=True, nogil=True)
def rotation_of(v):
    """Return the 3 x 3 rotation of a rotation vector (Rodrigues)."""
    angle = np.sqrt(v[0] ** 2 + v[1] ** 2 + v[2] ** 2)
    W = np.array([[0.0, -v[2], v[1]], [v[2], 0.0, -v[0]], [-v[1], v[0], 0.0]])
    if angle < 1e-8:
        return np.eye(3) + W
    return np.eye(3) + np.sin(angle) / angle * W + (1 - np.cos(angle)) / angle**2 * (W @ W)


@njit(cache=True, nogil=True)
def small_turn(R):
    """Return the rotation vector of a 3 x 3 rotation, for angles well below half a turn."""
    v = 0.5 * np.array([R[2, 1] - R[1, 2], R[0, 2] - R[2, 0], R[1, 0] - R[0, 1]])
    sine = np.sqrt(v[0] ** 2 + v[1] ** 2 + v[2] ** 2)
    angle = np.arctan2(sine, 0.5 * (R[0, 0] + R[1, 1] + R[2, 2] - 1))
    return v if sine < 1e-8 else v * (angle / sine)


@njit(cache=True, nogil=True)
def unrest(drift, power):
    """Return how much of the assumed accelerations the marker seems to make use of, one of SHARES or between.

    drift, power  decaying means of innovations (6,) and of their squares: while the marker moves as expected,
                  innovations are noise and cancel; when the filter lags they point one way
    """
    if power == 0:
        return 1.0
    lag = (drift @ drift) / power
    return np.exp(np.interp(lag, np.array(LAGS), np.log(np.array(SHARES))))


@njit(cache=True, nogil=True)
def move_state(x, P, R, drift, power, dt, acceleration, turning):
    """Return (x, P, R) after ``dt`` seconds at constant speeds, with white noise of unrest's share of accelerations."""
    share = unrest(drift, power)
    x = x.copy()
    x[:3] += dt * x[6:9]
    F = np.eye(12)
    Q = np.zeros((12, 12))
    for k in range(6):
        F[k, k + 6] = dt
        q = (share * (acceleration if k < 3 else turning)) ** 2
        Q[k, k] = q * dt**4 / 4
        Q[k, k + 6] = Q[k + 6, k] = q * dt**3 / 2
        Q[k + 6, k + 6] = q * dt**2
    return x, F @ P @ F.T + Q, rotation_of(dt * x[9:12]) @ R


@njit(cache=True, nogil=True)
def take_in_pose(x, P, R, t_seen, R_seen, covariance):
    """Return (x, P, R) after a Kalman update with a measured pose and its 6 x 6 covariance, and the innovation (6,),
    normalised by what was expected of it.
    """
    innovation = np.empty(6)
    innovation[:3] = t_seen - x[:3]
    innovation[3:] = small_turn(R_seen @ R.T)
    S = P[:6, :6] + covariance
    normalised = np.linalg.solve(np.linalg.cholesky(S), innovation)
    nis = normalised @ normalised
    if nis > NIS_GATE:
        # The marker moved off otherwise than expected: trust the past less, by as much as it was wrong.
        P = P * (nis / 6)
        S = P[:6, :6] + covariance
    gain = np.linalg.solve(S, P[:6].copy()).T
    x = x + gain @ innovation
    R = rotation_of(x[3:6]) @ R
    x[3:6] = 0
    keep = np.eye(12)
    keep[:, :6] -= gain
    return x, keep @ P @ keep.T + gain @ covariance @ gain.T, R, normalised


@njit(cache=True, nogil=True)
def settle(x, P):
    """Return (x, P) where speeds too small to be told from none are taken as none (zero velocity update).

    Foxlin, "Pedestrian tracking with shoe-mounted inertial sensors" (2005): a speed of zero is measured.
    """
    speed, V = x[6:].copy(), P[6:, 6:].copy()
    if speed @ np.linalg.solve(V, speed) > NIS_GATE:
        return x, P
    none = np.zeros((6, 6))
    for k in range(6):
        none[k, k] = (STILL_M_S if k < 3 else STILL_RAD_S) ** 2
    gain = np.linalg.solve(V + none, P[6:].copy()).T
    x = x - gain @ speed
    keep = np.eye(12)
    keep[:, 6:] -= gain
    return x, keep @ P @ keep.T + gain @ none @ gain.T


@njit(cache=True, nogil=True)
def follow_pose(x, P, R, drift, power, t_seen, R_seen, covariance):
    """Return (x, P, R, drift, power) after a measured pose (see take_in_pose, unrest, settle)."""
    x, P, R, innovation = take_in_pose(x, P, R, t_seen, R_seen, covariance)
    drift = MEMORY * drift + (1 - MEMORY) * innovation
    power = MEMORY * power + (1 - MEMORY) * (innovation @ innovation)
    if drift @ drift <= LAGS[0] * power:
        x, P = settle(x, P)
    return x, P, R, drift, power


@njit(cache=True, nogil=True)
def pose_covariance(square, R, t, fx, fy, noise_px):
    """Return the 6 x 6 covariance of a pose (translation, turn about the camera's axes) from the corners' noise."""
    information = np.zeros((6, 6))
    J = np.zeros((2, 6))
    for k in range(4):
        s = R @ square[k]
        x, y, z = s[0] + t[0], s[1] + t[1], s[2] + t[2]
        J[0, 0], J[0, 2] = fx / z, -fx * x / z**2
        J[1, 1], J[1, 2] = fy / z, -fy * y / z**2
        for r in range(2):
            # d(p)/d(turn) = -[s]x
            J[r, 3] = J[r, 2] * s[1] - J[r, 1] * s[2]
            J[r, 4] = J[r, 0] * s[2] - J[r, 2] * s[0]
            J[r, 5] = J[r, 1] * s[0] - J[r, 0] * s[1]
        information += J.T @ J
    information /= noise_px**2
    for k in range(6):
        information[k, k] += 1e-4 if k < 3 else 1e-2  # keeps a tilt that hardly shows finite
    return np.linalg.inv(information)


class PoseFilter:
    """A marker that moves and turns at nearly constant speed; poses are ``T_cam_marker``, metres and radians.

    State: translation, small rotation about the present one, their speeds (12). Measured is the pose of the corners,
    with the covariance that the corners' noise gives it there, so that a far marker's depth is trusted less.

    Both planar poses are followed: each has a score, the decaying sum of its squared reprojection errors, and the
    better score is the pose. A single frame in which the wrong one fits better does not turn the marker over.
    """

    def __init__(self, K, dist, code_m, corner_noise_px, acceleration_m_s2, turning_rad_s2, resolve_flips=True):
        self.K, self.dist = np.asarray(K, float), dist
        self.code_m, self.square = code_m, marker_corners_plate(code_m)
        self.noise, self.acceleration, self.turning = corner_noise_px, acceleration_m_s2, turning_rad_s2
        self.resolve_flips = resolve_flips
        self.x = None
        self.P = None
        self.R = None
        self.branches = []  # [rotation matrix, score] of the pose taken, then of the other one
        self.turned = False  # whether the last update changed from one planar pose to the other
        self.drift, self.power = np.zeros(6), 0.0  # decaying means of innovations and of their squares

    @classmethod
    def compile(cls):
        """Compile what a filter needs, or load it from the cache, so that no frame waits for it."""
        trial = cls(np.eye(3), None, 1.0, 1.0, 1.0, 1.0)
        for _ in range(2):
            trial.predict(0.1)
            trial.update([(np.zeros(3), np.array([0.0, 0.0, 5.0]), 0.0)])
        trial.coast(np.eye(3), np.ones(3), np.eye(3), np.zeros(3), 0.1)

    def predict(self, dt):
        """Move the state on by ``dt`` seconds."""
        if self.x is not None:
            state = self.x, self.P, self.R, self.drift, self.power
            self.x, self.P, self.R = move_state(*state, dt, self.acceleration, self.turning)

    def update(self, poses, smooth=True):
        """Take in the poses (rvec, tvec, reprojection RMS) of a frame, one or two; not ``smooth``: as measured."""
        rotations = [rotation_of(p[0]) for p in poses]
        pick = self._follow_branches(rotations, [p[2] for p in poses])
        R, t = rotations[pick], poses[pick][1]
        covariance = pose_covariance(self.square, R, t, self.K[0, 0], self.K[1, 1], self.noise)
        if self.x is not None and smooth and not self.turned:
            state = self.x, self.P, self.R, self.drift, self.power
            self.x, self.P, self.R, self.drift, self.power = follow_pose(*state, t, R, covariance)
            return
        speed = np.zeros(6) if self.x is None else np.append(self.x[6:9], [0, 0, 0])
        self.x, self.R = np.concatenate([t, np.zeros(3), speed]), R
        self.P = np.zeros((12, 12))
        self.P[:6, :6] = covariance
        self.P[6:, 6:] = np.diag(np.repeat([1.0, 4.0], 3))  # hand-held: about a metre and 2 rad a second
        self.drift, self.power = np.zeros(6), 0.0

    def _follow_branches(self, rotations, errors):
        """Update both branches' scores; return the index of the pose to take."""
        self.turned = False
        if not self.resolve_flips:
            return int(np.argmin(errors))
        if not self.branches:
            self.branches = [[R, e**2] for R, e in zip(rotations, errors, strict=True)]
            return 0
        turn = [np.vdot(self.branches[0][0], R) for R in rotations]  # trace: 1 + 2 cos
        first = int(np.argmax(turn))  # the pose nearest to the branch taken so far
        branches = [[rotations[first], 0.9 * self.branches[0][1] + errors[first] ** 2]]
        if len(rotations) == 2:
            before = self.branches[1][1] if len(self.branches) == 2 else errors[1 - first] ** 2
            branches.append([rotations[1 - first], 0.9 * before + errors[1 - first] ** 2])
            # The other has to be clearly better for long: noise in the corners is no reason to turn over.
            if branches[1][1] + 4 * self.noise**2 < 0.5 * branches[0][1]:
                branches.reverse()
                self.turned = True
                self.branches = branches
                return 1 - first
        self.branches = branches
        return first

    def coast(self, R, t, rotation, place, dt):
        """Put the pose (R 3 x 3, t) of ``dt`` seconds ago where a camera's motion (rotation, place) takes it."""
        moved = rotation @ t + place
        self.x = np.concatenate([moved, np.zeros(3), (moved - t) / dt, small_turn(rotation) / dt])
        self.R = rotation @ R

    def pose(self):
        """Return the filtered (rvec, tvec)."""
        return cv2.Rodrigues(self.R)[0].ravel(), self.x[:3].copy()

    def corners(self):
        """Return where the filtered pose puts the corners (4, 2), pixels."""
        return cv2.projectPoints(self.square, *self.pose(), self.K, self.dist)[0].reshape(4, 2)
