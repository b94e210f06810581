"""Verdicts on rigs of markers that are no square codes: drawn by OpenCV's warps."""

import numpy as np
import pytest

from gap.select.select_effects import verdict
from marker_photographs import STATIONS, write_marker_campaign
from trials.observe_trial import observe_camera, observed_cases


def test_a_lens_is_named_before_a_rig_of_rings_and_discs(tmp_path):
    """Fails if plates with discs are not found or not measured, or their rings ask for a name."""
    campaign = write_marker_campaign(tmp_path / "campaign", ["STAG_HD21"], STATIONS[::2], k1=-0.05)
    observe_camera(campaign, "cam", tmp_path / "observed" / "cam")
    (case,) = observed_cases(tmp_path / "observed")
    assert sum(c.observation.measured.sum() for c in case.captures) > 40
    _, base, _, outcome = verdict(case, candidates=["radial_distortion", "lens_blur", "marker_scale"])
    assert [step.effect for step in outcome.steps] == ["radial_distortion"]
    assert abs(dict(outcome.twin.effects)["radial_distortion"]["k1"] + 0.05) < 0.01
    assert base.gap > 1.5 > outcome.twin.gap


@pytest.mark.parametrize(
    "families", [["tagStandard41h12"], ["CHARUCO_5X4_75_DICT_4X4_50", "CIRCLES_3X5_60"]], ids=" ".join
)
def test_plates_are_measured_where_trackers_report_another_square_than_that_of_the_cells(families, tmp_path):
    """Fails if the corners that a tracker reports pass for those of all cells: plates are looked for off their place, unseen."""
    campaign = write_marker_campaign(tmp_path / "campaign", families, STATIONS[-1:])
    observe_camera(campaign, "cam", tmp_path / "observed" / "cam")
    (case,) = observed_cases(tmp_path / "observed")
    for capture in case.captures:
        assert capture.observation.measured.all()
        off = capture.observation.corners - case.corners_of(capture, [], np.zeros(6))
        assert np.abs(off - np.median(off, axis=(0, 1))).max() < 1.5  # the pose is off, plates are not
