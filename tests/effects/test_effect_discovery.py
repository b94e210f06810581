"""An effect is added by adding one file; a file that breaks the contract is named in one message."""

import sys

import numpy as np
import pytest
from effect_views import view

import effects
from effects import library, pipeline
from inputs.twins import load_twin
from rig.errors import InputError

THIRTIETH = '''"""Haze: a constant light is added. Source: test."""

from effects.base import Parameter

STAGE, ORDER = "lens", 160
AFFECTS = "intensity"
PARAMETERS = {"light": Parameter(unit="1", lower=0.0, upper=1.0, null=0.0, matters=0.01, doc="added radiance")}
STARTS = ({"light": 0.1},)


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
    library.available_effects.cache_clear()
    yield place
    library.available_effects.cache_clear()
    for file in place.glob("*.py"):
        sys.modules.pop(f"effects.{file.stem}", None)


def test_a_thirtieth_effect_takes_part(folder, tmp_path):
    """Found, applied in its place, known to twins: nothing else is edited."""
    (folder / "haze_for_test.py").write_text(THIRTIETH)
    assert "haze_for_test" in library.available_effects()
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
        ("no_function", ("def apply", "def add_light"), "needs map_points or apply"),
        ("bad_parameter", ("Parameter(unit=", "dict(unit="), "no effects.base"),
        ("bad_start", ('"light": 0.1', '"light": 7.0'), "STARTS: light is 7.0; it must lie in"),
        ("bad_name_in_start", ('"light": 0.1', '"glow": 0.1'), "STARTS: no parameter 'glow'; there are light"),
        ("bad_starts", ('({"light": 0.1},)', '{"light": 0.1}'), "a tuple of at least one dict"),
        (
            "bad_own",
            ("STARTS =", 'OWN_WHERE_OPEN = {"shutter": ("light",)}\nSTARTS ='),
            "of what a campaign may leave open: light, exposure",
        ),
        (
            "bad_name_in_own",
            ("STARTS =", 'OWN_WHERE_OPEN = {"exposure": ("glow",)}\nSTARTS ='),
            "OWN_WHERE_OPEN: no parameter 'glow'; there are light",
        ),
        ("bad_null", ("lower=0.0", "lower=0.5"), "null is 0.0; it must lie in"),
        ("bad_order", ("160", "'last'"), "ORDER is 'last'"),
        ("orders", ("160", "(160, 170)"), "a discrete auxiliary parameter 'place', 0 to 1, is needed"),
        ("bad_affects", ('"intensity"', '"light"'), "AFFECTS is 'light'; allowed: geometry, point_spread, intensity"),
        ("false_affects", ('"intensity"', '"geometry"'), "AFFECTS is 'geometry', but it has apply"),
        ("misspelt_apply", ("def apply", "def aply"), "aply: the contract has no such name; apply is meant"),
        ("misspelt_map", ("def apply", "def map_point(xy): ...\n\n\ndef apply"), "map_point: .* map_points is meant"),
        (
            "misspelt_kernel",
            ("def apply", "def noise_kernal(p): ...\n\n\ndef apply"),
            "noise_kernal: .* noise_kernel is meant",
        ),
        ("misspelt_starts", ("STARTS", "STRATS"), "STRATS: .* STARTS is meant"),
        ("misspelt_affects", ("AFFECTS", "AFECTS"), "AFECTS: .* AFFECTS is meant"),
        (
            "few_parameters",
            ("(image, view, p, rng)", "(image, p)"),
            r"apply\(image, p\): the contract has apply\(image,",
        ),
        ("swapped", ("(image, view, p, rng)", "(view, image, p, rng)"), r"apply\(view, image, p, rng\): the contract"),
        ("no_hook", ("def apply", "spread = 1.0\n\n\ndef apply"), "spread is 1.0; a function is needed"),
        ("bad_words", ('"""Haze: a constant light is added. Source: test."""', ""), "docstring"),
    ],
)
def test_a_bad_file_is_named(folder, name, change, message):
    """Snakemake would else end in a traceback from somewhere in a fit."""
    assert change[0] in THIRTIETH
    (folder / f"{name}.py").write_text(THIRTIETH.replace(*change))
    with pytest.raises(InputError, match=message) as caught:
        library.available_effects()
    assert f"{name}.py" in str(caught.value)


def test_helpers_with_names_of_their_own_are_allowed(folder):
    """Fails if any function, or any constant beside the contract's, were taken for a misspelt hook."""
    helper = "HAZE_M = 3.0\n\n\ndef spread_px(x):\n    return x\n\n\ndef apply"
    (folder / "haze_for_test.py").write_text(THIRTIETH.replace("def apply", helper))
    assert "haze_for_test" in library.available_effects()


def test_a_start_names_what_is_not_at_its_null(folder):
    """Fails if a start lacked parameters, or an effect without starts began elsewhere than at its null."""
    second = 'STARTS = ({"light": 0.1}, {})'
    (folder / "haze_for_test.py").write_text(THIRTIETH.replace('STARTS = ({"light": 0.1},)', second))
    assert library.starts_of("haze_for_test") == [{"light": 0.1}, {"light": 0.0}]
    assert library.starts_of("exposure") == [{"scale": 1.0}]


def twin_of(tmp_path, text):
    """Load a twin from text."""
    path = tmp_path / "cam.yaml"
    path.write_text(text)
    return load_twin(path)


CURVE = "effects:\n  - effect: tone_curve\n    parameters: {lift_at_50_pct_dn: 9, place: 1.5}\n"
ENTRY = "effects:\n  - effect: lens_blur\n    parameters: {sigma_px: 0.8}\n"


@pytest.mark.parametrize(
    ("text", "message"),
    [
        (ENTRY.replace("lens_blur", "lens_blurr"), "unknown effect 'lens_blurr'"),
        (ENTRY.replace("lens_blur", "{a: 1}"), "unknown effect {'a': 1}"),
        (ENTRY.replace("0.8", "80"), "sigma_px is 80 px; allowed are 0 to 8"),
        (ENTRY.replace("sigma_px", "sigma_mm"), "no parameter 'sigma_mm'; it has sigma_px"),
        (ENTRY.replace("0.8", "0.8 mm"), "is '0.8 mm'; a number in px"),
        (ENTRY.replace("0.8", ".nan"), "a number in px"),
        (ENTRY.replace("0.8", "9" * 400), "a number in px"),
        (CURVE, "tone_curve.place is 1.5; a whole number is needed"),
        (CURVE.replace("1.5", "fit"), "tone_curve.place is 'fit'; a whole number is needed"),
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
    assert dict(twin.effects) == {
        "lens_blur": {"sigma_px": 0.8, "softness": 1.0},
        "vignetting": {"a2": 0.1, "a4": 0.0, "a6": 0.0},
    }
