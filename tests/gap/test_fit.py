"""The normal equations of a fit: what poses can explain, parameters must not."""

import numpy as np
import pytest

from effects import library
from gap.fit.normal_equations import errors_of, normal_equations, response, step_within, updated, without_pose
from gap.fit.parameters import image_step
from gap.fit.residuals import NU, Whitener, rounding_variance
from gap.observables import FEATURE_FLOOR


def residuals_and_derivatives():
    rng = np.random.default_rng(4)
    return rng.normal(0, 2, 60), rng.normal(size=(60, 3)), rng.normal(size=(60, 6))


def test_what_a_pose_explains_moves_no_parameter():
    """Errors would be too large, or a pose's error be laid on a lens, if poses were not eliminated from the gradient."""
    y, Jt, Jp = residuals_and_derivatives()
    by_pose = Jp @ np.arange(1.0, 7.0)[:, None]
    assert np.abs(response(y, Jt, Jp, by_pose)).max() < 1e-6
    np.testing.assert_allclose(response(y, Jt, Jp, y[:, None])[:, 0], without_pose(y, Jt, Jp, NU)[1], atol=1e-6)


def test_a_camera_that_ran_off_raises_nothing():
    """Fails if a candidate that drives a camera into its board, where one point's derivatives outweigh all else by more than
    numbers hold, ends the whole diagnosis with "Singular matrix".
    """
    rng = np.random.default_rng(5)
    Jt, near = rng.standard_normal((4, 2)), rng.standard_normal((4, 1))
    H, g, (A, b, C) = without_pose(np.full(4, 0.1), Jt, 1e11 * near * np.array([[1.0, 2.0, 4.0]]), NU)
    with pytest.raises(np.linalg.LinAlgError):
        np.linalg.solve(A, b)
    _, poses = step_within(
        (np.full(2, -9.0), np.full(2, 9.0)), np.zeros(2), H, g, [(0, A, b, C)], np.zeros((1, 6)), 1e-4
    )
    assert np.isfinite(H).all() and np.isfinite(poses).all() and np.abs(poses).max() < 1e-6


def test_rounding_errs_where_no_noise_carries_levels_across():
    """A constant floor would blind the fit to levels in noise, none would make a rounded flat a difference."""
    simulated = {}
    for sd in (0.0, 0.3, 1.0):
        noise = np.random.default_rng(1).normal(0, sd, 20000)
        levels = np.linspace(100, 101, 41)[:-1]
        simulated[sd] = np.mean([(np.rint(level + noise).mean() - level) ** 2 for level in levels])
        variance = np.mean([np.rint(level + noise).var() for level in levels])
        assert rounding_variance(variance) >= 0.5 * simulated[sd] - 1e-4
    assert rounding_variance(0.0) == 1 / 12
    assert rounding_variance(1.0) < 1e-12


def test_steps_of_derivatives_are_near_what_matters_of_every_parameter():
    """Two hundredths of a ratio are ten pixels at the edge: a fit of colour fringes would stop half way."""
    for name, module in library.available_effects().items():
        for key, p in module.PARAMETERS.items():
            assert abs(image_step((name, key), p.null)) == pytest.approx(p.matters)


@pytest.mark.parametrize(("share_of_error", "corrected"), [(2.0, True), (1e-3, False)])
def test_a_step_within_the_errors_corrects_no_derivative(share_of_error, corrected):
    """Wrong if noise over a tiny step became a derivative: a share of 0.0808 was stated to 0.0000002, and 200 errors off."""
    rng = np.random.default_rng(3)
    J = rng.normal(0, 1, (400, 1))
    precision = (J * J).sum(0)
    d = share_of_error / np.sqrt(precision)
    before = {0: {"levels": rng.normal(0, 1, 400)}}
    after = {0: {"levels": before[0]["levels"] - 1.5 * J @ d + rng.normal(0, 1e-3, 400)}}
    new, _ = updated({0: (J, np.zeros((400, 6)))}, before, after, d, np.zeros((1, 6)), precision)[0]
    assert np.allclose(new, 1.5 * J if corrected else J, atol=0.1)


def whitener_of_one_plate():
    """Return a Whitener that whitens nothing: one plate, no colour, field or noise."""
    whitener = object.__new__(Whitener)
    whitener.plates, whitener.lower_inverse, whitener.with_noise = np.array([0]), np.eye(19)[None], False
    whitener.n_pose = 6
    whitener.field_sd, whitener.colour_sd, whitener.floor = np.zeros(0), np.ones((1, 10)), FEATURE_FLOOR
    return whitener


SIZES = {"corners": (1, 8), "levels": (1, 5), "edges": (1, 6), "colour": (1, 10), "pose": (6,)}


def test_stated_errors_follow_the_scatter_and_cautious_ones_do_not():
    """Errors of residuals that scatter by 0.3 are 0.3 of what whitening says; poses count as they were declared."""
    rng, captures = np.random.default_rng(1), range(60)
    groups = {i: {name: 0.3 * rng.standard_normal(size) for name, size in SIZES.items()} for i in captures}
    by_image = np.vstack([np.eye(29, 1), np.zeros((6, 1))])
    by_pose_alone = np.vstack([np.zeros((29, 1)), np.eye(6, 1)])
    derivatives = {i: (np.hstack([by_image, by_pose_alone]), np.zeros((35, 6))) for i in captures}
    H, _, _ = normal_equations(derivatives, groups, NU, (np.zeros((2, 2)), np.zeros(2)))
    whiteners = dict.fromkeys(captures, whitener_of_one_plate())
    errors, cautious = errors_of(np.linalg.inv(H), derivatives, groups, np.zeros(2), whiteners)
    expected = 1 / np.sqrt(len(captures))
    np.testing.assert_allclose(errors, [0.3 * expected, expected], rtol=0.2)
    np.testing.assert_allclose(cautious, [expected, expected], rtol=0.05)


@pytest.mark.parametrize(("scatter", "shown"), [(0.1, 0.1), (3.0, 1.0)])
def test_what_all_plates_share_is_stated_as_far_as_residuals_show_the_floors(scatter, shown):
    """Fails if a parameter that many plates tell is stated to a quarter of floors ten times as wide as all residuals, if its name
    is given by that, or if a twin that fits badly makes the floors wider than declared.
    """
    rng, captures, floor = np.random.default_rng(2), range(200), 8.0
    groups = {i: {name: scatter * rng.standard_normal(size) for name, size in SIZES.items()} for i in captures}
    derivatives = {i: (np.eye(35, 1), np.zeros((35, 6))) for i in captures}
    H, _, _ = normal_equations(derivatives, groups, NU, (np.zeros((1, 1)), np.zeros(1)))
    whitener = whitener_of_one_plate()
    whitener.floor = np.full(19, floor)
    errors, cautious = errors_of(np.linalg.inv(H), derivatives, groups, np.zeros(1), dict.fromkeys(captures, whitener))
    assert cautious[0] == pytest.approx(floor / 4, rel=0.1)
    assert errors[0] == pytest.approx(shown * floor / 4, rel=0.15)


def test_what_only_a_prior_tells_is_known_as_well_as_the_prior():
    """A parameter that no residual sees, as a codec's colour in grey images, would be stated without any error."""
    groups = {0: {name: np.ones(size) for name, size in SIZES.items()}}
    derivatives = {0: (np.zeros((35, 1)), np.zeros((35, 6)))}
    errors, cautious = errors_of(
        np.diag([0.5**2]), derivatives, groups, np.array([0.5**-2]), {0: whitener_of_one_plate()}
    )
    assert (errors[0], cautious[0]) == (pytest.approx(0.5), pytest.approx(0.5))
