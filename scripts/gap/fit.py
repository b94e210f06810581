"""Fit the parameters of a list of effects, the poses of all captures as nuisances, to a camera's observations.

Gauss-Newton on whitened residuals with a robust loss; pose blocks are eliminated by a Schur complement. Geometry is
fitted first from the corners and exact point maps alone (fast, wide basin), then everything from synthesised images,
measured by the same code as the real ones.
"""

from dataclasses import dataclass, replace

import numpy as np

from effects import library, pipeline
from gap.flats import field_levels
from gap.observe import (
    FINE,
    classify_flats,
    grey_of,
    measure_colour,
    measure_plates,
    observe_noise,
    states_at,
    states_of,
)
from gap.patch import N_FEATURES
from job import seed_of

NU = 8.0  # robust log(1 + y^2 / nu): quadratic for noise, forgiving for a bad plate
# Standard deviations below which no difference counts: synthesis against an ideal camera's image
FEATURE_FLOOR = np.array([0.006] * 8 + [0.15] * 3 + [0.15] * 2 + [0.012] * 3 + [0.004, 0.005, 0.006])
SHARED = 0.25  # of these floors, what all plates of all captures may have in common
LEVELS = slice(8, 11)  # white, black and ground among the features
COLOUR_FLOOR = np.array([0.15, 0.15, 0.15, 0.006, 0.006] * 2)
FIELD_FLOOR_DN = 0.12
NOISE_FLOOR = 0.02
LOST_PLATE = 6.0  # whitened residual charged per feature of a plate that only the real image shows
GROUPS = ("corners", "levels", "edges", "colour", "field", "noise", "pose")
STILL_FAR = 0.1  # share of its loss above which a step says that the next one gains as well
PREDICTIONS_KEPT = 4000  # some 20 kB each
TELLING = 0.25  # squared standard errors from which a step corrects derivatives
OLDEST_DERIVATIVES = 3  # steps that derivatives serve: they cost a prediction a parameter
POSE_STEPS = 25  # at most: a mount that was found askew turns held-out cameras by a degree
DRAWN_AGAIN, NEAR_PX = 3, 0.05  # times that held-out images are drawn, move of corners that is followed without
POSE_STEP = np.array([1e-5] * 3 + [1e-5] * 3)


def rho(y, nu=NU):
    """Return the robust loss of whitened residuals, y^2 where small."""
    return nu * np.log1p(y * y / nu)


def rho_of_noise():
    """Return the mean of rho over a unit normal: the loss of a perfect model."""
    x = np.linspace(-8, 8, 4001)
    w = np.exp(-x * x / 2)
    return float((rho(x) * w).sum() / w.sum())


RHO_NOISE = rho_of_noise()


@dataclass
class Prediction:
    """What the twin shows in one capture; arrays as in gap.observe.Observation."""

    features: np.ndarray
    measured: np.ndarray
    colour: np.ndarray
    field: np.ndarray
    noise: np.ndarray | None

    def corners_of(self, plates):
        """Return the corners (k, 4, 2) of some plates, pixels."""
        return self.features[plates, :8].reshape(-1, 4, 2)


@dataclass
class State:
    """A fitted twin: effects [(name, params)], poses (n, 6) of the captures, offsets of measured from exact corners."""

    effects: list
    poses: np.ndarray
    offsets: list


@dataclass
class Fit:
    """The outcome of a fit on the training captures; standard errors (k,) of its k free parameters.

    ``errors`` are told: what the residuals' own scatter makes of the parameters. ``cautious_errors`` are those of plates
    measured no better than ``FEATURE_FLOOR``, and decide whether an effect is there at all.
    """

    state: State
    loss: float
    errors: np.ndarray
    cautious_errors: np.ndarray
    converged: bool


# -- whitening ----------------------------------------------------------------------------------------------------


