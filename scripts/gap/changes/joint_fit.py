"""One twin fitted to two sets of captures: effects have the same parameters in both, but for those that have changed."""

from dataclasses import dataclass, replace

import numpy as np

from gap.fit.normal_equations import errors_of, normal_equations, step_within, without_pose
from gap.fit.parameters import bounds_of, fitted_parameters, get_parameter, is_geometric, priors_of, with_parameters
from gap.fit.residuals import NU, flatten, robust_scale_of, total

SCALE_FROM_AFAR = 16.0  # robust scale at which a fit of corners begins
ITERATIONS = 25
MAX_DAMPINGS = 5  # of one step
SETTLED = 1e-4  # share of the loss that a last step gains
MEDIAN_OF_NOISE = 0.6745  # of the absolute values of a unit normal
WEAK = 1.0  # widths of its bounds, a parameter's prior where it has none


@dataclass(frozen=True)
class JointTwin:
    """A twin of two sets of captures.

    effects  for each set ((name, {parameter: value}), ...); they differ in the ``changed`` ones alone
    poses (n, 6); groups {capture: residual groups}; loss
    errors   for each set {(effect, parameter): standard error} of what was fitted
    """

    effects: tuple
    changed: tuple
    poses: np.ndarray
    groups: dict
    loss: float
    errors: tuple = ({}, {})

    @property
    def names(self):
        """The names of its effects."""
        return [name for name, _ in self.effects[0]]


class Slots:
    """Which entry of a joint fit's vector each set's parameter is: one for both sets, or for a changed effect one each.

    free  [(effect, parameter)]; of  for each set the entries (len(free),); slots [(set, index in free)] whose value an
    entry is.
    """

    def __init__(self, free, changed):
        self.free, self.slots, self.of = list(free), [], ([], [])
        for k, (effect, _) in enumerate(free):
            for number in (0, 1):
                if number == 0 or effect in changed:
                    self.slots.append((number, k))
                self.of[number].append(len(self.slots) - 1)

    def values(self, effects):
        """Return the vector of both sets' effects."""
        return np.array([get_parameter(effects[number], self.free[k]) for number, k in self.slots])

    def parameters(self):
        """Return [(effect, parameter)] of the entries."""
        return [self.free[k] for _, k in self.slots]

    def with_values(self, effects, values):
        """Return both sets' effects with the vector's values."""
        return tuple(tuple(with_parameters(e, self.free, values[of])) for e, of in zip(effects, self.of, strict=True))


def ridge_of(free):
    """Return (null, precision) arrays of the parameters' priors: a weak one where they have none."""
    null, precision = priors_of(free)
    lower, upper = bounds_of(free)
    return null, np.maximum(precision, 1 / (WEAK * (upper - lower)) ** 2)


