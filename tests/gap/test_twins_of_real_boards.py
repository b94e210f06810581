"""The twins that docs/real-photographs.md compares with photographs are those of the effects that were named."""

import numpy as np
import pytest
from drawn_board import board_case, light_of, photograph

from bench_real_boards import closest_twin

SHOWN = {
    "lens_blur": {"sigma_px": 2.0},
    "ink_spread": {"spread_m": 0.001},
    "sharpening": {"amount": 1.0, "radius_px": 1.0},
}


def twin_with(case, effects):
    """Return the twin (H, W, 3) of a case's first photograph with effects, in that photograph's light."""
    return closest_twin(case, case.captures[0], effects)(light_of(0))


@pytest.mark.parametrize("effects", [[e] for e in SHOWN] + [list(SHOWN)])
def test_a_twin_shows_what_was_named(effects):
    """Fails if an effect is left out that acts where the board is drawn, as blur and ink do."""
    case, named = board_case(1), [(e, SHOWN[e]) for e in effects]
    twin = twin_with(case, named)
    np.testing.assert_allclose(twin, photograph(case, 0, named, noise_dn=0.0), atol=0.51)  # photographs are rounded
    assert np.abs(twin - twin_with(case, [])).mean() > 0.5


def test_colours_part_in_a_twin():
    """Fails if the three colours of a twin whose lens parts them are drawn as one."""
    case = board_case(1)
    parted = twin_with(case, [("lateral_chromatic_aberration", {"red_ratio": 1.01, "blue_ratio": 0.99})])
    red, green, blue = np.abs(parted - twin_with(case, [])).mean((0, 1))
    assert red > 1 and blue > 1 and green < 0.1
