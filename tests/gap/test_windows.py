"""Windows of a frame show what the whole frame shows, and what is told of their changes is what happens."""

from dataclasses import replace

import numpy as np
import pytest
from cases import generated_case

from effects import library
from gap.pixels.windows import make_atlas
from gap.predict import predictor
from gap.predict.predictor import Kept, Shown

FARTHER = 5.0  # times what matters, where an effect has no start off its null


@pytest.fixture(scope="module")
def case(tmp_path_factory):
    return generated_case(tmp_path_factory.mktemp("windows"), "none", size="tiny")[0]


def clear(name):
    """Return parameters at which an effect is clearly there."""
    nulls = library.nulls_of(name)
    start = next((s for s in library.starts_of(name) if s != nulls), None)
    if start is None:
        moved = {k: min(p.null + FARTHER * p.matters, p.upper) for k, p in library.parameters_of(name).items()}
        start = {k: v if not library.parameters_of(name)[k].is_choice else nulls[k] for k, v in moved.items()}
    return start


def test_windows_lie_on_whole_blocks_and_hold_their_cores():
    """Fails if a codec's blocks would lie otherwise in a window than in the frame, or windows overlapped."""
    cores = np.array([[3, 5, 30, 40], [100, 7, 131, 31], [35, 20, 50, 44], [400, 300, 500, 390]])
    atlas = make_atlas(cores, 4, (640, 480))
    assert (atlas.boxes % 16 == 0).all() and (atlas.places % 16 == 0).all()
    image = np.arange(640 * 480).reshape(480, 640, 1)
    seen = atlas.gather(image)
    for k, (x0, y0, x1, y1) in enumerate(cores):
        np.testing.assert_array_equal(seen[atlas.core(k)], image[y0:y1, x0:x1])


def test_many_windows_lie_close_and_apart():
    """Fails if windows overlap where they are put together, or leave a seventh of the image empty: time goes by its pixels."""
    rng = np.random.default_rng(3)
    corner, size = rng.integers(0, (1800, 1000), (60, 2)), rng.integers(16, 120, (60, 2))
    atlas = make_atlas(np.concatenate([corner, corner + size], axis=1), 4, (1920, 1120))
    held = np.zeros(atlas.shape, int)
    for x0, y0, x1, y1, column, row in np.unique(np.hstack([atlas.boxes, atlas.places]), axis=0):
        held[row : row + y1 - y0, column : column + x1 - x0] += 1
    assert held.max() == 1 and held.mean() > 0.85


AFTER_ONE_ANOTHER = ["lens_blur", "bayer_demosaic", "denoising", "sharpening"]


@pytest.mark.parametrize("names", [*([name] for name in sorted(library.available_effects())), AFTER_ONE_ANOTHER])
def test_windows_show_what_the_frame_shows(case, names):
    """Fails if an effect looked farther than it says (``reach_px``), or several after one another than they do together;
    took a window's place for the frame's, or its light.
    """
    effects, pose, capture = [(name, clear(name)) for name in names], np.zeros(6), case.captures[1]
    shown = Shown(case, capture, effects, pose, False, Kept(9))
    whole = case.image_of(case.radiance_of(capture, effects, pose), capture, effects, pose)
    whole = shown.atlas.gather(whole)
    off = np.concatenate(
        [np.abs(shown.levels - whole)[shown.atlas.core(k)].ravel() for k in range(len(shown.atlas.cores))]
    )
    assert off.mean() < 0.05
    assert np.quantile(off, 0.99) < 0.6


@pytest.mark.parametrize("by_response", [True, False])
def test_a_change_is_what_features_change_by(case, by_response):
    """Fails if features were said to follow the image otherwise than the fit of the plate does, its creeping included."""
    base, more = ([("lens_blur", {"sigma_px": s, "softness": 1.0})] for s in (0.8, 0.83))
    pose, capture = np.zeros(6), case.captures[1]
    shown = Shown(case, capture, base, pose, False, Kept(9))
    told = shown.change(more, by_response)
    before, after = shown.prediction, Shown(case, capture, more, pose, False, Kept(9)).prediction
    both = before.measured & after.measured
    happened = (after.features - before.features)[both]
    size = np.sqrt((happened**2).mean(0))
    off = np.sqrt(((told.features[both] - happened) ** 2).mean(0))
    strong = [13, 14, 16]  # spread along and across, overshoot
    assert (off[strong] < 0.25 * size[strong]).all()


