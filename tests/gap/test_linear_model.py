"""What effects would explain together, to first order: the linear model of tests/bench/bench_together.py."""

import numpy as np
import pytest

from bench_together import LinearModel

H, G = np.array([[4.0, 2.0, 0.0], [2.0, 4.0, 0.0], [0.0, 0.0, 1.0]]), np.array([8.0, 8.0, -3.0])


def test_what_two_columns_share_is_gained_once():
    """Fails if the gain of two effects is the sum of what each would gain alone."""
    model = LinearModel(H, G, np.full(3, -np.inf), np.full(3, np.inf), own=())
    assert model.gain([0]) == pytest.approx(16, rel=1e-5)
    assert model.gain([0, 1]) == pytest.approx(64 / 3, rel=1e-5)


def test_a_step_that_its_bounds_forbid_gains_nothing():
    """Fails if a blur of less than nothing counts as a gain."""
    free, bounded = (
        LinearModel(H, G, np.array([-np.inf, -np.inf, low]), np.full(3, np.inf), ()) for low in (-np.inf, 0.0)
    )
    assert free.gain([0, 1, 2]) == pytest.approx(64 / 3 + 9, rel=1e-5)
    assert bounded.gain([0, 1, 2]) == bounded.gain([0, 1])


def test_a_gain_is_counted_beside_what_the_twin_has_already():
    """Fails if the twin's own parameters do not go along."""
    model = LinearModel(H, G, np.full(3, -np.inf), np.full(3, np.inf), own=(0,))
    assert model.gain([1]) - model.gain([]) == pytest.approx(64 / 3 - 16, rel=1e-5)
