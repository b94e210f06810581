"""Parameters [(effect, parameter), ...] of lists of effects [(name, {parameter: value}), ...]: values, bounds, priors, steps."""

import numpy as np

from effects import library


def spec(parameter):
    """Return the effects.base.Parameter of (effect, parameter)."""
    return library.parameters_of(parameter[0])[parameter[1]]


def fitted_parameters(effects):
    """Return [(effect, parameter)] of all that a fit of a list of effects may move."""
    return [(n, k) for n, p in effects for k in p if not spec((n, k)).is_choice]


def get_parameter(effects, parameter):
    """Return the value of (effect, parameter) in a list of effects."""
    return dict(effects)[parameter[0]][parameter[1]]


def with_parameters(effects, free, values):
    """Return the list of effects with the free parameters set to the values."""
    new = {name: dict(p) for name, p in effects}
    for (name, parameter), value in zip(free, values, strict=True):
        new[name][parameter] = float(value)
    return list(new.items())


def in_place(effects, name, other):
    """Return effects [(name, p)] in which another, (name, p), has the place of one."""
    return [other if e[0] == name else e for e in effects]


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


def scaled(name, start, scale):
    """Return an effect's parameters as far from the null as a start, times a scale, within their bounds."""
    out = dict(start)
    for key in start:
        s = spec((name, key))
        if not s.auxiliary:
            out[key] = float(np.clip(s.null + scale * (start[key] - s.null), s.lower, s.upper))
    return out


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
