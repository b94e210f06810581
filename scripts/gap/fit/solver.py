"""Fit the parameters of a list of effects, the poses of all captures as nuisances, to a camera's observations.

Gauss-Newton on whitened residuals with a robust loss; pose blocks are eliminated by a Schur complement. Geometry is
fitted first from the corners and exact point maps alone (fast, wide basin), then everything from windows of the twin's
image, measured by the same code as the real ones.
"""

from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from gap.fit.derivatives import Derivatives, flat
from gap.fit.evidence import evidence_of
from gap.fit.normal_equations import errors_of, normal_equations, solved, step_within, updated
from gap.fit.parameters import (
    bounds_of,
    get_parameter,
    is_geometric,
    prior_equations,
    prior_loss,
    priors_of,
    with_parameters,
)
from gap.fit.residuals import NU, Whitener, robust_scale_of, total
from gap.observables import CORNERS
from rig.geometry import N_POSE

STILL_FAR = 0.1  # share of its loss above which a step says that the next one gains as well
OLDEST_DERIVATIVES = 3  # steps that derivatives serve
FIRST_DAMPING = 1e-4  # share of the precisions' diagonal that a step adds to it
STALE_STEPS = 12  # at most, with derivatives of another list of effects
POSE_STEPS = 25  # at most: a mount that was found misaligned turns held-out cameras by a degree
OWN_STEPS = 6  # at most, of held-out captures' own numbers
DRAWN_AGAIN, NEAR_PX = 3, 0.05  # times that held-out images are drawn, move of corners that is followed without


@dataclass
class State:
    """A fitted twin: effects [(name, params)], poses (n, 6) of the captures."""

    effects: list
    poses: np.ndarray


@dataclass(frozen=True)
class Descent:
    """Where a fit ends: residual ``groups`` of the training captures, and derivatives as they were there or shortly before."""

    state: State
    free: tuple
    groups: dict
    derivatives: dict
    converged: bool

    @cached_property
    def loss(self):
        """The loss of the training captures, priors left out."""
        return total(self.groups, NU)

    @cached_property
    def precision(self):
        """The Hessian (k, k) of half the loss by the free parameters, poses eliminated."""
        priors = prior_equations(self.state.effects, self.free)
        return normal_equations(self.derivatives, self.groups, NU, priors)[0]

    @cached_property
    def evidence(self):
        """{effect: loss that taking it out costs to second order} of what was fitted."""
        return evidence_of(self.state.effects, self.free, self.precision)


