"""What a comparison would have shown: amounts that are said to be seen are seen about as often as not, in data drawn anew."""

from dataclasses import replace

import numpy as np
import pytest

from effects import library
from gap.bounds import MAX_P
from gap.changes.changes import Asked, power_to_see
from gap.changes.permutation import Moments, labellings, p_values
from gap.changes.power import AMOUNTS, clear_ones, least_seen
from gap.observables import SIGNS
from gap.signatures.signature_comparison import compared

CAPTURES = 5  # of each set
DRAWN = 40
INFORMATION = 4e5  # of each capture, on a ratio
EFFECTS = ["focal_length", "pixel_aspect"]


def test_the_least_amount_is_the_first_that_most_divisions_show():
    """Fails if the least is no amount that was seen, is not the least, or goes with another form of the effect."""
    start = clear_ones("veiling_glare")[0]["share"]
    asked = []

    def power(parameters):
        asked.append(parameters["share"])
        return 0.9 if parameters["share"] > 0.6 * start else 0.1

    times, amount = least_seen("veiling_glare", power)
    assert times == pytest.approx(0.5**0.5) and amount["share"] == pytest.approx(times * start)
    assert len(asked) < len(AMOUNTS)
    assert least_seen("veiling_glare", lambda _: 0.4) is None
    assert least_seen("motion_blur", lambda p: float(p["dy_px"] > p["dx_px"]))[1]["dx_px"] == 0


def test_what_starts_at_nothing_is_clear_in_each_parameter_by_itself():
    """Fails if a clear amount of such an effect is nothing, or is moved in a number that only says in which form it acts."""
    nulls = library.nulls_of("tone_curve")
    moved = [[key for key, value in clear.items() if value != nulls[key]] for clear in clear_ones("tone_curve")]
    assert moved == [[key] for key in nulls if key != "place"]


def drawn_moments(rng, ratio):
    """Return the Moments of two sets of captures whose second has another focal length; each has scatter of its own."""
    H = np.tile(np.diag([INFORMATION, INFORMATION]), (2 * CAPTURES, 1, 1))
    g = rng.normal(size=(2 * CAPTURES, 2)) * 3 * np.sqrt(INFORMATION)
    g[CAPTURES:, 0] += INFORMATION * ratio
    return Moments(H, g, np.zeros(0))


def asked_of(made, labels):
    """Return {effect: changes.Asked} of Moments by EFFECTS."""
    differences = [made.differences(np.array([k]), True, labels) for k in range(len(EFFECTS))]
    p = p_values(np.array([d.evidence for d in differences]))
    return {n: Asked(((n, "ratio"),), 0.0, p[k], (differences[k],)) for k, n in enumerate(EFFECTS)}


def test_a_change_of_points_is_seen_about_as_often_as_was_said():
    """Fails if the least focal length that is said to be seen is seen in hardly any or in nearly all captures drawn anew."""
    rng, labels = np.random.default_rng(3), labellings(np.repeat([0, 1], CAPTURES), np.random.default_rng(0))
    asked = asked_of(drawn_moments(rng, 0.0), labels)
    _, amount = least_seen("focal_length", lambda parameters: power_to_see("focal_length", asked, parameters))
    told = [asked_of(drawn_moments(rng, amount["ratio"] - 1), labels)["focal_length"].p <= MAX_P for _ in range(DRAWN)]
    assert 0.35 < np.mean(told) < 0.9


def test_what_moving_photographs_tell_counts_as_well():
    """Fails if a change is laid on still photographs alone, though their motion hides it, or only on moving ones."""
    labels = labellings(np.repeat([0, 1], CAPTURES), np.random.default_rng(0))
    quiet, loud = (drawn_moments(np.random.default_rng(k), 0.0) for k in (5, 6))
    loud = Moments(loud.H, 30 * loud.g, loud.precision)
    of = [asked_of(made, labels) for made in (quiet, loud)]
    amount = {"ratio": 1.02}
    for both in (of, of[::-1]):
        asked = {n: replace(a, differences=a.differences + both[1][n].differences) for n, a in both[0].items()}
        assert power_to_see("focal_length", asked, amount) > 0.8
    assert power_to_see("focal_length", of[1], amount) < 0.2


def test_a_change_of_signs_is_seen_about_as_often_as_was_said():
    """Fails if a move's power over divisions of one pair of sets is not how often sets drawn anew tell it."""
    rng, one, many = np.random.default_rng(4), np.zeros(len(SIGNS)), np.full(len(SIGNS), 1.2)
    one[5] = 4.5
    for moved in (one, many):
        said = np.mean([compared(*drawn_signs(rng, 0.0), 0).power(moved, MAX_P) for _ in range(DRAWN)])
        told = np.mean([compared(*drawn_signs(rng, moved), 0).p <= MAX_P for _ in range(DRAWN)])
        assert 0.4 < told < 0.95 and said == pytest.approx(told, abs=0.2)
    assert compared(*drawn_signs(rng, 0.0), 0).power(np.zeros(len(SIGNS)), MAX_P) <= 1.5 * MAX_P


def drawn_signs(rng, moved):
    """Return signatures (CAPTURES, signs) of two sets, the second one moved."""
    return rng.normal(size=(CAPTURES, len(SIGNS))), rng.normal(size=(CAPTURES, len(SIGNS))) + moved