class Whitener:
    """What turns one capture's residuals into unit-variance ones; made once from the real observation."""

    def __init__(self, capture, with_noise):
        o = capture.observation
        self.plates = np.flatnonzero(o.measured)
        s2 = capture.noise_variance
        info = o.information[self.plates]
        covariance = np.linalg.inv(info) * s2 if len(info) else np.zeros((0, N_FEATURES, N_FEATURES))
        rounding = np.zeros(len(FEATURE_FLOOR))
        rounding[LEVELS] = rounding_variance(s2)
        covariance = covariance + np.diag(FEATURE_FLOOR**2 + rounding)
        self.lower_inverse = np.linalg.inv(np.linalg.cholesky(covariance)) if len(info) else covariance
        corner_covariance = covariance[:, :8, :8]
        self.corner_inverse = np.linalg.inv(np.linalg.cholesky(corner_covariance)) if len(info) else corner_covariance
        sd = np.sqrt(np.array([np.diag(c) for c in covariance])).reshape(-1, N_FEATURES)
        self.feature_sd = sd
        self.colour_sd = np.hypot(
            np.concatenate([sd[:, 8:11], sd[:, [0, 1]], sd[:, 8:11], sd[:, [0, 1]]], axis=1), COLOUR_FLOOR
        )
        with np.errstate(divide="ignore"):
            self.field_sd = np.sqrt(s2 / np.maximum(o.field_n, 1) + FIELD_FLOOR_DN**2 + rounding_variance(s2))
        self.noise_sd = np.hypot(o.noise_se, NOISE_FLOOR)
        self.with_noise = with_noise

    def residuals(self, observation, prediction):
        """Return {group: whitened residuals} of real minus twin, NaN-free; plates first axis kept as (p, k)."""
        k = self.plates
        e = observation.features[k] - prediction.features[k]
        lost = ~prediction.measured[k]
        e[lost] = 0
        y = np.einsum("pij,pj->pi", self.lower_inverse, e)
        y[lost] = LOST_PLATE
        colour = (observation.colour[k] - prediction.colour[k]) / self.colour_sd
        colour[lost] = 0
        field = np.nan_to_num((observation.field - prediction.field) / self.field_sd)
        out = {
            "corners": y[:, :8],
            "levels": y[:, 8:13],
            "edges": y[:, 13:],
            "colour": colour,
            "field": field,
        }
        if prediction.noise is not None:
            out["noise"] = np.nan_to_num((observation.noise - prediction.noise) / self.noise_sd)
        return out


def lost_plates(groups):
    """Return how many plates only the real captures show, of residual groups {capture index: {group: residuals}}."""
    return sum(int((g["corners"] == LOST_PLATE).all(axis=1).sum()) for g in groups.values())


def rounding_variance(noise_variance):
    """Return the variance of a level's error from rounding to whole grey levels, where noise (rounded) is so little.

    Noise of half a level carries the mean between whole ones; with none, it is off by up to a half. Source: the first
    harmonic of a Gaussian dither, e.g. Wannamaker et al., "A theory of nonsubtractive dither" (2000).
    """
    return np.exp(-4 * np.pi**2 * max(noise_variance - 1 / 12, 0.0)) / 12


def flatten(groups):
    """Return all whitened residuals of a capture as one vector, in the order of GROUPS."""
    return np.concatenate([groups[g].ravel() for g in GROUPS if g in groups])


class SameNormals:
    """A source of random numbers that gives a capture's the same ones whenever it is made: drawn once, kept in ``drawn``."""

    def __init__(self, seed, drawn):
        self.seed, self.drawn, self.calls = seed, drawn, 0
        self.others = np.random.default_rng([seed, 0])

    def standard_normal(self, shape, dtype=np.float64):
        """Return the standard normal numbers of this call; they are not to be written to."""
        self.calls += 1
        key = self.calls, tuple(shape), np.dtype(dtype)
        if key not in self.drawn:
            self.drawn[key] = np.random.default_rng([self.seed, self.calls]).standard_normal(shape, dtype=dtype)
            self.drawn[key].flags.writeable = False
        return self.drawn[key]

    def __getattr__(self, name):
        """Other distributions are drawn anew, alike each time."""
        return getattr(self.others, name)


# -- prediction ---------------------------------------------------------------------------------------------------


