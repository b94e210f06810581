"""How the whitened prediction of one capture changes with parameters and with its pose."""

import numpy as np

from effects import library
from gap.fit.parameters import get_parameter, image_step, is_geometric, small_step, with_parameters
from rig.geometry import N_POSE

POSE_STEP = 1e-5  # radians, metres
LARGEST = 1e6
FEW_COLUMNS = 5  # by images, for which plates are measured again: more are worth the plates' responses
LONGEST_WAY = 1e4  # whitened residual beyond which a change says no more


class Derivatives:
    """Derivatives of one problem's captures; a prediction's own windows serve all parameters of it."""

    def __init__(self, problem, predictor, whiteners, prior):
        self.problem, self.predictor, self.whiteners, self.prior = problem, predictor, whiteners, prior

    def __call__(self, i, effects, free, pose, step_of=None):
        """Return (Jt, Jp) of capture i: d (twin, whitened) by the free parameters (n, k) and ``by_pose``.

        ``step_of`` (parameter, value) -> step of derivatives by images; parameters.image_step where None.
        """
        pose_columns = self.by_pose(i, effects, pose)
        by_response = step_of is not None or sum(not is_geometric(f) for f in free) > FEW_COLUMNS
        out = np.zeros((len(pose_columns), len(free)))
        geometric = [k for k, f in enumerate(free) if is_geometric(f)]
        if geometric:
            change = self._states_by(i, effects, [free[k] for k in geometric], pose)
            out[:, geometric] = self._whitened_states(i, effects, pose, change)
        for k, f in enumerate(free):
            if not is_geometric(f):
                out[:, k] = self._column(i, effects, f, pose, step_of or image_step, by_response)
        return out, pose_columns

    def towards(self, i, effects, others, pose):
        """Return by what the whitened prediction (n,) of capture i changes where the effects become others."""
        change = self.predictor.shown(i, effects, pose).change(others)
        return np.clip(self.whiteners[i].whitened(change), -LONGEST_WAY, LONGEST_WAY)

    def by_pose(self, i, effects, pose):
        """Return d (twin, whitened) / d pose and own numbers (n, 6 + k) of capture i."""
        steps = steps_from(pose, self.problem.moving_numbers)
        corners = self.problem.corners_at(self.problem.captures[i], effects, steps)
        J = self._whitened_states(i, effects, pose, differences([self.problem.states(c, effects) for c in corners]))
        if self.problem.own:
            J = np.hstack([J, *(self._by_own(i, effects, pose, k)[:, None] for k in range(len(self.problem.own)))])
        J[-len(pose) :] = -np.diag(np.sqrt(self.prior))
        return J

    def _by_own(self, i, effects, pose, k):
        """Return d (twin, whitened) / d own number k (n,) of capture i, by images."""
        own = self.problem.own[k]
        h = image_step(own, get_parameter(self.problem.seen_with(effects, pose), own))
        moved = pose + h * np.eye(len(pose))[N_POSE + k]
        by_response = len(self.problem.own) > FEW_COLUMNS
        change = self.predictor.shown(i, effects, pose).change(effects, by_response, moved)
        return np.clip(self.whiteners[i].whitened(change) / h, -LARGEST, LARGEST)

    def corners_by_pose(self, i, effects, pose):
        """Return d corners / d what moves them (p, 8 of a plate, 6 or more) of the plates that were measured in capture i."""
        moves = self.problem.corners_by_pose(self.problem.captures[i], effects, pose)[self.whiteners[i].plates]
        return np.nan_to_num(moves.reshape(len(moves), self.problem.corner_numbers, moves.shape[-1]))

    def corners_by_parameters(self, i, effects, free, pose):
        """Return d corners / d geometric parameters ``free`` (p, 8, k) of the plates that were measured in capture i."""
        return self._states_by(i, effects, free, pose)[self.whiteners[i].plates, : self.problem.corner_numbers]

    def _states_by(self, i, effects, free, pose):
        """Return d states / d geometric parameters ``free`` (p, 14, k) of capture i, 0 where a plate is out of sight."""
        capture, n = self.problem.captures[i], self.problem.corner_numbers
        out = np.zeros((len(capture.observation.features), len(self.problem.state_features), len(free)))
        moving = [k for k, (name, _) in enumerate(free) if library.moves_points(name)]
        if moving:
            steps = [small_step(free[k]) for k in moving]
            moves = self.problem.corners_by_parameters(capture, effects, pose, [free[k] for k in moving], steps)
            out[:, :n, moving] = moves.reshape(len(out), n, -1)
        for k in sorted(set(range(len(free))) - set(moving)):
            value, h = get_parameter(effects, free[k]), small_step(free[k])
            high, low = (self._states(i, with_parameters(effects, [free[k]], [value + s * h]), pose) for s in (1, -1))
            out[..., k] = (high - low) / (2 * h)
        return np.nan_to_num(out)

    def _column(self, i, effects, parameter, pose, step_of, by_response):
        """Return d (twin, whitened) / d parameter (n,) by images."""
        value = get_parameter(effects, parameter)
        h = step_of(parameter, value)
        change = self.predictor.shown(i, effects, pose).change(
            with_parameters(effects, [parameter], [value + h]), by_response
        )
        return np.clip(self.whiteners[i].whitened(change) / h, -LARGEST, LARGEST)

    def _states(self, i, effects, pose):
        exact = self.problem.corners_of(self.problem.captures[i], effects, pose)
        return self.problem.states(exact, effects)

    def _whitened_states(self, i, effects, pose, change):
        """Return the whitened change (n, m) of all residuals where plates' states change by (p, 14, m)."""
        plates = self.whiteners[i].plates
        measured = self.predictor.predict(i, effects, pose).measured[plates]
        features = np.zeros((len(plates), self.problem.captures[i].observation.features.shape[1], change.shape[2]))
        features[:, self.problem.state_features] = np.nan_to_num(change[plates])
        features[~measured] = 0
        return self.whiteners[i].whitened_features(features)


def steps_from(pose, numbers):
    """Return the poses [(k,)] a step on and a step back from a pose (k,) in each of its first numbers."""
    return [pose + s * step for step in POSE_STEP * np.eye(numbers, len(pose)) for s in (1, -1)]


def differences(values):
    """Return the derivatives (..., numbers) by a pose of values [(...)] at the poses that ``steps_from`` it gives."""
    pairs = zip(values[::2], values[1::2], strict=True)
    return np.stack([(on - back) / (2 * POSE_STEP) for on, back in pairs], axis=-1)


def flat(corners):
    """Return corners (p, c, 2) as (p, 2 c)."""
    return corners.reshape(len(corners), -1)
