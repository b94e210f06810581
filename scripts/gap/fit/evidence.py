"""What an effect could gain, and what taking it out would cost, without a fit: the score test's and Wald's statistics."""

import numpy as np

from effects import library
from gap.fit.normal_equations import gains_of_step, normal_equations
from gap.fit.parameters import get_parameter, image_step, prior_equations, priors_of, spec

LONGER = 4.0  # times a step, where a codec rounds


def start_step(parameter, value):
    """Return the step from the null to the farthest start: an even parameter has no slope at its null."""
    effect, key = parameter
    steps = [start[key] - value for start in library.starts_of(effect) if start[key] != value]
    return max(steps, key=abs) if steps else image_step(parameter, value)


def step_over_rounding(parameter, value):
    """Return a step from the null that is LONGER than ``start_step`` by a factor, inside the bounds: what a codec rounds to its
    own coarse steps changes by none or by a whole one of them.
    """
    step, s = start_step(parameter, value), spec(parameter)
    return float(np.clip(value + LONGER * step, s.lower, s.upper)) - value


def first_order_gains(effects, free, derivatives, groups, nu):
    """Return the loss (groups,) that a Gauss-Newton step of the free parameters would gain, a score test's statistic.

    Groups are in the order of GROUPS.
    """
    H, g, blocks = normal_equations(derivatives, groups, nu, prior_equations(effects, free))
    scale = np.sqrt(np.maximum(np.diag(H), 1e-12))
    g, H = g / scale, H / np.outer(scale, scale)
    step = np.linalg.lstsq(H + 1e-6 * np.eye(len(g)), g, rcond=None)[0] / scale
    return gains_of_step(step, derivatives, groups, blocks, nu)


def evidence_of(effects, free, precision):
    """Return {effect: loss that taking it out costs to second order, the others refitted}, of what is free."""
    cost = cost_without(effects, free, precision)
    moving = {effect for effect, _ in free}
    return {name: cost([name]) for name, _ in effects if name in moving}


def cost_without(effects, free, precision):
    """Return a function of some effects' names: the loss that taking them all out costs to second order, the others refitted.

    ``precision`` (k, k) is the Hessian of half the loss by the free parameters. Wald's statistic: A. Wald, "Tests of statistical
    hypotheses concerning several parameters when the number of observations is large" (1943).
    """
    covariance = np.linalg.pinv(precision + 1e-12 * np.eye(len(free)))
    away = np.array([get_parameter(effects, f) for f in free]) - priors_of(free)[0]

    def cost(names):
        out = [k for k, (effect, _) in enumerate(free) if effect in names]
        return float(away[out] @ np.linalg.pinv(covariance[np.ix_(out, out)]) @ away[out])

    return cost
