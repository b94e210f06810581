"""How well stations are known, from campaign.yaml to the verdict."""

import numpy as np
from cases import generated_case

from gap.climb import climb, verdict_of
from gap.diagnose import Diagnosis
from generator import nominal


def test_a_tolerance_of_zero_leads_to_a_verdict(tmp_path, monkeypatch):
    """Fails if a pose is weighed by 1 / 0: gaps and standard errors would be no numbers, and nothing would be named."""
    monkeypatch.setattr(nominal, "TOLERANCE_POSITION_M", 0)
    monkeypatch.setattr(nominal, "TOLERANCE_ANGLE_DEG", 0)
    case, _ = generated_case(tmp_path, "single", "focal_length")
    diagnosis = Diagnosis(case, ["focal_length", "camera_pose_offset"])
    diagnosis.set_base([])
    steps, _ = climb(diagnosis, [diagnosis.try_effect(e) for e in diagnosis.candidates])
    assert [s.effect for s in steps] == ["focal_length"]
    numbers = [diagnosis.base_gap, diagnosis.base_gap_se, *diagnosis.floors.values()]
    numbers += [error for s in steps for error in s.errors.values()]
    assert np.isfinite(numbers).all()
    assert np.abs(diagnosis.poses).max() < 1e-6
    assert verdict_of(steps, diagnosis.base_gap, diagnosis.base_gap_se) == "explained"
