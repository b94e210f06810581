"""How names of whole cameras are counted: tests/bench/bench_whole_cameras.py."""

import pytest

from bench_whole_cameras import counts_of, groups_of
from gap.select.outcome import Step

HIDDEN = ["defocus", "exposure", "sensor_noise"]


@pytest.mark.parametrize(
    ("groups", "counts"),
    [
        ([("defocus",), ("exposure",), ("vignetting",)], (2, 1, 0)),
        ([("lens_blur", "defocus"), ("tone_curve", "vignetting")], (1, 1, 2)),
        ([("motion_blur", "lens_blur", "field_curvature", "defocus")], (0, 0, 1)),
        ([], (0, 0, 0)),
    ],
    ids=["alone", "in groups", "in a group that tells nothing", "nothing named"],
)
def test_names_are_counted(groups, counts):
    """Fails if a hidden effect in a small group is not counted, one in a large group is, or a group without any is not wrong."""
    assert counts_of(HIDDEN, groups) == counts


def test_a_group_is_what_would_do_as_well_in_the_last_twin():
    """Fails if what was hardly worse in an earlier twin counts as a name: a hidden effect among it would pass for found."""
    steps = [
        Step("lens_blur", None, (), ("defocus", "motion_blur"), "edges", ("lens_blur", "defocus")),
        Step("sensor_noise", None, (), ("fixed_pattern_noise",), "noise"),
    ]
    assert groups_of(steps) == [("lens_blur", "defocus"), ("sensor_noise",)]