class JointFit:
    """Fits twins to the captures of two sets by a solver.Solver."""

    def __init__(self, solver, belongs, indices):
        """belongs (n,): the set, 0 or 1, of each of the problem's captures; ``indices`` are those that are used."""
        self.solver, self.belongs, self.indices = solver, belongs, list(indices)
        self.members = [[i for i in self.indices if belongs[i] == k] for k in (0, 1)]

    def start(self, effects):
        """Return the JointTwin of effects that both sets share, fitted to points alone; nothing changed."""
        poses, none = self.solver.problem.start_poses(), self.solver.no_offsets()
        geometric = [f for f in fitted_parameters(effects) if is_geometric(f)]
        effects, poses = self.solver.fit_geometry(
            list(effects), geometric, poses, none, self.indices, SCALE_FROM_AFAR, ITERATIONS
        )
        return self.twin((tuple(effects), tuple(effects)), (), poses)

    def twin(self, effects, changed, poses):
        """Return the JointTwin of both sets' effects as they are, nothing fitted."""
        groups = self.residuals_of(effects, poses)
        return JointTwin(tuple(map(tuple, effects)), tuple(changed), poses, groups, total(groups, NU))

    def residuals_of(self, effects, poses):
        """Return {capture: residual groups}, in the captures' order."""
        found = {}
        for k, members in enumerate(self.members):
            found |= self.solver.residuals_of(list(effects[k]), poses, members)
        return {i: found[i] for i in self.indices}

    def derivatives(self, twin, free, step_of=None):
        """Return {capture: (Jt, Jp)} by parameters of the capture's own set and by its pose."""
        found = {}
        for k, members in enumerate(self.members):
            found |= self.solver.derivatives(list(twin.effects[k]), free, twin.poses, members, step_of)
        return {i: found[i] for i in self.indices}

    def by_slots(self, twin, slots):
        """Return {capture: (Jt, Jp)} by the entries of a joint fit's vector."""
        out = {}
        for i, (Jt, Jp) in self.derivatives(twin, slots.free).items():
            wide = np.zeros((len(Jt), len(slots.slots)))
            wide[:, slots.of[self.belongs[i]]] = Jt
            out[i] = wide, Jp
        return out

    def fitted(self, twin):
        """Return a JointTwin with all that a fit may move fitted, of changed effects for each set.

        Gauss-Newton with an annealed robust scale, as solver.Solver.fit; errors are normal_equations.errors_of's.
        """
        slots = Slots(fitted_parameters(twin.effects[0]), twin.changed)
        parameters = slots.parameters()
        null, precision = ridge_of(parameters)
        bounds = bounds_of(parameters)
        robust_scale, damping, derivatives = robust_scale_of(twin.groups), 1e-4, None
        for _ in range(ITERATIONS):
            theta, nu = slots.values(twin.effects), NU * robust_scale**2
            loss = total(twin.groups, nu) + (precision * (theta - null) ** 2).sum()
            derivatives = self.by_slots(twin, slots)
            H, g, blocks = normal_equations(
                derivatives, twin.groups, nu, (np.diag(precision), precision * (null - theta))
            )
            new = None
            for _ in range(MAX_DAMPINGS):
                d, poses = step_within(bounds, theta, H, g, blocks, twin.poses, damping)
                trial = self.twin(slots.with_values(twin.effects, theta + d), twin.changed, poses)
                trial_loss = total(trial.groups, nu) + (precision * (theta + d - null) ** 2).sum()
                if trial_loss <= loss:
                    new = trial
                    break
                damping = max(damping, 1e-3) * 10
            if new is None:
                if robust_scale == 1.0:
                    break
                robust_scale = 1.0
                continue
            twin, damping = new, max(damping / 10, 1e-7)
            if robust_scale == 1.0 and loss - trial_loss < SETTLED * max(loss, 1.0):
                break
            robust_scale = max(1.0, robust_scale / 3)
        return self._with_errors(twin, slots, precision)

    def _with_errors(self, twin, slots, precision):
        """Return a fitted JointTwin with its parameters' standard errors."""
        derivatives = self.by_slots(twin, slots)
        H, _, _ = normal_equations(derivatives, twin.groups, NU, (np.diag(precision), np.zeros(len(precision))))
        errors, _ = errors_of(np.linalg.pinv(H), derivatives, twin.groups, precision, self.solver.whiteners)
        of_sets = tuple(dict(zip(slots.free, errors[of], strict=True)) for of in slots.of)
        return replace(twin, errors=of_sets)


def equations_of(fit, twin, free, step_of):
    """Return ({capture: (y, Jt, Jp)}, nu): residuals (n,) of a JointTwin, their derivatives by parameters ``free`` (n, k) of the
    capture's own set and by its pose (n, 6); and nu of their robust loss.

    Its scale is the median residual's of the set that lies farther off: a common twin may fit one of them alone.
    """
    sets = [np.concatenate([flatten(twin.groups[i]) for i in members]) for members in fit.members]
    usual = max(np.median(np.abs(y)) for y in sets)
    derivatives = fit.derivatives(twin, free, step_of)
    equations = {i: (flatten(twin.groups[i]), *derivatives[i]) for i in fit.indices}
    return equations, NU * max(1.0, usual / MEDIAN_OF_NOISE) ** 2


def moments(equations, nu):
    """Return (H (n, k, k), g (n, k)) of n captures' ``equations_of``; what is a capture's own is eliminated."""
    made = (without_pose(*equation, nu)[:2] for equation in equations.values())
    return tuple(map(np.array, zip(*made, strict=True)))
