"""An effect is added by adding one file; a file that breaks the contract is named in one message."""

import numpy as np
import pytest
from effect_views import view

import effects
from effects import pipeline
from rig.errors import InputError
from rig.twins import load_twin

THIRTIETH = '''"""Haze: a constant light is added. Source: test."""

from effects.base import Parameter

STAGE, ORDER = "lens", 160
PARAMETERS = {"light": Parameter("1", 0.0, 1.0, 0.0, (0.1,), 0.01, "added radiance")}


def apply(image, view, p, rng):
    """Add light."""
    return image + p["light"]
'''


@pytest.fixture
def folder(tmp_path, monkeypatch):
    """Return a second folder of effects, looked into as the first is."""
    place = tmp_path / "more_effects"
    place.mkdir()
    monkeypatch.setattr(effects, "__path__", [*effects.__path__, str(place)])
    pipeline.available_effects.cache_clear()
    yield place
    pipeline.available_effects.cache_clear()


def test_a_thirtieth_effect_takes_part(folder, tmp_path):
    """Found, applied in its place, known to twins: nothing else is edited."""
    (folder / "haze_for_test.py").write_text(THIRTIETH)
    assert "haze_for_test" in pipeline.available_effects()
    v = view(encoding="linear")
    radiance = np.full((v.height + 2 * v.margin, v.width + 2 * v.margin), 0.2)
    image = pipeline.form_image(radiance, v, [("haze_for_test", {"light": 0.3})], None)
    np.testing.assert_allclose(image, 127.5, atol=1e-3)
    twin = tmp_path / "cam.yaml"
    twin.write_text("effects:\n  - effect: haze_for_test\n    parameters: {light: 0.3}\n")
    assert load_twin(twin).effects == [("haze_for_test", {"light": 0.3})]


@pytest.mark.parametrize(
    ("name", "change", "message"),
    [
        ("bad_import", ("from effects.base", "from effects.nowhere"), "does not import: ModuleNotFoundError"),
        ("bad_syntax", ("def apply(", "def apply["), "does not import: SyntaxError"),
        ("bad_stage", ('"lens"', '"mirror"'), "STAGE is 'mirror'; allowed: scene, lens"),
        ("bad_function", ("def apply", "def aply"), "needs map_points or apply"),
        ("bad_parameter", ('Parameter("1", 0.0, 1.0, 0.0, (0.1,), 0.01, "added radiance")', "0.3"), "no effects.base"),
        ("bad_start", ("(0.1,)", "(7.0,)"), "null and starts must lie in"),
        ("bad_null", ("0.0, 1.0, 0.0", "0.5, 1.0, 0.0"), "null and starts must lie in"),
        ("bad_order", ("160", "'last'"), "ORDER is 'last'"),
        ("bad_words", ('"""Haze: a constant light is added. Source: test."""', ""), "docstring"),
    ],
)
def test_a_bad_file_is_named(folder, name, change, message):
    """Snakemake would else end in a traceback from somewhere in a fit."""
    assert change[0] in THIRTIETH
    (folder / f"{name}.py").write_text(THIRTIETH.replace(*change))
    with pytest.raises(InputError, match=message) as caught:
        pipeline.available_effects()
    assert f"{name}.py" in str(caught.value)


def twin_of(tmp_path, text):
    """Load a twin from text."""
    path = tmp_path / "cam.yaml"
    path.write_text(text)
    return load_twin(path)


ENTRY = "effects:\n  - effect: lens_blur\n    parameters: {sigma_px: 0.8}\n"


@pytest.mark.parametrize(
    ("text", "message"),
    [
        (ENTRY.replace("lens_blur", "lens_blurr"), "unknown effect 'lens_blurr'"),
        (ENTRY.replace("0.8", "80"), "sigma_px is 80 px; allowed are 0 to 8"),
        (ENTRY.replace("sigma_px", "sigma_mm"), "no parameter 'sigma_mm'; it has sigma_px"),
        (ENTRY.replace("0.8", "0.8 mm"), "is '0.8 mm'; a number in px"),
        (ENTRY.replace("0.8", ".nan"), "a number in px"),
        (ENTRY.replace("0.8", "true"), "a number in px"),
        (ENTRY + "  - effect: lens_blur\n", "stands twice"),
        (ENTRY.replace("0.8", "!!python/object/apply:os.system [ls]"), "constructor|tag"),
        (ENTRY + "extends: ../nowhere/cam.yaml\n", "no such file"),
        (ENTRY + "extends: cam.yaml\n", "circle"),
        (ENTRY + "effect: lens_blur\n", "unknown key 'effect'"),
        ("effects: lens_blur\n", "a list of entries"),
        ("effects:\n  - lens_blur\n", "a list of entries"),
    ],
)
def test_a_bad_twin_is_refused(tmp_path, text, message):
    """One message that names the file, before any job."""
    with pytest.raises(InputError, match=message) as caught:
        twin_of(tmp_path, text)
    assert "cam.yaml" in str(caught.value)


def test_a_twin_by_hand(tmp_path):
    """Null where nothing is written; `fit` does nothing to images and starts where the effect says."""
    twin = twin_of(tmp_path, "effects:\n  - {effect: motion_blur, parameters: {dx_px: fit, dy_px: 1e-1}}\n")
    assert twin.effects == [("motion_blur", {"dx_px": 0.0, "dy_px": 0.1})]
    assert twin.starts == [("motion_blur", {"dx_px": 2.0, "dy_px": 0.1})]
    assert twin.free == [("motion_blur", "dx_px")]
    assert load_twin(tmp_path / "none.yaml").effects == []


def test_a_twin_that_extends_another(tmp_path):
    """A second campaign with the same camera starts from the first; what it says itself counts."""
    (tmp_path / "first").mkdir()
    first = ENTRY.replace("0.8", "0.5") + "  - {effect: vignetting, parameters: {a2: 0.1}}\n"
    (tmp_path / "first/cam.yaml").write_text(first)
    twin = twin_of(tmp_path, ENTRY + "extends: first/cam.yaml\n")
    assert dict(twin.effects) == {"lens_blur": {"sigma_px": 0.8}, "vignetting": {"a2": 0.1, "a4": 0.0, "a6": 0.0}}
