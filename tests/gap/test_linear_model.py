"""What effects would explain together, to first order."""

from types import SimpleNamespace

import numpy as np
import pytest

from gap.bounds import MAX_SIMPLE, MIN_GAIN
from gap.fit.evidence import start_step, step_over_rounding
from gap.fit.parameters import spec
from gap.select import linear_model
from gap.select.linear_model import LinearModel, Way, _rivals, _simpler, exchanges, missing_noise, selected

H, G = np.array([[4.0, 2.0, 0.0], [2.0, 4.0, 0.0], [0.0, 0.0, 1.0]]), np.array([8.0, 8.0, -3.0])


def test_what_two_columns_share_is_gained_once():
    """Fails if the gain of two effects is the sum of what each would gain alone."""
    model = LinearModel(H, G, np.full(3, -np.inf), np.full(3, np.inf), own=())
    assert model.gain([0]) == pytest.approx(16, rel=1e-5)
    assert model.gain([0, 1]) == pytest.approx(64 / 3, rel=1e-5)


def test_a_step_that_its_bounds_forbid_gains_nothing():
    """Fails if a blur of less than nothing counts as a gain."""
    free, bounded = (
        LinearModel(H, G, np.array([-np.inf, -np.inf, low]), np.full(3, np.inf), ()) for low in (-np.inf, 0.0)
    )
    assert free.gain([0, 1, 2]) == pytest.approx(64 / 3 + 9, rel=1e-5)
    assert bounded.gain([0, 1, 2]) == bounded.gain([0, 1])


def test_a_gain_is_counted_beside_what_the_twin_has_already():
    """Fails if the twin's own parameters do not go along."""
    model = LinearModel(H, G, np.full(3, -np.inf), np.full(3, np.inf), own=(0,))
    assert model.gain([1]) - model.gain([]) == pytest.approx(64 / 3 - 16, rel=1e-5)


CURVE, EXPOSURE, BLUR = (
    Way("tone_curve", (), None, tuple(range(8))),
    Way("exposure", (), None, (8,)),
    Way("lens_blur", (), None, (9,)),
)


@pytest.mark.parametrize(("gain", "chosen"), [(8.0, 1), (6.0, 0)], ids=["mimics", "is no match"])
def test_a_curve_gives_way_to_what_explains_nearly_as_much(gain, chosen):
    """Fails if a curve of many knots is proposed where one number does, a blur that is no curve takes its place, or anything."""
    assert len(CURVE.columns) > MAX_SIMPLE
    assert _simpler([CURVE, EXPOSURE, BLUR], [10.0, gain, 9.9], 0) == chosen


def test_rivals_are_what_adds_nearly_as_much_in_an_effects_place():
    """Fails if what is small beside the others, what affects something else, or an effect itself is a rival."""
    ways = [Way(n, (), None, (k,)) for k, n in enumerate(["exposure", "vignetting", "veiling_glare", "lens_blur"])]
    model = LinearModel(np.eye(4), np.array([4.0, 3.9, 2.0, 4.0]), np.full(4, -np.inf), np.full(4, np.inf), ())
    assert _rivals(model, ways[0], ways[:1], ways[1:]) == ["vignetting"]


@pytest.mark.parametrize(
    ("share_of_first", "names"), [(0.0, ["sharpening", "denoising", "lens_blur"]), (0.5, ["sharpening", "denoising"])]
)
def test_a_later_round_proposes_what_leads(monkeypatch, share_of_first, names):
    """Fails if what is small beside a leading effect comes along in a later round, or in the first one stays behind."""
    ways = [Way(n, (), None, (k,)) for k, n in enumerate(["sharpening", "denoising", "lens_blur"])]
    model = LinearModel(np.eye(3), np.array([40.0, 30.0, 20.0]), np.full(3, -np.inf), np.full(3, np.inf), ())
    monkeypatch.setattr(linear_model, "_first_guess", lambda *_: {})
    monkeypatch.setattr(linear_model, "probes", lambda train: train)
    search = SimpleNamespace(train=[0], problem=SimpleNamespace(shows=lambda name: {}))
    twin = SimpleNamespace(names=[], excess={})
    assert selected(search, twin, ways, model, share_of_first=share_of_first).names == names


