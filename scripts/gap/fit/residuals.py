"""Residuals of real minus twin on one scale: whitened by the fit's own covariance, floors and noise, and their robust loss."""

import numpy as np

from gap.observables import COLUMN, CORNERS, FEATURE_FLOOR, FEATURE_GROUPS, FLOORS, GAP_GROUPS, SURFACES

NU = 8.0  # robust log(1 + y^2 / nu): quadratic for noise, forgiving for a bad plate
# The features whose deviations a colour's have at least: it is a difference of levels, or of places
OF_COLOUR = [COLUMN[name] for name in ("white", "black", "ground", "corner_x0", "corner_y0")] * 2
LOST_PLATE = 6.0  # whitened residual charged per feature of a plate that only the real image shows
GROUPS = (*GAP_GROUPS, "pose")


def rho(y, nu=NU):
    """Return the robust loss of whitened residuals, y^2 where small; ``nu`` is NU times the robust scale squared."""
    return nu * np.log1p(y * y / nu)


def rho_of_noise():
    """Return the mean of rho over a unit normal: the loss of a perfect model."""
    x = np.linspace(-8, 8, 4001)
    w = np.exp(-x * x / 2)
    return float((rho(x) * w).sum() / w.sum())


RHO_NOISE = rho_of_noise()


class Whitener:
    """What turns one capture's residuals into unit-variance ones; made once from the real observation."""

    def __init__(self, capture, with_noise, n_pose):
        o, self.n_pose = capture.observation, n_pose
        self.plates = np.flatnonzero(o.measured)
        s2 = capture.noise_variance
        info = o.information[self.plates]
        covariance = np.linalg.inv(info) * s2
        self.floor = FEATURE_FLOOR[: info.shape[1]]
        rounding = np.zeros(len(self.floor))
        rounding[SURFACES] = rounding_variance(s2)
        covariance = covariance + np.diag(self.floor**2 + rounding)
        self.lower_inverse = np.linalg.inv(np.linalg.cholesky(covariance))
        self.corner_inverse = np.linalg.inv(np.linalg.cholesky(covariance[:, CORNERS, CORNERS]))
        self.feature_sd = sd = np.sqrt(np.diagonal(covariance, axis1=1, axis2=2))
        colours = o.colour.shape[1]
        self.colour_sd = np.hypot(sd[:, OF_COLOUR[:colours]], FLOORS["colour"][:colours])
        with np.errstate(divide="ignore"):
            self.field_sd = np.sqrt(s2 / np.maximum(o.field_n, 1) + FLOORS["field"] ** 2 + rounding_variance(s2))
        self.cells = slice(None) if (o.field_n > 0).any() else slice(0)  # a board's photograph shows no ground
        self.field_sd = self.field_sd[self.cells]
        noise_floor = FLOORS["noise"][: len(o.noise_se)]
        self.noise_sd = np.sqrt(2 * o.noise_se**2 + noise_floor**2)  # the twin's is drawn as well
        self.with_noise = with_noise

    @property
    def size(self):
        """The number of all residuals of the capture."""
        rest = self.colour_sd.size + len(self.field_sd) + (len(self.noise_sd) if self.with_noise else 0) + self.n_pose
        return len(self.plates) * len(self.floor) + rest

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
        field = (observation.field - prediction.field)[self.cells] / self.field_sd
        out = _by_group(y, colour, np.nan_to_num(field))
        if prediction.noise is not None:
            out["noise"] = np.nan_to_num((observation.noise - prediction.noise) / self.noise_sd)
        return out

    def whitened(self, change):
        """Return the whitened change (n,) of a prediction, in the order of GROUPS, that of its pose 0."""
        k = self.plates
        y = np.einsum("pij,pj->pi", self.lower_inverse, np.nan_to_num(change.features[k]))
        y[~change.measured[k]] = 0
        out = _by_group(y, change.colour[k] / self.colour_sd, np.nan_to_num(change.field[self.cells] / self.field_sd))
        if change.noise is not None:
            out["noise"] = np.nan_to_num(change.noise / self.noise_sd)
        return flatten(out | {"pose": np.zeros(self.n_pose)})

    def whitened_features(self, change):
        """Return what ``whitened`` does (n, m) where plates' features change by (plates that were measured, 19, m) alone."""
        y = np.einsum("pij,pjm->pim", self.lower_inverse, change)
        parts = [y[:, part].reshape(-1, change.shape[2]) for part in FEATURE_GROUPS.values()]
        return np.concatenate([*parts, np.zeros((self.size - y.shape[0] * y.shape[1], change.shape[2]))])


def _by_group(y, colour, field):
    return {name: y[:, part] for name, part in FEATURE_GROUPS.items()} | {"colour": colour, "field": field}


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


def robust_scale_of(groups):
    """Return the robust scale of residuals: their RMS in units of noise, at least 1.

    Robust losses stick when started far away: a fit begins at its residuals' scale and is annealed to 1.
    """
    return max(1.0, float(np.sqrt(np.mean([np.mean(flatten(g) ** 2) for g in groups.values()]))))


def total(groups, nu):
    """Return the loss of captures' residual groups."""
    return float(sum(rho(flatten(g), nu).sum() for g in groups.values()))
