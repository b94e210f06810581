"""How the whitened prediction of one capture changes with parameters and with its pose."""

import numpy as np

from gap.measure.capture import states_at
from gap.measure.plate import N_FEATURES, STATE_FEATURES
from gap.parameters import get_parameter, image_step, is_geometric, small_step, with_parameters

POSE_STEP = np.array([1e-5] * 3 + [1e-5] * 3)  # radians, metres
LARGEST = 1e6
FEW_COLUMNS = 5  # by images, for which plates are measured again: more are worth the plates' responses
LONGEST_WAY = 1e4  # whitened residual beyond which a change says no more


class Derivatives:
    """Derivatives of one problem's captures; a prediction's own windows serve all parameters of it."""

    def __init__(self, problem, predictor, whiteners, prior):
        self.problem, self.predictor, self.whiteners, self.prior = problem, predictor, whiteners, prior

    def __call__(self, i, effects, free, pose, step_of=None):
        """Return (Jt, Jp) of capture i: d (twin, whitened) by the free parameters (n, k) and by the pose (n, 6).

        ``step_of`` (parameter, value) -> step of derivatives by images; gap.parameters.image_step where None.
        """
        pose_columns = self.by_pose(i, effects, pose)
        by_response = step_of is not None or sum(not is_geometric(f) for f in free) > FEW_COLUMNS
        columns = [self._column(i, effects, f, pose, step_of or image_step, by_response) for f in free]
        return np.stack(columns, axis=1) if columns else np.zeros((len(pose_columns), 0)), pose_columns

    def towards(self, i, effects, others, pose):
        """Return by what the whitened prediction (n,) of capture i changes where the effects become others."""
        change = self.predictor.shown(i, effects, pose).change(others)
        return np.clip(self.whiteners[i].whitened(change), -LONGEST_WAY, LONGEST_WAY)

    def by_pose(self, i, effects, pose):
        """Return d (twin, whitened) / d pose (n, 6) of capture i."""
        states = [self._states(i, effects, pose + s * step) for step in np.diag(POSE_STEP) for s in (1, -1)]
        columns = [(high - low) / (2 * h) for high, low, h in zip(states[::2], states[1::2], POSE_STEP, strict=True)]
        J = self._whitened_states(i, effects, pose, np.stack(columns, axis=-1))
        J[-6:] = -np.diag(np.sqrt(self.prior))
        return J

    def corners_by_pose(self, i, effects, pose):
        """Return d corners / d pose (p, 8, 6) of the plates that were measured in capture i."""
        plates, capture = self.whiteners[i].plates, self.problem.captures[i]
        columns = []
        for step, h in zip(np.diag(POSE_STEP), POSE_STEP, strict=True):
            high, low = (
                self.problem.corners_of(capture, effects, pose + s * step).reshape(-1, 8)[plates] for s in (1, -1)
            )
            columns.append((high - low) / (2 * h))
        return np.nan_to_num(np.stack(columns, axis=-1))

    def _column(self, i, effects, parameter, pose, step_of, by_response):
        """Return d (twin, whitened) / d parameter (n,): by point maps where it only moves points, else by images."""
        value = get_parameter(effects, parameter)
        if is_geometric(parameter):
            h = small_step(parameter)
            high, low = (self._states(i, with_parameters(effects, [parameter], [value + s * h]), pose) for s in (1, -1))
            return self._whitened_states(i, effects, pose, (high - low)[..., None] / (2 * h))[:, 0]
        h = step_of(parameter, value)
        change = self.predictor.shown(i, effects, pose).change(
            with_parameters(effects, [parameter], [value + h]), by_response
        )
        return np.clip(self.whiteners[i].whitened(change) / h, -LARGEST, LARGEST)

    def _states(self, i, effects, pose):
        exact = self.problem.corners_of(self.problem.captures[i], effects, pose)
        return states_at(exact, self.problem.codes, self.problem.rims_of(effects))

    def _whitened_states(self, i, effects, pose, change):
        """Return the whitened change (n, m) of all residuals where plates' states change by (p, 14, m)."""
        plates = self.whiteners[i].plates
        measured = self.predictor.predict(i, effects, pose).measured[plates]
        features = np.zeros((len(plates), N_FEATURES, change.shape[2]))
        features[:, STATE_FEATURES] = np.nan_to_num(change[plates])
        features[~measured] = 0
        return self.whiteners[i].whitened_features(features)
