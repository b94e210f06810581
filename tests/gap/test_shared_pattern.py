"""What a sensor's own pattern, the same in all captures, makes of another effect's gain."""

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest
from stand_in_twins import base_twin

from gap.bounds import LITTLE
from gap.select.naming import is_missing, least_gain
from gap.select.search import Search

CAPTURES, COLUMNS, ROWS = 10, 10, 8
REPEATS, PATTERN = 0.5, 0.57  # standard deviations of what repeats of a station and columns differ by
FALL_OFF = {"a2": -0.1, "a4": 0.0, "a6": 0.0}
LEAST = least_gain("vignetting")


def candidate_beside(effect, seed, fall_off):
    """Return the Candidate of a vignetting that follows columns' pattern, and a fall-off of so much, beside an effect."""
    rng = np.random.default_rng(seed)
    x, y = np.meshgrid(np.linspace(-1, 1, COLUMNS), np.linspace(-0.7, 0.7, ROWS))
    r2 = (x**2 + y**2).ravel()
    own = np.tile(rng.normal(0, PATTERN, COLUMNS), (ROWS, 1)).ravel() + fall_off * (r2 - r2.mean())
    A = np.stack([r2, r2**2, r2**3, np.ones_like(r2)], axis=1)
    fitted = A @ np.linalg.lstsq(A, own, rcond=None)[0]
    seen = own + rng.normal(0, REPEATS, (CAPTURES, COLUMNS * ROWS))
    base = replace(
        base_twin(),
        effects=((effect, {}),),
        groups={i: {"field": v} for i, v in enumerate(seen)},
        floors={"field": float(np.hypot(REPEATS, PATTERN))},
    )
    twin = replace(base, effects=(*base.effects, ("vignetting", FALL_OFF)))
    twin = replace(twin, groups={i: {"field": v - fitted} for i, v in enumerate(seen)})
    captures = [SimpleNamespace(view=SimpleNamespace(station=str(i))) for i in range(CAPTURES)]
    search = SimpleNamespace(
        problem=SimpleNamespace(captures=captures, floors_of=lambda groups: {"field": REPEATS}),
        _hides_plates=lambda *twins: False,
    )
    return Search._candidate(search, base, "vignetting", twin), base


def named(effect, fall_off):
    """Return the share of patterns beside which a vignetting is missing."""
    tried = [candidate_beside(effect, k, fall_off) for k in range(100)]
    return np.mean([is_missing(candidate, base.excess, LITTLE) for candidate, base in tried])


def test_what_follows_a_pattern_by_chance_is_no_effect_however_many_captures_show_it():
    """Fails if captures count one by one: most patterns of columns then look like a fall-off to all of them."""
    gains = [candidate_beside("fixed_pattern_noise", k, 0.0)[0].gain for k in range(100)]
    assert np.median(gains) > LEAST
    assert named("fixed_pattern_noise", 0.0) <= 0.05


def test_a_clear_effect_is_found_beside_a_pattern():
    """Fails if a pattern takes all that captures say."""
    assert named("fixed_pattern_noise", 3.0) >= 0.95


def test_where_nothing_is_the_same_in_all_captures_each_of_them_tells():
    """Fails if the gains of all twins are divided."""
    candidate, _ = candidate_beside("sensor_noise", 1, 0.0)
    assert candidate.certain_gain == pytest.approx(candidate.gain)