class Fitter:
    """Fits lists of effects to one case."""

    def __init__(self, case, noise_of=()):
        """Noise is compared in the captures ``noise_of`` alone."""
        self.case = case
        self.noise_of = [i in noise_of for i in range(len(case.captures))]
        self.whiteners = [Whitener(c, w) for c, w in zip(case.captures, self.noise_of, strict=True)]
        self.prior = np.where(np.isfinite(case.sigma_pose), 1 / case.sigma_pose**2, 0.0)
        self._radiance, self._predictions = {}, {}
        self._normals = {}  # of each capture, as SameNormals keeps them
        self._departures = {}  # of each capture's plates from exact corners and nominal levels, where the next fit starts

    def radiance(self, i, effects, delta):
        """Return the twin's radiance, cached by geometry: photometric steps draw nothing again."""
        key = (i, geometric_key(effects), delta.tobytes())
        if key not in self._radiance:
            stale = [k for k in self._radiance if k[0] == i]
            for k in stale[: max(0, len(stale) - 1)]:
                del self._radiance[k]
            self._radiance[key] = self.case.radiance_of(self.case.captures[i], effects, delta)
        return self._radiance[key]

    def predict(self, i, effects, delta):
        """Return the Prediction of capture i; many candidates ask for the same one, so the last ones are kept."""
        key = (i, pipeline.key_of(effects), delta.tobytes())
        if key not in self._predictions:
            if len(self._predictions) >= PREDICTIONS_KEPT:
                del self._predictions[next(iter(self._predictions))]
            self._predictions[key] = self._predict(i, effects, delta)
        return self._predictions[key]

    def _predict(self, i, effects, delta):
        case, capture = self.case, self.case.captures[i]
        radiance = self.radiance(i, effects, delta)
        image = case.image_of(radiance, capture, effects, delta)
        features, measured, colour, field = self._measured(i, image, effects, delta)
        noise = None
        if self.noise_of[i]:
            seed = seed_of(case.campaign, case.camera, capture.view.capture, "fit noise")
            rng = SameNormals(seed, self._normals.setdefault(i, {}))
            noisy = case.image_of(radiance, capture, effects, delta, rng)
            corners = features[:, :8].reshape(-1, 4, 2)
            outlines = case.corners_of(capture, effects, delta, case.scene_of(effects)[1].outlines)
            classes = classify_flats(image.shape[:2], corners, measured, outlines, capture.view, case.codes)
            noise, _ = observe_noise(noisy, classes)
        return Prediction(features, measured, colour, field, noise)

    def _measured(self, i, image, effects, delta):
        """Return (features, measured, colour, field) of an image of the twin's (H, W, C) of capture i."""
        case, o = self.case, self.case.captures[i].observation
        grey = grey_of(image)
        exact = case.corners_of(case.captures[i], effects, delta)
        wanted = o.measured & np.isfinite(exact).all((1, 2))
        nominal = states_at(exact, case.codes, case.rims_of(effects))
        features, _, measured, _ = measure_plates(
            grey, nominal + self._departures.get(i, 0.0), wanted, case.codes, FINE
        )
        lost = wanted & ~measured
        if i in self._departures and lost.any():
            again, _, found, _ = measure_plates(grey, nominal, lost, case.codes, FINE)
            features, measured = np.where(found[:, None], again, features), measured | found
        self._departures[i] = np.where(measured[:, None], states_of(features) - nominal, 0.0)
        colour = measure_colour(image, features[:, :8].reshape(-1, 4, 2), measured, case.codes)
        field, _ = field_levels(grey.astype(np.float64), o.classes)
        return features, measured, colour, field

    def own_scatter(self, i, effects, delta):
        """Return {group: whitened residuals} of a capture that the twin itself takes, noise and all, about the expected.

        What a pose could explain is taken out, as it is from a real capture.
        """
        case, capture = self.case, self.case.captures[i]
        expected = replace(self.predict(i, effects, delta), noise=None)
        rng = np.random.default_rng(seed_of(case.campaign, case.camera, capture.view.capture, "own scatter"))
        radiance = self.radiance(i, effects, delta)
        if capture.observation.has_noise_by_channel and radiance.shape[2] == 1:
            radiance = np.repeat(radiance, 3, axis=2)
        image = case.image_of(radiance, capture, effects, delta, rng)
        features, measured, colour, field = self._measured(i, image, effects, delta)
        both = measured & expected.measured
        taken = replace(
            capture.observation,
            features=np.where(both[:, None], features, expected.features),
            colour=np.where(both[:, None], colour, expected.colour),
            field=field,
        )
        groups = self.whiteners[i].residuals(taken, expected)
        Li, plates = self.whiteners[i].corner_inverse, self.whiteners[i].plates
        J = self.pose_jacobian(i, effects, delta)
        whitened = np.einsum("pij,pjk->pik", Li, J).reshape(-1, 6)
        move = np.linalg.lstsq(whitened, groups["corners"].ravel(), rcond=None)[0]
        taken.features[plates, :8] -= J @ move
        return self.whiteners[i].residuals(taken, expected)

    # -- geometry alone -------------------------------------------------------------------------------------------

    def corner_residuals(self, i, effects, delta, offset):
        """Return whitened corner residuals (p, 8) of capture i from exact point maps."""
        capture, w = self.case.captures[i], self.whiteners[i]
        exact = self.case.corners_of(capture, effects, delta).reshape(-1, 8)
        e = capture.observation.features[w.plates, :8] - exact[w.plates] - offset[w.plates]
        return np.einsum("pij,pj->pi", w.corner_inverse, np.nan_to_num(e, nan=50.0))

    def pose_jacobian(self, i, effects, delta):
        """Return d corners / d pose (p, 8, 6) of the real capture's plates."""
        capture, w = self.case.captures[i], self.whiteners[i]
        columns = []
        for k in range(6):
            step = np.zeros(6)
            step[k] = POSE_STEP[k]
            high = self.case.corners_of(capture, effects, delta + step).reshape(-1, 8)[w.plates]
            low = self.case.corners_of(capture, effects, delta - step).reshape(-1, 8)[w.plates]
            columns.append((high - low) / (2 * POSE_STEP[k]))
        return np.nan_to_num(np.stack(columns, axis=-1))

    def fit_geometry(self, effects, free, poses, offsets, train, scale=1.0, iterations=8):
        """Fit free geometric parameters and poses from corners alone; return (effects, poses).

        ``scale`` widens the robust loss at the start (annealed to 1 by halves).
        """
        theta = np.array([get_parameter(effects, f) for f in free])
        null, precision = priors_of(free)
        steps = np.array([small_step(f) for f in free])
        lower, upper = bounds_of(free)
        damping = 1e-6
        best = np.inf
        for _ in range(iterations):
            H = np.diag(precision)
            g = precision * (null - theta)
            loss = (precision * (null - theta) ** 2).sum()
            blocks = []
            nu = NU * max(scale, 1.0) ** 2
            for i in train:
                current = with_parameters(effects, free, theta)
                y = self.corner_residuals(i, current, poses[i], offsets[i])
                loss += (nu * np.log1p(y * y / nu)).sum()
                weight = 1 / (1 + y * y / nu)
                Li = self.whiteners[i].corner_inverse
                Jp = np.einsum("pij,pjk->pik", Li, self.pose_jacobian(i, current, poses[i]))
                Jt = np.zeros((*y.shape, len(free)))
                for k in range(len(free)):
                    h = np.zeros(len(free))
                    h[k] = steps[k]
                    high = self.corner_residuals(i, with_parameters(effects, free, theta + h), poses[i], offsets[i])
                    low = self.corner_residuals(i, with_parameters(effects, free, theta - h), poses[i], offsets[i])
                    Jt[..., k] = -(high - low) / (2 * steps[k])
                wy = (weight * y).reshape(-1)
                Jp, Jt = Jp.reshape(y.size, 6), Jt.reshape(y.size, len(free))
                wJp = weight.reshape(-1, 1) * Jp
                A = Jp.T @ wJp + np.diag(self.prior + 1e-9)
                b = Jp.T @ wy - self.prior * poses[i]
                C = wJp.T @ Jt
                H += Jt.T @ (weight.reshape(-1, 1) * Jt) - C.T @ np.linalg.solve(A, C)
                g += Jt.T @ wy - C.T @ np.linalg.solve(A, b)
                blocks.append((i, A, b, C))
                loss += (self.prior * poses[i] ** 2).sum()
            d = np.zeros(len(free))
            if len(free):
                d = np.linalg.solve(H + np.diag(np.diag(H) * damping + 1e-12), g)
                d = np.clip(theta + d, lower, upper) - theta
            poses = poses.copy()
            for i, A, b, C in blocks:
                poses[i] = poses[i] + np.linalg.solve(A, b - C @ d)
            theta = theta + d
            if scale <= 1.0 and abs(best - loss) < 1e-4 * max(loss, 1):
                break
            best = loss
            scale *= 0.5
        return with_parameters(effects, free, theta), poses

    # -- everything -----------------------------------------------------------------------------------------------

    def residual_vector(self, i, delta, prediction):
        """Return ({group: whitened residuals}) of capture i, the pose's lean included."""
        groups = self.whiteners[i].residuals(self.case.captures[i].observation, prediction)
        groups["pose"] = delta * np.sqrt(self.prior)
        return groups

    def residuals_at(self, i, effects, delta):
        """Return the residual groups of capture i for a list of effects."""
        return self.residual_vector(i, delta, self.predict(i, effects, delta))

    def start(self, effects, poses, indices):
        """Return (predictions, offsets): offsets are measured minus exact corners of the twin itself."""
        predictions, offsets = {}, [np.zeros((len(self.case.codes.half_code), 8)) for _ in self.case.captures]
        for i in indices:
            predictions[i] = self.predict(i, effects, poses[i])
            exact = self.case.corners_of(self.case.captures[i], effects, poses[i]).reshape(-1, 8)
            offsets[i] = np.nan_to_num(predictions[i].features[:, :8] - exact)
        return predictions, offsets

    def residuals_of(self, poses, predictions, indices):
        """Return {i: residual groups} of captures."""
        return {i: self.residual_vector(i, poses[i], predictions[i]) for i in indices}

    def fit(self, effects, free, poses, train, iterations=6, scale=1.0, with_geometry=True):
        """Fit the free parameters [(effect, parameter), ...] and the poses of the training captures.

        Return a Fit. ``effects`` gives the start and the fixed rest.
        """
        effects = [(n, dict(p)) for n, p in effects]
        geometric = [f for f in free if is_geometric(f)]
        offsets = [np.zeros((len(self.case.codes.half_code), 8)) for _ in self.case.captures]
        if geometric and with_geometry:
            effects, poses = self.fit_geometry(effects, geometric, poses, offsets, train, scale=scale)
        predictions, offsets = self.start(effects, poses, train)
        groups = self.residuals_of(poses, predictions, train)
        width = width_of(groups) if free else 1.0
        errors = cautious_errors = np.zeros(len(free))
        converged = not free
        lower, upper = bounds_of(free)
        damping, age = 1e-4, OLDEST_DERIVATIVES
        for _ in range(iterations):
            theta = np.array([get_parameter(effects, f) for f in free])
            nu = NU * width**2
            loss = total(groups, nu) + prior_loss(free, theta)
            if age >= OLDEST_DERIVATIVES:
                derivatives, age = self.derivatives(effects, free, poses, groups, train), 0
            H, g, blocks = self.normal_equations(derivatives, groups, nu, prior_equations(effects, free))
            accepted = False
            for _ in range(1 if age else 4):
                d = np.linalg.solve(H + np.diag(np.diag(H) * damping + 1e-12), g) if free else np.zeros(0)
                d = np.clip(theta + d, lower, upper) - theta
                trial_poses = poses.copy()
                for i, A, b, C in blocks:
                    trial_poses[i] = poses[i] + np.linalg.solve(A, b - C @ d)
                trial = with_parameters(effects, free, theta + d)
                trial_predictions, trial_offsets = self.start(trial, trial_poses, train)
                trial_groups = self.residuals_of(trial_poses, trial_predictions, train)
                trial_loss = total(trial_groups, nu) + prior_loss(free, theta + d)
                if trial_loss <= loss + 1e-9:
                    accepted = True
                    break
                if age == 0:
                    damping = max(damping, 1e-2) * 10
            stale, age = age > 0, age + 1
            if not accepted:
                age = OLDEST_DERIVATIVES
                if stale:
                    continue
                converged = width == 1.0
                if converged:
                    break
                width = 1.0
                continue
            gain = loss - trial_loss
            derivatives = updated(derivatives, groups, trial_groups, d, trial_poses - poses, np.diag(H))
            effects, poses, predictions, offsets = trial, trial_poses, trial_predictions, trial_offsets
            groups = trial_groups
            damping = max(damping / 10, 1e-6)
            if width == 1.0 and gain < max(1.0, 1e-3 * loss):
                if not stale:
                    converged = True
                    break
                age = OLDEST_DERIVATIVES
            if gain < STILL_FAR * loss:  # a robust loss hides what is far: come near before narrowing
                width = max(1.0, width / 3)
        if free:
            derivatives = self.with_exact_columns(derivatives, effects, free, poses, groups)
            H, _, _ = self.normal_equations(derivatives, groups, NU, prior_equations(effects, free))
            covariance = np.linalg.pinv(H + np.diag(np.full(len(free), 1e-12)))
            _, precision = priors_of(free)
            errors, cautious_errors = self.errors_of(covariance, derivatives, groups, precision)
        return Fit(State(effects, poses, offsets), total(groups, NU), errors, cautious_errors, converged)

    def derivatives(self, effects, free, poses, groups, train, step_of=None):
        """Return {i: (Jt, Jp)}: d (twin, whitened) by the free parameters (n, k) and by the capture's pose (n, 6).

        ``step_of`` (parameter, value) -> step of derivatives by images; gap.fit.image_step where None.
        """
        step_of = step_of or image_step
        out = {}
        for i in train:
            columns = [self._column(i, effects, f, poses[i], groups[i], step_of) for f in free]
            Jt = np.stack(columns, axis=1) if columns else np.zeros((len(flatten(groups[i])), 0))
            out[i] = Jt, self.pose_columns(i, effects, poses[i], groups[i])
        return out

    def with_exact_columns(self, derivatives, effects, free, poses, groups):
        """Return derivatives whose columns of point maps, which cost no image, are those of the fitted twin.

        A mount and the poses nearly cancel: columns that were led along (``updated``) would leave errors of any size.
        """
        out = {}
        for i, (Jt, _) in derivatives.items():
            Jt = Jt.copy()
            for k, f in enumerate(free):
                if is_geometric(f):
                    Jt[:, k] = self._column(i, effects, f, poses[i], groups[i], image_step)
            out[i] = Jt, self.pose_columns(i, effects, poses[i], groups[i])
        return out

    def errors_of(self, covariance, derivatives, groups, precision):
        """Return (errors, cautious errors) (k,) of parameters whose covariance (k, k) holds for residuals of variance 1.

        Residuals scatter less where a floor is more than the noise (what poses may be off by, and priors of ``precision``
        (k,), are declared and count as such), and those of one capture can be wrong together: the greater of what each by
        itself and each capture as a whole makes of the parameters. Cautious errors take a variance of 1 for the former.
        Both hold the part of the features' floors that is the same for all plates and does not average out. Sources:
        White, "A heteroskedasticity-consistent covariance matrix estimator" (1980); Liang and Zeger, "Longitudinal data
        analysis using generalized linear models" (1986).
        """
        single, gradients, shared = np.diag(precision), [], 0.0
        for i, (Jt, Jp) in derivatives.items():
            y, w = flatten(groups[i]), self.whiteners[i]
            each = weighted_without_pose(y, Jp, Jt)
            scattered = each * scatter_of(groups[i])[:, None]
            single = single + scattered.T @ scattered
            gradients.append(each.T @ y)
            floors = np.tile(SHARED * np.diag(FEATURE_FLOOR), (len(w.plates), 1, 1))
            shared = shared + response(y, Jt, Jp, self._laid_out(w, floors, groups[i]))
        g = np.array(gradients) - np.mean(gradients, axis=0)
        together = g.T @ g * len(g) / max(len(g) - 1, 1)
        single, together = (np.diag(covariance @ meat @ covariance) for meat in (single, together))
        common = ((covariance @ shared) ** 2).sum(1)
        cautious = np.maximum(together, np.diag(covariance))
        return np.sqrt(np.maximum(together, single) + common), np.sqrt(cautious + common)

    @staticmethod
    def normal_equations(derivatives, groups, nu, prior):
        """Return (H, g, pose blocks) of a Gauss-Newton step of the free parameters, poses eliminated.

        ``prior`` (H, g) is what the parameters' priors add.
        """
        (H, g), blocks = (part.copy() for part in prior), []
        for i, (Jt, Jp) in derivatives.items():
            H_i, g_i, block = without_pose(flatten(groups[i]), Jt, Jp, nu)
            H, g = H + H_i, g + g_i
            blocks.append((i, *block))
        return H, g, blocks

    def _column(self, i, effects, parameter, delta, groups, step_of):
        """Return d (twin, whitened) / d parameter: by point maps where it only moves points, else by images."""
        w = self.whiteners[i]
        if is_geometric(parameter):
            h = small_step(parameter)
            value = get_parameter(effects, parameter)
            capture = self.case.captures[i]
            high = self.case.corners_of(capture, with_parameters(effects, [parameter], [value + h]), delta)
            low = self.case.corners_of(capture, with_parameters(effects, [parameter], [value - h]), delta)
            d = np.nan_to_num((high - low).reshape(-1, 8)[w.plates] / (2 * h))
            return self._spread_corners(w, d[..., None], groups)[:, 0]
        h = step_of(parameter, get_parameter(effects, parameter))
        moved = with_parameters(effects, [parameter], [get_parameter(effects, parameter) + h])
        column = -(flatten(self.residuals_at(i, moved, delta)) - flatten(groups)) / h
        return np.clip(column, -1e6, 1e6)

    def pose_columns(self, i, effects, delta, groups):
        """Return d (twin, whitened) / d pose (n, 6) of capture i."""
        w = self.whiteners[i]
        J = self._spread_corners(w, self.pose_jacobian(i, effects, delta), groups)
        J[-6:] = -np.diag(np.sqrt(self.prior))
        return J

    @staticmethod
    def _spread_corners(w, d_corners, groups):
        """Whiten derivatives of corners (p, 8, k) and lay them where the residual vector has its plates."""
        k = d_corners.shape[-1]
        full = np.zeros((len(w.plates), N_FEATURES, k))
        full[:, :8] = d_corners
        return Fitter._laid_out(w, full, groups)

    @staticmethod
    def _laid_out(w, d_features, groups):
        """Whiten changes of features (p, 19, k) and lay them where the residual vector has its plates."""
        k = d_features.shape[-1]
        y = np.einsum("pij,pjk->pik", w.lower_inverse, d_features)
        parts = {"corners": y[:, :8], "levels": y[:, 8:13], "edges": y[:, 13:]}
        blocks = [
            parts[g].reshape(-1, k) if g in parts else np.zeros((groups[g].size, k)) for g in GROUPS if g in groups
        ]
        return np.concatenate(blocks)

    # -- scoring --------------------------------------------------------------------------------------------------

    def score(self, effects, poses, indices):
        """Fit only the poses of the given captures, then return (poses, {i: groups}) of residuals there.

        Images are drawn again while poses move by more than their corners can be led on to.
        """
        offsets = [np.zeros((len(self.case.codes.half_code), 8)) for _ in self.case.captures]
        _, poses = self.fit_geometry(effects, [], poses, offsets, indices, scale=8.0, iterations=POSE_STEPS)
        for _ in range(DRAWN_AGAIN):
            predictions, offsets = self.start(effects, poses, indices)
            _, better = self.fit_geometry(effects, [], poses, offsets, indices, scale=8.0, iterations=POSE_STEPS)
            shifts = {i: self._corner_shift(i, effects, poses[i], better[i]) for i in indices}
            seen = [np.abs(shift[self.whiteners[i].plates]).max(initial=0.0) for i, shift in shifts.items()]
            if max(seen, default=0.0) < NEAR_PX:
                break
            poses = better
        out = {}
        for i in indices:
            features = predictions[i].features.copy()
            features[:, :8] += shifts[i]
            out[i] = self.residual_vector(i, better[i], replace(predictions[i], features=features))
        return better, out

    def _corner_shift(self, i, effects, start, end):
        """Return how far the twin's corners (p, 8) move from one pose of capture i to another, pixels."""
        moved = self.case.corners_of(self.case.captures[i], effects, end)
        shift = (moved - self.case.corners_of(self.case.captures[i], effects, start)).reshape(-1, 8)
        return np.nan_to_num(shift)


