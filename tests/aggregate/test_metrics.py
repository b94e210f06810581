"""The statistics of Tables 1 and 2 against numbers worked out by hand or printed elsewhere."""

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from reporting.metrics import (
    FLIP_DEG,
    cohen_kappa,
    is_flipped,
    kappa_with_interval,
    mean_with_interval,
    relative_rotvec_deg,
    wilson_interval,
)


@pytest.mark.parametrize(
    ("part", "whole", "low", "high"),
    [(81, 263, 0.2553, 0.3662), (15, 148, 0.0624, 0.1605), (0, 20, 0.0, 0.1611), (1, 29, 0.0061, 0.1718)],
)
def test_wilson_is_the_published_interval(part, whole, low, high):
    """Fails if it is another interval, or has the continuity correction. Newcombe, Statistics in Medicine 17 (1998) 857."""
    assert wilson_interval(part, whole) == pytest.approx((low, high), abs=5e-5)
    assert wilson_interval(whole - part, whole) == pytest.approx((1 - high, 1 - low), abs=5e-5)


def test_wilson_without_trials_is_unknown():
    assert np.isnan(wilson_interval(0, 0)).all()


def test_kappa_of_a_table_worked_out_by_hand():
    """20 both, 5 only real, 10 only twin, 15 neither: observed 0.7, chance 0.5, kappa 0.4."""
    assert cohen_kappa(20, 5, 10, 15) == pytest.approx(0.4)


def test_kappa_of_agreement_that_chance_alone_gives_is_unknown():
    """Both sides find all markers: nothing is learnt, and a division by zero must not become 1 or 0."""
    assert np.isnan(cohen_kappa(12, 0, 0, 0))


def test_relative_rotation_is_geodesic_not_a_difference_of_vectors():
    """If rotation vectors were subtracted, 170 and -170 degrees about x would lie 340 degrees apart."""
    real, twin = np.radians([[170.0, 0, 0]]), np.radians([[-170.0, 0, 0]])
    assert relative_rotvec_deg(real, twin) == pytest.approx(np.array([[-20.0, 0, 0]]))


def _tilted(*degrees_about_x):
    """Rotation vectors of markers that face the camera, tilted about x."""
    facing = Rotation.from_euler("x", 180, degrees=True)
    return (Rotation.from_euler("x", np.c_[degrees_about_x], degrees=True) * facing).as_rotvec()


def test_flip_is_seen_when_the_sides_chose_opposite_solutions():
    """If missed, a few pairs of tens of degrees make up the mean rotation difference."""
    real, real_alt = _tilted(30), _tilted(-30)
    assert is_flipped(real, real_alt, _tilted(31), _tilted(-29)).tolist() == [False]
    assert is_flipped(real, real_alt, _tilted(-29), _tilted(31)).tolist() == [True]


def test_small_swaps_and_large_true_differences_are_no_flips():
    """Frontal solutions merge and swap by chance; and an honest error must not be excused as a flip."""
    small = FLIP_DEG / 4
    assert not is_flipped(_tilted(small), _tilted(-small), _tilted(-small), _tilted(small))[0]
    assert not is_flipped(_tilted(50), _tilted(-50), _tilted(20), _tilted(-20))[0]


def test_without_a_second_solution_nothing_is_called_flipped():
    assert not is_flipped(_tilted(30), np.full((1, 3), np.nan), _tilted(-30), _tilted(30))[0]


def test_bootstrap_draws_captures_not_markers():
    """Copies of a marker in the same capture add no information: the interval must not shrink."""
    rng = np.random.default_rng(1)
    values, captures = rng.normal(size=12), np.repeat(np.arange(6), 2)
    once = mean_with_interval(values, captures, np.random.default_rng(2))
    tenfold = mean_with_interval(np.repeat(values, 10), np.repeat(captures, 10), np.random.default_rng(2))
    assert once == pytest.approx(tenfold)
    assert once[1] < once[0] < once[2]


def test_one_capture_has_no_interval():
    mean, low, high = mean_with_interval(np.array([1.0, 3.0]), np.array(["a", "a"]), np.random.default_rng(0))
    assert mean == 2
    assert np.isnan([low, high]).all()


def test_kappa_interval_holds_kappa():
    rng = np.random.default_rng(3)
    real = rng.random(200) < 0.6
    twin = np.where(rng.random(200) < 0.8, real, ~real)
    kappa, low, high = kappa_with_interval(real, twin, np.repeat(np.arange(20), 10), rng)
    assert low < kappa < high