class Solver:
    """Fits lists of effects to one problem, on some threads: sums are taken in the captures' order whatever their number."""

    def __init__(self, problem, noise_of=(), threads=1):
        """Noise is compared in the captures ``noise_of`` alone."""
        self.problem = problem
        self.predictor = problem.predictor(noise_of)
        self.prior = np.where(np.isfinite(problem.sigma_pose), 1 / problem.sigma_pose**2, 0.0)
        noise_of = self.predictor.noise_of
        self.whiteners = [Whitener(c, i in noise_of, len(self.prior)) for i, c in enumerate(problem.captures)]
        self.derivatives_of = Derivatives(problem, self.predictor, self.whiteners, self.prior)
        self.map = ThreadPoolExecutor(threads).map if threads > 1 else map
        self.cost = 0  # predictions and derivatives by images, of one capture each: what a budget counts

    def each(self, function, indices):
        """Return {i: function(i)} of captures, in order."""
        return dict(zip(indices, self.map(function, indices), strict=True))

    # -- geometry alone -------------------------------------------------------------------------------------------

    def corner_residuals(self, i, effects, delta, offset):
        """Return whitened corner residuals (p, 8) of capture i from exact point maps."""
        capture, w = self.problem.captures[i], self.whiteners[i]
        exact = flat(self.problem.corners_of(capture, effects, delta))
        e = capture.observation.features[w.plates, : exact.shape[1]] - exact[w.plates] - offset[w.plates]
        return np.einsum("pij,pj->pi", w.corner_inverse, np.nan_to_num(e, nan=50.0))

    def fit_geometry(self, effects, free, poses, offsets, train, scale=1.0, iterations=8):
        """Fit free geometric parameters and poses from corners alone; return (effects, poses).

        ``scale`` widens the robust loss at the start (annealed to 1 by halves).
        """
        theta = np.array([get_parameter(effects, f) for f in free])
        null, precision = priors_of(free)
        bounds = bounds_of(free)
        damping, best = 1e-6, np.inf
        for _ in range(iterations):
            current = with_parameters(effects, free, theta)
            H, g = np.diag(precision), precision * (null - theta)
            loss, blocks, nu = prior_loss(free, theta), [], NU * max(scale, 1.0) ** 2
            for i in train:
                H_i, g_i, block, loss_i = self._corner_equations(i, current, free, poses[i], offsets[i], nu)
                H, g, loss = H + H_i, g + g_i, loss + loss_i
                blocks.append((i, *block))
            d, poses = step_within(bounds, theta, H, g, blocks, poses, damping)
            theta = theta + d
            if scale <= 1.0 and abs(best - loss) < 1e-4 * max(loss, 1):
                break
            best = loss
            scale *= 0.5
        return with_parameters(effects, free, theta), poses

    def _corner_equations(self, i, effects, free, pose, offset, nu):
        """Return (H, g, (A, b, C), loss) of capture i's corners by free parameters, its pose eliminated by the block."""
        y = self.corner_residuals(i, effects, pose, offset)
        weight = 1 / (1 + y * y / nu)
        Li = self.whiteners[i].corner_inverse
        Jp = np.einsum("pij,pjk->pik", Li, self.derivatives_of.corners_by_pose(i, effects, pose))
        Jt = np.einsum("pij,pjk->pik", Li, self.derivatives_of.corners_by_parameters(i, effects, free, pose))
        wy = (weight * y).reshape(-1)
        moving = Jp.shape[-1]  # corners say nothing of a capture's own numbers
        Jp, Jt = Jp.reshape(y.size, moving), Jt.reshape(y.size, len(free))
        wJp = weight.reshape(-1, 1) * Jp
        prior, pose = self.prior[:moving], pose[:moving]
        A = Jp.T @ wJp + np.diag(prior + 1e-9)
        b = Jp.T @ wy - prior * pose
        C = wJp.T @ Jt
        H = Jt.T @ (weight.reshape(-1, 1) * Jt) - C.T @ solved(A, C)
        g = Jt.T @ wy - C.T @ solved(A, b)
        return H, g, (A, b, C), (nu * np.log1p(y * y / nu)).sum() + (prior * pose**2).sum()

    def precision_by_corners(self, effects, free, poses, offsets, train):
        """Return (H, loss, count): the Hessian (k, k) of half the corners' loss by free geometric parameters, poses eliminated;
        that loss, and of how many residuals.
        """
        H, loss, count = np.diag(priors_of(free)[1]), 0.0, 0
        for i in train:
            H_i, _, _, loss_i = self._corner_equations(i, effects, free, poses[i], offsets[i], NU)
            H, loss, count = H + H_i, loss + loss_i, count + self.whiteners[i].plates.size * self.problem.corner_numbers
        return H, loss, count

    # -- everything -----------------------------------------------------------------------------------------------

    def residuals(self, i, effects, pose):
        """Return the residual groups of capture i for a list of effects, the pose's lean included."""
        return self._residuals(i, pose, self.predictor.predict(i, effects, pose))

    def _residuals(self, i, pose, prediction):
        groups = self.whiteners[i].residuals(self.problem.captures[i].observation, prediction)
        groups["pose"] = pose * np.sqrt(self.prior)
        return groups

    def residuals_towards(self, i, effects, others, pose):
        """Return the residual groups of capture i where a list of effects becomes others that leave points and windows alone."""
        shown = self.predictor.shown(i, effects, pose)
        change, before = shown.change(others, by_response=False), shown.prediction
        noise = None if change.noise is None else before.noise + change.noise
        after = replace(
            before,
            features=before.features + change.features,
            colour=before.colour + change.colour,
            field=before.field + change.field,
            noise=noise,
        )
        return self._residuals(i, pose, after)

    def residuals_of(self, effects, poses, indices):
        """Return {i: residual groups} of captures."""
        self.cost += len(indices)
        return self.each(lambda i: self.residuals(i, effects, poses[i]), indices)

    def no_offsets(self):
        """Return the ``offsets_of`` of a twin whose corners are measured where they are."""
        n = self.problem.corner_numbers
        return [np.zeros((len(c.observation.features), n)) for c in self.problem.captures]

    def offsets_of(self, effects, poses, indices):
        """Return measured minus exact corners of the twin itself, a list over captures of (p, 8)."""
        offsets = self.no_offsets()
        for i in indices:
            exact = flat(self.problem.corners_of(self.problem.captures[i], effects, poses[i]))
            features = self.predictor.predict(i, effects, poses[i]).features
            offsets[i] = np.nan_to_num(features[:, : exact.shape[1]] - exact)
        return offsets

    def derivatives(self, effects, free, poses, train, step_of=None):
        """Return {i: (Jt, Jp)}: d (twin, whitened) by the free parameters (n, k) and by the capture's pose (n, 6)."""
        self.cost += len(train) * (1 + sum(not is_geometric(f) for f in free))
        return self.each(lambda i: self.derivatives_of(i, effects, free, poses[i], step_of), train)

    def ways(self, effects, others, poses, indices):
        """Return derivatives as ``derivatives``, by one parameter that goes from a list of effects (0) to others (1)."""
        self.cost += len(indices)

        def way(i):
            column = self.derivatives_of.towards(i, effects, others, poses[i])
            return column[:, None], self.derivatives_of.by_pose(i, effects, poses[i])

        return self.each(way, indices)

    def with_errors(self, end):
        """Return (Descent with derivatives of where it ends, standard errors (k,), cautious ones (k,)) of k free parameters.

        The first are what the residuals' own scatter makes of the parameters; the cautious ones are those of plates measured no
        better than ``FEATURE_FLOOR``, and decide whether an effect is there at all.
        """
        if not end.free:
            return end, np.zeros(0), np.zeros(0)
        if not end.converged:  # else derivatives are those of a step within the errors
            effects, poses = end.state.effects, end.state.poses
            end = replace(end, derivatives=self.derivatives(effects, end.free, poses, list(end.groups)))
        covariance = np.linalg.pinv(end.precision + np.diag(np.full(len(end.free), 1e-12)))
        _, precision = priors_of(end.free)
        return end, *errors_of(covariance, end.derivatives, end.groups, precision, self.whiteners)

    def approach(self, effects, free, poses, train, iterations, scale=1.0):
        """Return the Descent of the free parameters [(effect, parameter), ...] and the poses of the training captures, geometry
        fitted to corners alone first.

        ``effects`` gives the start and the fixed rest; ``scale`` is the robust scale at which that fit of corners begins.
        """
        geometric = [f for f in free if is_geometric(f)]
        if geometric:
            effects, poses = self.fit_geometry(effects, geometric, poses, self.no_offsets(), train, scale=scale)
        return self.descend(effects, free, poses, train, iterations)

    def followed(self, end, effects, free):
        """Return the Descent in a Descent's captures where a list of effects takes its place and free parameters follow.

        With derivatives as they were: it leaves no less than a fit does, at a small part of its cost.
        """
        mine = [end.free.index(f) for f in free]
        derivatives = {i: (Jt[:, mine], Jp) for i, (Jt, Jp) in end.derivatives.items()}
        poses = end.state.poses
        groups = self.residuals_of(effects, poses, list(derivatives))
        for _ in range(STALE_STEPS):
            theta = np.array([get_parameter(effects, f) for f in free])
            robust_scale = robust_scale_of(groups)
            H, g, blocks = normal_equations(derivatives, groups, NU * robust_scale**2, prior_equations(effects, free))
            d, moved = step_within(bounds_of(free), theta, H, g, blocks, poses, FIRST_DAMPING)
            trial = with_parameters(effects, free, theta + d)
            after = self.residuals_of(trial, moved, list(derivatives))
            if total(after, NU) > total(groups, NU) - 1:
                break
            derivatives = updated(derivatives, groups, after, d, moved - poses, np.diag(H))
            effects, poses, groups = trial, moved, after
        return Descent(State(effects, poses), tuple(free), groups, derivatives, False)

    def descend(self, effects, free, poses, train, iterations):
        """Return the Descent of the free parameters and the training captures' poses: a fit without errors, from where it is."""
        effects = [(n, dict(p)) for n, p in effects]
        groups = self.residuals_of(effects, poses, train)
        moving = bool(free or self.problem.own)
        robust_scale = robust_scale_of(groups) if moving else 1.0
        converged, derivatives = not moving, {}
        damping, age = FIRST_DAMPING, OLDEST_DERIVATIVES
        for _ in range(iterations):
            theta = np.array([get_parameter(effects, f) for f in free])
            nu = NU * robust_scale**2
            loss = total(groups, nu) + prior_loss(free, theta)
            if age >= OLDEST_DERIVATIVES:
                derivatives, age = self.derivatives(effects, free, poses, train), 0
            H, g, blocks = normal_equations(derivatives, groups, nu, prior_equations(effects, free))
            accepted = False
            for _ in range(1 if age else 4):
                d, trial_poses = step_within(bounds_of(free), theta, H, g, blocks, poses, damping)
                trial = with_parameters(effects, free, theta + d)
                trial_groups = self.residuals_of(trial, trial_poses, train)
                trial_loss = total(trial_groups, nu) + prior_loss(free, theta + d)
                if trial_loss <= loss + 1e-9:
                    accepted = True
                    break
                if age == 0:
                    damping = max(damping, 1e-2) * 10
            stale, age = age > 0, age + 1
            if not accepted and stale:
                age = OLDEST_DERIVATIVES
                continue
            if not accepted:
                converged = robust_scale == 1.0
                if converged:
                    break
                robust_scale, age = 1.0, 0  # derivatives are those of here
                continue
            gain = loss - trial_loss
            derivatives = updated(derivatives, groups, trial_groups, d, trial_poses - poses, np.diag(H))
            effects, poses, groups = trial, trial_poses, trial_groups
            damping = max(damping / 10, 1e-6)
            if robust_scale == 1.0 and gain < max(1.0, 1e-3 * loss):
                if not stale:
                    converged = True
                    break
                age = OLDEST_DERIVATIVES
            if gain < STILL_FAR * loss:  # a robust loss hides what is far: come near before narrowing
                robust_scale = max(1.0, robust_scale / 3)
        return Descent(State(effects, poses), tuple(free), groups, derivatives, converged)

    def without_rough(self, effects, rough, free, poses, train, iterations):
        """Return (effects, poses) fitted without the effects named ``rough``, which stay as they are.

        A codec's steps make the loss rough: a fit from afar would stick.
        """
        end = self.descend([e for e in effects if e[0] not in rough], free, poses, train, iterations).state
        return [(n, dict(end.effects).get(n, p)) for n, p in effects], end.poses

    # -- scoring --------------------------------------------------------------------------------------------------

    def score(self, effects, poses, indices):
        """Fit only the poses and own numbers of the given captures, then return (poses, {i: groups}) of residuals there.

        Images are drawn again while poses move by more than their corners can be led on to.
        """
        offsets = self.no_offsets()
        _, poses = self.fit_geometry(effects, [], poses, offsets, indices, scale=8.0, iterations=POSE_STEPS)
        if self.problem.own:
            poses = self.descend(effects, [], poses, indices, OWN_STEPS).state.poses
        for _ in range(DRAWN_AGAIN):
            self.cost += len(indices)
            drawn = self.each(lambda i: self.predictor.predict(i, effects, poses[i]), indices)  # noqa: B023
            offsets = self.offsets_of(effects, poses, indices)
            _, better = self.fit_geometry(effects, [], poses, offsets, indices, scale=8.0, iterations=POSE_STEPS)
            shifts = {i: self._corner_shift(i, effects, poses[i], better[i]) for i in indices}
            seen = [np.abs(shift[self.whiteners[i].plates]).max(initial=0.0) for i, shift in shifts.items()]
            if max(seen, default=0.0) < NEAR_PX:
                break
            poses = better
        out = {}
        for i in indices:
            features = drawn[i].features.copy()
            features[:, : shifts[i].shape[1]] += shifts[i]
            out[i] = self._residuals(i, better[i], replace(drawn[i], features=features))
        return better, out

    def _corner_shift(self, i, effects, start, end):
        """Return how far the twin's corners (p, 8) move from one pose of capture i to another, pixels."""
        moved = self.problem.corners_of(self.problem.captures[i], effects, end)
        return np.nan_to_num(flat(moved - self.problem.corners_of(self.problem.captures[i], effects, start)))

    def self_simulation_residuals(self, i, effects, pose):
        """Return {group: whitened residuals} of a capture that the twin itself takes, noise and all, about the expected.

        What a pose could explain is taken out, as it is from a real capture.
        """
        expected = self.predictor.predict(i, effects, pose)
        taken = self.predictor.shown(i, effects, pose).taken("own scatter")
        both = taken.measured & expected.measured
        taken = replace(
            taken,
            features=np.where(both[:, None], taken.features, expected.features),
            colour=np.where(both[:, None], taken.colour, expected.colour),
        )
        groups = self.whiteners[i].residuals(taken, expected)
        Li, plates = self.whiteners[i].corner_inverse, self.whiteners[i].plates
        J = self.derivatives_of.corners_by_pose(i, effects, pose)
        whitened = np.einsum("pij,pjk->pik", Li, J).reshape(-1, N_POSE)
        move = np.linalg.lstsq(whitened, groups["corners"].ravel(), rcond=None)[0]
        taken.features[plates, CORNERS] -= J @ move
        return self.whiteners[i].residuals(taken, expected)