def without_pose(y, Jt, Jp, nu):
    """Return (H, g, (A, b, C)) of one capture's residuals y (n,), its pose eliminated by the block (A, b, C)."""
    weight = 1 / (1 + y * y / nu)
    wJp = weight[:, None] * Jp
    A = Jp.T @ wJp + 1e-9 * np.eye(6)
    b = wJp.T @ y
    C = wJp.T @ Jt
    H = Jt.T @ (weight[:, None] * Jt) - C.T @ np.linalg.solve(A, C)
    return H, Jt.T @ (weight * y) - C.T @ np.linalg.solve(A, b), (A, b, C)


def response(y, Jt, Jp, change):
    """Return (k, m): what changes (n, m) of a capture's residuals y (n,) add to the gradient, its pose eliminated."""
    return Jt.T @ weighted_without_pose(y, Jp, change)


def scatter_of(groups):
    """Return the standard deviations (n,) that a capture's residual groups tell of themselves; 1 of what is declared."""
    return flatten(groups | {"pose": np.ones_like(groups["pose"])}) if "pose" in groups else flatten(groups)


def weighted_without_pose(y, Jp, change):
    """Return changes (n, m) of a capture's residuals y (n,) as far as its pose cannot follow, robustly weighted."""
    weight = (1 / (1 + y * y / NU))[:, None]
    back = np.linalg.solve(Jp.T @ (weight * Jp) + 1e-9 * np.eye(6), Jp.T @ (weight * change))
    return weight * (change - Jp @ back)


