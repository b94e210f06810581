"""Twins of values alone, in the place of fitted ones."""

from dataclasses import replace
from types import SimpleNamespace

import numpy as np

from gap.fit.residuals import NU, RHO_NOISE
from gap.select.twin import Twin


class StandingTwin(SimpleNamespace):
    """Effects, what they leave above the floor, losses."""

    def __init__(self, effects, left, losses):
        super().__init__(effects=effects, left=left, losses=losses, names=[n for n, _ in effects])


def base_twin():
    return Twin((), np.zeros((0, 6)), {}, {}, {}, {}, {}, 0.0, True)


def standing_with(effects, loss):
    """Return a StandingTwin of effects that loses so much on held-out captures."""
    return StandingTwin(tuple(effects), 0.0, {0: loss})


def twin_with_gaps(**gaps):
    """Return a Twin whose groups of observables, of 100 residuals each, have some gaps, in floors of 0.5."""
    of_gap = {
        name: NU * np.expm1((0.5 * gap) ** 2 * RHO_NOISE / NU) for name, gap in gaps.items()
    }  # the loss's inverse
    groups = {name: np.full((1, 100), np.sqrt(square)) for name, square in of_gap.items()}
    return replace(base_twin(), groups={0: groups}, floors=dict.fromkeys(gaps, 0.5))
