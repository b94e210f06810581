"""Twins of values alone, in the place of fitted ones."""

from types import SimpleNamespace

import numpy as np

from gap.twin import Twin


class StandingTwin(SimpleNamespace):
    """Effects, what they leave above the floor, losses."""

    def __init__(self, effects, left, losses):
        super().__init__(effects=effects, left=left, losses=losses, names=[n for n, _ in effects])


def base_twin():
    return Twin((), np.zeros((0, 6)), {}, {}, {}, {}, {}, 0.0, True)


def standing_with(effects, loss):
    """Return a StandingTwin of effects that loses so much on held-out captures."""
    return StandingTwin(tuple(effects), 0.0, {0: loss})