def updated(derivatives, before, after, d, d_poses, scale):
    """Return derivatives after a step of the parameters (k,) and poses (n, 6) that agree with what it changed.

    ``scale`` (k,) are the parameters' precisions. A step within the errors changes less than predictions are repeatable
    by, and tells nothing. Source: C. G. Broyden, "A class of methods for solving nonlinear
    simultaneous equations" (1965).
    """
    length = (scale * d * d).sum()
    if length < TELLING:
        return derivatives
    out = {}
    for i, (Jt, Jp) in derivatives.items():
        missed = flatten(before[i]) - flatten(after[i]) - Jt @ d - Jp @ d_poses[i]
        out[i] = Jt + np.outer(missed, scale * d) / length, Jp
    return out


def width_of(groups):
    """Return how much wider than noise residuals are, at least 1.

    Robust losses stick when started far away: a fit begins as wide as its residuals and narrows.
    """
    return max(1.0, float(np.sqrt(np.mean([np.mean(flatten(g) ** 2) for g in groups.values()]))))


def total(groups, nu):
    """Return the loss of captures' residual groups."""
    return float(sum(rho(flatten(g), nu).sum() for g in groups.values()))


# -- parameters ---------------------------------------------------------------------------------------------------


def spec(parameter):
    """Return the effects.base.Parameter of (effect, parameter)."""
    return library.parameters_of(parameter[0])[parameter[1]]


