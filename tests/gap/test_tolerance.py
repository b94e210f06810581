"""How well stations are known, from campaign.yaml to the verdict."""

from dataclasses import replace

import numpy as np
from cases import generated_case

from gap.select.select_effects import verdict
from generator import nominal


def test_a_tolerance_of_zero_leads_to_a_verdict(tmp_path, monkeypatch):
    """Fails if a pose is weighed by 1 / 0: gaps and standard errors would be no numbers, and nothing would be named."""
    exact = replace(nominal.RIGS["small"], tolerance_position_m=0, tolerance_angle_deg=0)
    monkeypatch.setitem(nominal.RIGS, "small", exact)
    case, _ = generated_case(tmp_path, "single", "focal_length")
    _, _, _, outcome = verdict(case, candidates=["focal_length", "camera_pose_offset"])
    assert [s.effect for s in outcome.steps] == ["focal_length"]
    twin = outcome.twin
    assert np.isfinite([twin.gap, twin.gap_se, *twin.floors.values(), *twin.errors.values()]).all()
    assert np.abs(twin.poses).max() < 1e-6
    assert outcome.verdict == "explained"