@pytest.mark.parametrize(
    ("first", "has", "shown", "off", "names"),
    [
        ("denoising", [], "", 2.0, ["denoising", "sensor_noise"]),
        ("denoising", [], "", 0.9, ["denoising"]),
        ("exposure", [], "", 2.0, ["exposure"]),
        ("sharpening", [], "", 2.0, ["sharpening"]),
        ("denoising", ["sensor_noise"], "", 2.0, ["denoising"]),
        ("jpeg_compression", [], "jpeg_compression", 2.0, ["jpeg_compression"]),
    ],
    ids=["hidden", "as it is", "not filtered", "amplified", "there", "a codec that captures show"],
)
def test_noise_comes_with_what_smooths_it(monkeypatch, first, has, shown, off, names):
    """Fails if a filter takes the place of the noise that it hides, noise is fitted where nothing hides it, or counts."""
    ways = [
        Way(n, (), None, (k,)) for k, n in enumerate([first, "sensor_noise", "fixed_pattern_noise"]) if n not in has
    ]
    model = LinearModel(np.eye(3), np.array([40.0, 2.0, 1.0]), np.full(3, -np.inf), np.full(3, np.inf), ())
    monkeypatch.setattr(linear_model, "_first_guess", lambda *_: {})
    monkeypatch.setattr(linear_model, "probes", lambda train: train)
    search = SimpleNamespace(train=[0], problem=SimpleNamespace(shows=lambda name: name == shown))
    found = selected(search, SimpleNamespace(names=has, excess={"noise": off * MIN_GAIN}), ways, model)
    assert found.names == names and found.along == tuple(names[1:])
    assert (found.alone or found).names == names[:1]
    assert found.rivals.get("sensor_noise", ["fixed_pattern_noise"]) == ["fixed_pattern_noise"]


@pytest.mark.parametrize(
    ("has", "off", "names"),
    [([], 2.0, ["fixed_pattern_noise"]), ([], 0.9, []), (["sensor_noise"], 2.0, [])],
    ids=["missing", "as it is", "there"],
)
def test_noise_that_is_missing_is_known_by_itself(monkeypatch, has, off, names):
    """Fails if noise stays missing beside larger things, if the less likely one is proposed, or any where none is missing."""
    noises = ["sensor_noise", "fixed_pattern_noise", "exposure"]
    ways = [Way(n, (), None, (k,)) for k, n in enumerate(noises) if n not in has]
    model = LinearModel(np.eye(3), np.array([1.0, 2.0, 40.0]), np.full(3, -np.inf), np.full(3, np.inf), ())
    monkeypatch.setattr(linear_model, "_first_guess", lambda *_: {})
    found = missing_noise(None, SimpleNamespace(names=has, excess={"noise": off * MIN_GAIN}), ways, model)
    assert found.names == names and found.rivals == {n: ["sensor_noise"] for n in names} and not found.along


def own_and_others(H, g, own=("exposure", "scale"), others=("veiling_glare", "vignetting")):
    """Return (search, twin, names, ways, model): an effect that a twin has, beside what ``H`` and ``g`` tell of two others."""
    ways = [Way(n, (), None, (k,)) for k, n in enumerate(others)]
    model = LinearModel(np.array(H), np.array(g), np.full(3, -np.inf), np.full(3, np.inf), [2])
    search = SimpleNamespace(
        free=lambda effects: [own for _ in effects],
        is_fixed=lambda _: False,
        problem=SimpleNamespace(shows=lambda _: {}),
    )
    return (
        search,
        SimpleNamespace(effects=((own[0], {own[1]: 1.5}),), names=[own[0]]),
        [own[0]],
        ways,
        model,
    )


@pytest.mark.parametrize(("alike", "found"), [(0.8, {"exposure": ["veiling_glare"]}), (0.6, {})])
def test_what_does_as_much_in_an_effects_place_is_asked_once_more(alike, found):
    """Fails if an effect keeps its name unasked where another moves what it moves, or if all others are asked."""
    H = [[100.0, 0, 100 * alike], [0, 100.0, 10], [100 * alike, 10, 100.0]]
    assert exchanges(*own_and_others(H, [0.0, 0, 0])) == found


def test_one_noise_is_held_against_another_in_any_case():
    """Fails if a fixed pattern keeps a noise's name unasked where a codec lets derivatives tell little of either."""
    H = [[100.0, 0, 10], [0, 100.0, 10], [10, 10, 100.0]]
    noises = own_and_others(H, [0.0, 0, 0], ("fixed_pattern_noise", "prnu"), ("sensor_noise", "exposure"))
    assert exchanges(*noises) == {"fixed_pattern_noise": ["sensor_noise"]}


def test_taking_an_effect_out_costs_what_its_own_steps_tell():
    """Fails if the loss of going back, or what the others then gain, is not that of the quadratic."""
    H, g = np.array([[4.0, 1.0], [1.0, 9.0]]), np.array([0.5, -0.3])
    model = LinearModel(H, g, np.full(2, -np.inf), np.full(2, np.inf), [0, 1])
    rest, cost = model.without([0], [-2.0])
    after = g - H @ [-2.0, 0]
    exact = g @ np.linalg.solve(H, g) - (2 * g[0] * -2 - 4 * H[0, 0] + after[1] ** 2 / H[1, 1])
    assert cost == pytest.approx(exact, rel=1e-4) and rest.own == [1]


@pytest.mark.parametrize(
    ("parameter", "step"), [(("vignetting", "a2"), 4.0), (("denoising", "median_share"), None)], ids=["long", "bounded"]
)
def test_beside_a_codec_a_step_goes_over_its_own(parameter, step):
    """Fails if a step is as short as elsewhere, which a codec rounds to nothing, or leaves the bounds."""
    null = spec(parameter).null
    longer = step_over_rounding(parameter, null)
    if step:
        assert longer == pytest.approx(step * start_step(parameter, null))
    assert spec(parameter).lower <= null + longer <= spec(parameter).upper and longer != 0
