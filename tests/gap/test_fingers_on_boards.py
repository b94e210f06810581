"""Photographs of a board with a finger over its border: corners beside it lie off, which neither names a lens nor hides one."""

import numpy as np
import pytest
from test_changes import POINTS, RIGID, photographs

from gap.select.select_effects import verdict

REACH_M = 0.05  # of a finger's tip over the board, about an outer corner
OFF_PX = (6.0, 4.0)  # to where its edge crosses a square's


def touched(case, every=3):
    """Return a BoardCase in which, of every so many photographs, one shows the corners near an outer one off by OFF_PX."""
    under = np.linalg.norm(POINTS - POINTS[0], axis=1) < REACH_M
    for capture in case.captures[::every]:
        capture.observation.features[under] += OFF_PX
    return case


@pytest.mark.parametrize(
    ("k1", "named", "expected"), [(0.0, [], "adequate"), (-0.1, ["radial_distortion"], "explained")]
)
def test_corners_beside_a_finger_change_no_name(k1, named, expected):
    """Fails if residuals count by their squares: a few corners that are far off then outweigh the lens of all photographs."""
    for case in (photographs(1, 10, k1=k1), touched(photographs(1, 10, k1=k1))):
        _, _, _, outcome = verdict(case, candidates=RIGID)
        assert ([step.effect for step in outcome.steps], outcome.verdict) == (named, expected)
