"""Fitted twins and candidates as values: what they are, and how they do on the captures that were held out."""

from dataclasses import dataclass, field
from functools import cached_property

import numpy as np

from gap.bounds import CHARGE
from gap.fit.parameters import spec
from gap.fit.score import excess_of, gap_error, losses_of, overall_gap


@dataclass(frozen=True)
class Twin:
    """A fitted twin and how it does on the captures that were held out.

    effects  ((name, {parameter: value}), ...); poses (n, 6) of all captures
    groups   {held-out capture: residual groups}; floors {group: floor}
    errors, cautious_errors  {(effect, parameter): standard error} of what was fitted
    evidence  {effect: loss that taking it out costs to second order}; loss of the fitted captures
    """

    effects: tuple
    poses: np.ndarray
    groups: dict
    floors: dict
    errors: dict
    cautious_errors: dict
    evidence: dict
    loss: float
    converged: bool

    @property
    def names(self):
        """The names of its effects."""
        return [name for name, _ in self.effects]

    def told(self, name):
        """Return {parameter: {"value", "se"}} of an effect, the standard error None of what was not fitted or is at its bound."""
        return {k: {"value": v, "se": self._error_of((name, k), v)} for k, v in dict(self.effects)[name].items()}

    def _error_of(self, parameter, value):
        """Return the standard error of a value; None at a bound, beyond which the loss may fall: its curvature says nothing."""
        return None if value in (spec(parameter).lower, spec(parameter).upper) else self.errors.get(parameter)

    @cached_property
    def losses(self):
        """{held-out capture: loss}."""
        return losses_of(self.groups)

    @cached_property
    def excess(self):
        """{group: loss above the floor}."""
        return excess_of(self.groups, self.floors)

    @cached_property
    def gap(self):
        """The held-out gap."""
        return overall_gap(self.groups, self.floors)

    @cached_property
    def gap_se(self):
        """Its jackknife standard error over captures."""
        return gap_error(self.groups, self.floors)


@dataclass(frozen=True)
class Candidate:
    """What came of one effect added to a base: the ``twin``, and what it gains over the base.

    An effect that was not fitted is at its null. Where it is ``complete``, all effects of the twin were refitted with it.
    ``gain`` is in loss on the held-out captures, ``gain_se`` its standard error by the scatter over their stations, infinite
    of one alone and large of an effect that one station sees, whatever its strength. ``certain_gain`` is the part of it
    that captures tell independently of one another (score.shared_gain).
    """

    effect: str
    parameters: dict
    twin: Twin
    fitted: bool
    complete: bool = False
    gain: float = 0.0
    gain_se: float = float("nan")
    certain_gain: float = 0.0
    stations_gaining: float = 0.0
    is_significant: bool = False
    group_gains: dict = field(default_factory=dict)

    @property
    def main_group(self):
        """The group of observables in which it gains most."""
        return max(self.group_gains, key=self.group_gains.get)


def rank(candidates):
    """Return candidates, best held-out loss first, each parameter charged."""
    return sorted(candidates, key=lambda c: (-(c.gain - CHARGE * len(c.parameters)), c.effect))
