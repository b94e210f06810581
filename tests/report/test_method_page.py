"""docs/method.md says what the code does: its bounds are the code's, its pictures are drawn from results by one command."""

import importlib
import json
import re
from pathlib import Path

import numpy as np
import pandas as pd
import pytest

from gap import bounds

ROOT = Path(__file__).resolve().parents[2]
PAGE = (ROOT / "docs/method.md").read_text(encoding="utf-8")
BOUNDS = dict(re.findall(r"^\| `([A-Z_]+)` \| ([\d.]+) \|", PAGE, re.M))
LARGEST_BYTES = 60_000


@pytest.fixture
def pictures(monkeypatch):
    """Return the module that draws them."""
    monkeypatch.syspath_prepend(ROOT / "notebooks")
    return importlib.import_module("method_pictures")


def test_bounds_of_the_page_are_those_of_the_code():
    """Fails if a bound is changed or added and the page still says what was, or a row names what is no longer there."""
    assert {name: float(value) for name, value in BOUNDS.items()} == {
        n: v for n, v in vars(bounds).items() if n.isupper()
    }
    assert len(BOUNDS) == 19 and "Nineteen numbers decide a name or a verdict" in PAGE


def test_bounds_that_are_only_named_are_in_the_code():
    """Fails if the page speaks of a constant that was renamed."""
    sources = "".join(p.read_text() for p in (ROOT / "scripts").rglob("*.py"))
    for name in set(re.findall(r"`([A-Z][A-Z_]+)`", PAGE)):
        assert re.search(rf"^(\w+, |\()?\s*{name}\b[^\n]*(=|,$)", sources, re.M), name


def test_one_command_draws_all_pictures_of_the_page(pictures):
    """Fails if a picture is shown that no code draws, drawn and not shown, or too large for a page."""
    shown = re.findall(r"\]\(method/(\w+)\.png\)\\\n\*`make picture`", PAGE)
    assert sorted(shown) == sorted(pictures.PICTURES)
    assert "notebooks/method_pictures.py results/frame hp325 docs/method\n" in (ROOT / "Makefile").read_text()
    for name in shown:
        assert (ROOT / f"docs/method/{name}.png").stat().st_size <= LARGEST_BYTES


def result_of(camera, gains):
    """Return a verdict's result file, and a free warp's step beside an effect's."""
    parameters = {
        "k1": {"value": -0.1, "se": 0.001},
        "k2": {"value": 0.0, "se": 0.01},
        "k3": {"value": 0.0, "se": None},
    }
    waves = {f"dx_0_{k}": {"value": 1.0, "se": 0.1} for k in range(3)}
    candidate = {"gain_se": 10.0, "parameters": {"k1": 0.1}}
    return {
        "camera": camera, "verdict": "explained", "groups": {"corners": 1.0, "levels": 1.2},
        "steps": [{"effect": "radial_distortion", "parameters": parameters}, {"effect": "local_warp", "parameters": waves}],
        "candidates": [candidate | {"effect": f"effect_{k}", "gain": gain} for k, gain in enumerate(gains)],
        "where": [{"observable": "ground", "covariate": "image_radius", "share": 0.9}],
    }  # fmt: skip


@pytest.fixture
def results(tmp_path):
    """Return the folder of a run's diagnoses: two cameras, one of which found no candidate that gains."""
    for camera, gains in (("cam", [1000.0, 30.0, 0.0, -5.0]), ("other", [0.0])):
        folder = tmp_path / "diagnosis" / camera
        folder.mkdir(parents=True)
        (tmp_path / f"diagnosis/{camera}.json").write_text(json.dumps(result_of(camera, gains)))
        gap = {"step": [0, 1, 2], "gap": [5.0, 2.0, 1.0], "gap_low": [4.0, 1.5, 0.9], "gap_high": [6.0, 2.5, 1.1]}
        pd.DataFrame(gap).to_csv(folder / "ladder.csv", index=False)
        radius = np.tile(np.linspace(0, 1, 40), 2)
        plates = pd.DataFrame({"image_radius": radius, "ground": -10 * radius, "fitted": np.arange(80) % 2 == 0})
        plates.assign(twin=np.repeat(["configured", "explained"], 40)).to_parquet(folder / "plates.parquet")
    return tmp_path


def test_certainty_and_size_are_told_of_parameters_that_were_fitted(pictures, results):
    """Fails if a warp's waves are told one by one, a parameter without an error at all, or the two are exchanged."""
    table = pictures.named_parameters(pictures.read_verdicts(results)).query("camera == 'cam'").set_index("parameter")
    assert list(table.index) == ["k1", "k2"]
    matters = pictures.library.parameters_of("radial_distortion")["k1"].matters
    assert table.evidence["k1"] == pytest.approx(100) and table["size"]["k1"] == pytest.approx(0.1 / matters)


def test_pictures_are_drawn_of_any_cameras(pictures, results, monkeypatch):
    """Fails if a camera is left out, one without candidates ends the drawing, or fitted plates are shown as held out."""
    monkeypatch.setattr(pictures, "whitened", lambda *_: {twin: np.linspace(-3, 3, 50) for twin in pictures.TWINS})
    drawn = {name: draw(results, "cam") for name, draw in pictures.PICTURES.items()}
    assert [axis.get_title(loc="left") for axis in drawn["effect_size"].axes] == ["cam", "other"]
    assert len(drawn["effect_size"].axes[0].get_yticks()) == 2
    told = [text.get_text() for text in drawn["verdict"].axes[0].get_legend().get_texts()]
    assert told == ["cam: explained", "other: explained"]
    shown = drawn["where"].axes[0].collections[0].get_offsets()
    assert len(shown) == 20 and drawn["where"].axes[0].get_title(loc="left").endswith("90 % predicted")