def get_parameter(effects, parameter):
    """Return the value of (effect, parameter) in a list of effects."""
    return dict(effects)[parameter[0]][parameter[1]]


def with_parameters(effects, free, values):
    """Return the list of effects with the free parameters set to the values."""
    new = {name: dict(p) for name, p in effects}
    for (name, parameter), value in zip(free, values, strict=True):
        new[name][parameter] = float(value)
    return list(new.items())


def bounds_of(free):
    """Return (lower, upper) arrays."""
    return np.array([spec(f).lower for f in free]), np.array([spec(f).upper for f in free])


def priors_of(free):
    """Return (null, precision) arrays of the parameters' priors; precision 0 where there is none."""
    null = np.array([spec(f).null for f in free], float)
    sd = np.array([spec(f).prior_sd or np.inf for f in free], float)
    return null, 1 / sd**2


def prior_equations(effects, free):
    """Return (H, g) of the parameters' priors."""
    null, precision = priors_of(free)
    return np.diag(precision), precision * (null - np.array([get_parameter(effects, f) for f in free]))


def prior_loss(free, theta):
    """Return the loss of the parameters' priors."""
    null, precision = priors_of(free)
    return float((precision * (theta - null) ** 2).sum())


def small_step(parameter):
    """Return a step for derivatives of exact point maps."""
    return 1e-2 * spec(parameter).matters


def image_step(parameter, value):
    """Return a step for derivatives by images: large enough to rise above filters' rounding, inside the bounds."""
    s = spec(parameter)
    h = max(s.matters, 0.02 * abs(value - s.null))
    return h if value + h <= s.upper else -h


def is_geometric(parameter):
    """Return whether the effect of (effect, parameter) only moves points."""
    return library.is_pure_geometry(parameter[0])


def geometric_key(effects):
    """Return a key of everything that decides the radiance before photometry."""
    return pipeline.key_of([(n, p) for n, p in effects if library.is_drawn(n)])
