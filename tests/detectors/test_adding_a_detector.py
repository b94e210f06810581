"""The worked example of docs/detectors.md does what the page says."""

import re
import sys
from pathlib import Path

import numpy as np
import pytest

import detectors
from bench.marker_scenes import compare, scene
from detectors import contract
from rig.errors import InputError

PAGE = Path(__file__).resolve().parents[2] / "docs" / "detectors.md"


def test_the_page_s_example_is_found_checked_and_finds_markers(tmp_path, monkeypatch):
    """A change of the contract that breaks what users copied from the page would go unseen without this."""
    (example,) = re.findall(r"```python\n(.*?)```", PAGE.read_text(), re.DOTALL)
    (tmp_path / "smoothed.py").write_text(example)
    monkeypatch.setattr(contract, "__file__", str(tmp_path / "contract.py"))
    monkeypatch.setattr(detectors, "__path__", [*detectors.__path__, str(tmp_path)])
    try:
        assert contract.available() == ["smoothed"]
        with pytest.raises(InputError, match="smoothing_px"):
            contract.make("smoothed", parameters={"smooth": 1.0})
        with pytest.raises(InputError, match="positive"):
            contract.make("smoothed", parameters={"smoothing_px": 0})
        image, truth = scene(np.random.default_rng(0), 640, 480, 4, (60, 70), (0, 20), noise_dn=15)
        _, found, _ = compare(truth, contract.make("smoothed").detect(image))
        assert found.all()
    finally:
        sys.modules.pop("detectors.smoothed", None)


def test_every_parameter_says_what_it_trades():
    """Settings without a word on their cost cannot be set with reason."""
    folder = PAGE.parents[1] / "scripts" / "detectors"
    for file in [*folder.glob("*.py"), folder / "bart/__init__.py", folder / "bart/tracker.py"]:
        for block in re.findall(r"^(?:TRACKER_)?PARAMETERS = \{\n(.*?)^\}", file.read_text(), re.DOTALL | re.MULTILINE):
            lines = block.splitlines()
            for k, line in enumerate(lines):
                if not line.strip().startswith("#"):
                    above = lines[k - 1].strip() if k else ""
                    assert above.startswith("#") or "rad_s2" in line, f"{file}: {line.strip()}"