def test_noise_belongs_to_pixels_wherever_windows_lie(case):
    """Fails if a moved window got other noise: a fit's derivative by a pose would be noise."""
    capture, pose = case.captures[0], np.zeros(6)
    a, b = (Shown(case, capture, effects, pose, True, Kept(9)) for effects in ([], [("exposure", {"scale": 1.2})]))
    moved = Shown(case, capture, [("lens_blur", {"sigma_px": 2.5, "softness": 1.0})], pose, True, Kept(9))
    frame_a, frame_b = (s._numbers().standard_normal((*s.atlas.whole_shape, 1)) for s in (a, moved))
    np.testing.assert_array_equal(frame_a[a.atlas.core(0)], frame_b[moved.atlas.core(0)])
    assert b.prediction.noise is not None


def test_what_a_change_draws_is_not_kept(case):
    """Fails if each derivative by a blur keeps its windows: a long search then fills gigabytes."""
    shown = Shown(case, case.captures[1], [], np.zeros(6), False, Kept(9))
    own = list(shown._drawn)
    for sigma_px in (0.8, 0.9):
        shown.change([("lens_blur", {"sigma_px": sigma_px, "softness": 1.0})])
    assert list(shown._drawn) == own


def test_what_is_large_counts_as_several():
    """Fails if as many scenes of a large frame are kept as of a small one, which fills gigabytes, or not even the last, which
    each derivative of a fit needs; if what was asked for lately goes first, or what went still weighs.
    """
    kept = Kept(4, weight_of=len)
    for name in ("a", "bb", "a", "ccc", "dddddd"):
        assert kept.of(name, lambda: name) == name  # noqa: B023
    assert list(kept) == ["dddddd"]
    for name in ("a", "bb", "a"):
        kept.of(name, lambda: name)  # noqa: B023
    assert list(kept) == ["bb", "a"]
    kept.of("e", lambda: "e")
    assert list(kept) == ["bb", "a", "e"]
    kept.of("f", lambda: "f")
    assert list(kept) == ["a", "e", "f"]


def test_noise_is_the_same_when_it_is_drawn_again(case):
    """Fails if noise of a frame that was not kept, or was kept beside others, is another noise; if all frames are kept."""
    pose, few = np.zeros(6), replace(case, normal_numbers=Kept(1.0, lambda of_frame: of_frame.nbytes))
    for capture in (*few.captures[:2], few.captures[0]):
        shown = [Shown(one, capture, [], pose, True, Kept(9)).prediction.noise for one in (case, few)]
        np.testing.assert_array_equal(*shown)
    assert len(few.normal_numbers) == 1 < len(case.normal_numbers)


def test_twins_that_draw_alike_are_drawn_once(case, monkeypatch):
    """Fails if plates are drawn again for a twin that differs in its light or sensor alone, or not for one whose lens does."""
    drawn, draw = [], predictor.window_coverages
    monkeypatch.setattr(predictor, "window_coverages", lambda *given: drawn.append(given) or draw(*given))
    kept, predict = [], case.predictor().predict
    for name in ("exposure", "illumination_gradient", "radial_distortion"):
        kept.append(predict(1, [(name, clear(name))], np.zeros(6)))
        assert len(drawn) == (2 if name == "radial_distortion" else 1)
    fresh = Shown(case, case.captures[1], [("exposure", clear("exposure"))], np.zeros(6), False, Kept(9)).prediction
    np.testing.assert_array_equal(kept[0].features, fresh.features)


@pytest.mark.parametrize("turn_deg", [0.005, 0.05])
def test_a_mount_that_is_off_is_drawn_where_it_is(case, turn_deg):
    """Fails if a twin's plates are taken from where another mount, of as large windows, showed them before."""
    turned = [("camera_pose_offset", library.nulls_of("camera_pose_offset") | {"turn_y_deg": turn_deg})]
    predictor = case.predictor()
    predictor.predict(1, [], np.zeros(6))
    after = predictor.predict(1, turned, np.zeros(6))
    np.testing.assert_array_equal(after.features, case.predictor().predict(1, turned, np.zeros(6)).features)


def test_noise_follows_what_the_sensor_and_what_comes_after_it_do(case):
    """Fails if a derivative by a filter or a noise leaves noise as it is, or if time is spent on noise behind another lens; where
    all is measured again, a brighter scene has other noise.
    """
    before = [("sensor_noise", {"gain_dn_per_e": 0.2, "read_noise_dn": 1.0}), ("exposure", {"scale": 1.1})]
    shown = Shown(case, case.captures[0], before, np.zeros(6), True, Kept(9))
    moved = {
        name: [
            np.nanmax(np.abs(shown.change([*before, (name, clear(name))], by_response).noise))
            for by_response in (True, False)
        ]
        for name in ("vignetting", "denoising", "fixed_pattern_noise")
    }
    assert moved["vignetting"][0] == 0 < moved["vignetting"][1]
    assert all(noise > 0 for name in ("denoising", "fixed_pattern_noise") for noise in moved[name])
