"""Exact coverage and the fit of the known code: what every observable stands on."""

from dataclasses import replace

import numpy as np
import pytest
from drawn import grey_image, plate, scene_and_view

from effects import library, pipeline
from effects.base import View
from effects.encoding import mean_of_clipped
from effects.filters import gaussian
from gap.measure.capture import COARSE_TO_FINE, FINE, Codes, measure_plates, noise_amplification, states_at
from gap.pixels.raster import add_polygons, running_sums
from gap.predict.synthesis import Prints, coverages, ground_seen_at, shade
from gap.problem import code_corners_world, encoding_table
from rig.geometry import project, station_pose
from rig.plates import spread_ink


def test_coverage_equals_dense_sampling():
    """A rasteriser that drops or doubles a pixel's share of an edge would be off by more than sampling is."""
    triangle = np.array([[[0.3, 0.2], [9.7, 3.1], [5.2, 8.9]]])
    n = 100
    y, x = (np.mgrid[0 : 10 * n, 0 : 10 * n] + 0.5) / n
    inside = np.ones_like(x, bool)
    for k in range(3):
        a, b = triangle[0, k], triangle[0, (k + 1) % 3]
        inside &= (b[0] - a[0]) * (y - a[1]) - (b[1] - a[1]) * (x - a[0]) > 0
    sampled = inside.reshape(10, n, 10, n).mean((1, 3))
    drawn = np.zeros((10, 12))
    add_polygons(drawn, triangle, np.ones(1))
    assert np.abs(running_sums(drawn) - sampled).max() < 5e-4


def test_levels_of_flats_are_the_nominal_ones():
    """Wrong signs or missing terms in shading would shift the ground, the white or the sky."""
    scene, view = scene_and_view()
    view = View(**(view.__dict__ | {"T_cam_world": station_pose(0.5, 10)}))
    image = shade(scene, view, *coverages(Prints(scene.plates), view))
    assert np.isclose(image[-5, 5], 0.35) and np.isclose(image[0, 0], 0.3)
    assert np.isclose(image.max(), 0.8) and np.isclose(image.min(), 0.05, atol=0.02)


def test_light_is_taken_where_a_bent_lens_sees_the_ground():
    """Fails if a lens is not inverted for the ground's light, or so coarsely that light lies a millimetre off."""
    _, view = scene_and_view()
    view = View(**(view.__dict__ | {"T_cam_world": station_pose(0.5, 10)}))
    lens = pipeline.point_map(view, [("radial_distortion", {"k1": -0.25, "k2": 0.05, "k3": 0.0})], 1)
    x, y = np.meshgrid(np.linspace(-0.4, 0.4, 41), np.linspace(0.6, 1.4, 41))
    seen = lens(project(view.K, view.T_cam_world, np.stack([x, y, 0 * x], -1)).reshape(-1, 2)).reshape(41, 41, 2)
    inside = (seen >= 0).all(2) & (seen <= [view.width - 1, view.height - 1]).all(2)
    ground = ground_seen_at(view, lens, *np.ascontiguousarray(np.moveaxis(seen, 2, 0), np.float32))
    off = np.hypot(ground[0] - x, ground[1] - y)[inside]
    assert inside.sum() > 100 and off.max() < 1e-3


def test_the_fit_finds_projected_corners_of_its_own_synthesis_and_of_noise_its_standard_error():
    """A fit with a half-pixel bias, swapped corners or wrong information would be off by more than 0.01 px."""
    scene, view = scene_and_view()
    table = encoding_table("srgb", 1.0)
    grey = grey_image(scene, view, table)
    codes = Codes.of(scene.plates, [0.8, 0.05, 0.35], table)
    truth = project(view.K, view.T_cam_world, np.array([code_corners_world(p) for p in scene.plates]))
    noisy = grey + np.random.default_rng(1).normal(0, 1, grey.shape)
    features, information, measured = measure_plates(
        noisy, states_at(truth + 0.8, codes), np.ones(2, bool), codes, FINE
    )
    error = features[:, :8].reshape(-1, 4, 2) - truth
    se = np.sqrt([np.diag(np.linalg.inv(i)) for i in information])[:, :8]
    assert measured.all() and np.abs(error).max() < 0.03
    assert np.abs(error.reshape(-1, 8) / se).max() < 5


@pytest.mark.parametrize("scale", [0.95, 1.0, 1.05])
def test_codes_of_another_size_are_measured_where_they_are(scale):
    """A measure that holds the plate to its code puts corners between the two, and noise then throws them about."""
    nominal, view = scene_and_view()
    scene = pipeline.scene_with_effects(nominal, [("marker_scale", {"scale": scale})])
    table = encoding_table("srgb", 1.0)
    codes = Codes.of(nominal.plates, [0.8, 0.05, 0.35], table)
    grey = grey_image(scene, view, table)
    truth = project(view.K, view.T_cam_world, np.array([code_corners_world(p) for p in scene.plates]))
    features, _, measured = measure_plates(grey, states_at(truth + 0.4, codes), np.ones(2, bool), codes, COARSE_TO_FINE)
    assert measured.all()
    assert np.abs(features[:, :8].reshape(-1, 4, 2) - truth).max() < 0.02
    side = np.linalg.norm(truth - np.roll(truth, 1, axis=1), axis=-1).mean(1)
    wanted = side / 2 * (codes.half_plate / (scale * codes.half_code) - codes.half_plate / codes.half_code)
    np.testing.assert_allclose(features[:, -1], wanted, atol=0.05)


def test_ink_grows_by_its_length_and_not_by_its_area():
    """Ink that grew the whole plate, or not at the corners, would change the black area by another amount."""
    p = plate(rz=0.0)
    cell = 0.01
    frame_only = spread_ink(p, 0.001)
    black = ~frame_only.white
    area = (np.diff(frame_only.y_m)[:, None] * np.diff(frame_only.x_m)[None, :])[black].sum()
    assert area > (~p.white).sum() * cell**2
    outermost = frame_only.x_m[np.flatnonzero(black.any(0))[0]]
    assert np.isclose(outermost, -0.036)
    back = spread_ink(p, -0.001)
    assert (~back.white).any() and np.isclose(back.x_m[np.flatnonzero((~back.white).any(0))[0]], -0.034)


@pytest.mark.parametrize("level", [-1.0, 0.0, 1.5, 128.0, 254.5, 255.0, 400.0])
def test_expected_levels_are_the_mean_of_clipped_ones(level):
    """A saturated white of mean 254.6 against an expected 255 looks like an effect that is not there."""
    noisy = np.clip(np.rint(level + np.random.default_rng(1).normal(0, 1.0, 200_000)), 0, 255)
    assert mean_of_clipped(np.full((2, 2), level), 1.0) == pytest.approx(noisy.mean(), abs=0.03)


SPREADS = [
    ("motion_blur", {"dx_px": 3.0, "dy_px": -1.0}),
    ("defocus", {"blur_px_per_dioptre": 1.5, "focus_m": 0.4, "softness": 0.0}),
    ("field_curvature", {"sigma_corner_px": 6.0, "softness": 1.0}),
    ("lens_blur", {"sigma_px": 1.5, "softness": 0.3}),
]


def drawn_with(scene, view, effect):
    """Return the linear image (rows, columns) of a scene whose light an effect spreads, drawn by parts, the rest blurred."""
    drawn = shade(scene, view, *coverages(Prints(scene.plates), view, spread=pipeline.light_spread(view, [effect])))
    for name, left in pipeline.left_to_apply([effect]):
        drawn = library.effect_named(name).apply(drawn.astype(np.float32)[..., None], view, left, None)[..., 0]
    return drawn


@pytest.mark.parametrize("effect", SPREADS, ids=[name for name, _ in SPREADS])
def test_light_is_spread_as_the_image_is_blurred(effect):
    """Parts that land misaligned, or too far, would part the fit's image from Blender's; blurring whole pixels is 1 % off."""
    scene, view = scene_and_view()
    sharp = shade(scene, view, *coverages(Prints(scene.plates), view))
    drawn = drawn_with(scene, view, effect)
    module, m = library.effect_named(effect[0]), 20
    blurred = module.apply(sharp.astype(np.float32)[..., None], view, effect[1], None)[..., 0]
    inside = np.s_[m:-m, m:-m]
    assert np.abs(sharp - blurred)[inside].max() > 0.1
    assert np.abs(drawn - blurred)[inside].max() < 0.08
    assert np.sqrt(((drawn - blurred)[inside] ** 2).mean()) < 0.45 * np.sqrt(((sharp - blurred)[inside] ** 2).mean())


@pytest.mark.parametrize("end", [0.0, 1.0])
@pytest.mark.parametrize("effect", SPREADS[1:], ids=[name for name, _ in SPREADS[1:]])
def test_a_hardly_softer_blur_is_hardly_another(effect, end):
    """Fails if a disc or a Gaussian is drawn otherwise than what is nearly one: a fit that comes there takes no step any more."""
    scene, view = scene_and_view()
    name, p = effect
    there, beside = (drawn_with(scene, view, (name, p | {"softness": s})) for s in (end, abs(end - 1e-8)))
    assert np.abs(there - beside).max() < 2e-4


@pytest.mark.filterwarnings("ignore:All-NaN")  # behind the camera nothing has pixels
def test_light_is_spread_where_nothing_is_in_view():
    """Fails if a photograph that looks past the rig ends a blurred twin with an error."""
    scene, view = scene_and_view()
    view = replace(view, T_cam_world=station_pose(1.6, -60))
    spread = pipeline.light_spread(view, [("defocus", {"blur_px_per_dioptre": 1.0, "focus_m": 0.7, "softness": 1.0})])
    plates, black, _ = coverages(Prints(scene.plates), view, spread=spread)
    assert not plates.any() and not black.any()


@pytest.mark.parametrize("sigma_px", [0.2, 0.6, 1.3])
def test_a_blurred_twin_shows_no_stripes_finer_than_its_pixels(sigma_px):
    """Blurring whole pixels keeps what sampling made of finer stripes; a blur on pixels five times finer does not."""
    scene, view = scene_and_view()
    prints, times = Prints(scene.plates), 5
    K = np.array([[times, 0, (times - 1) / 2], [0, times, (times - 1) / 2], [0, 0, 1.0]]) @ view.K
    size = {name: times * getattr(view, name) for name in ("width", "height", "margin")}
    fine = shade(scene, replace(view, K=K, **size), *coverages(prints, replace(view, K=K, **size)))
    fine = gaussian(fine.astype(np.float32)[..., None], times * sigma_px)[..., 0].astype(float)
    exact = fine.reshape(fine.shape[0] // times, times, -1, times).mean((1, 3))
    chosen, m = [("lens_blur", {"sigma_px": sigma_px})], 20
    drawn = shade(scene, view, *coverages(prints, view, spread=pipeline.light_spread(view, chosen)))
    drawn = pipeline.photometric(
        drawn[..., None], replace(view, encoding="linear"), pipeline.left_to_apply(chosen), None
    )[..., 0]
    sharp = shade(scene, view, *coverages(prints, view)).astype(np.float32)
    whole = 255 * gaussian(sharp[..., None], sigma_px)[..., 0]
    inside = np.s_[m:-m, m:-m]
    error, error_of_whole = (np.sqrt(((image - 255 * exact)[inside] ** 2).mean()) for image in (drawn, whole))
    assert error < 0.1 and error < 0.4 * error_of_whole


def test_parts_of_light_fill_what_they_stand_for():
    """Parts that bunch, or that visit the exposure in step with the pupil, would spread less or more than the formula; parts
    that lean to one side move edges.
    """
    _, view = scene_and_view()
    at = np.array([[600.0, 30.0]])
    for chosen in (*([effect] for effect in SPREADS), SPREADS):
        directions, shares = pipeline.light_spread(view, chosen)(at)
        moved = shares @ directions[0]
        wanted = np.zeros((2, 2))
        for name, p in chosen:
            if name == "motion_blur":
                way = np.array([p["dx_px"], p["dy_px"]])
                wanted += np.outer(way, way) / 12
            elif name == "lens_blur":
                left_px = library.effect_named(name).left_to_blur(p)["sigma_px"]
                wanted += np.eye(2) * (p["sigma_px"] ** 2 - left_px**2)
            else:
                wanted += np.eye(2) * library.effect_named(name).spread_px(*at.T, view, p) ** 2
        assert np.abs(moved.mean(0)).max() < 1e-9
        np.testing.assert_allclose(np.cov(moved.T, bias=True), wanted, atol=1e-4 * wanted.max())
        half = len(moved) // 2
        np.testing.assert_allclose(moved[half:], -moved[:half], atol=1e-9)


def test_a_plate_blurred_beyond_its_modules_counts_for_less():
    """Noise throws a fit to a code that is blurred away about: taken at its word, such a plate would sink a good twin."""
    scene, view = scene_and_view()
    table = encoding_table("srgb", 1.0)
    codes = Codes.of(scene.plates, [0.8, 0.05, 0.35], table)
    truth = project(view.K, view.T_cam_world, np.array([code_corners_world(p) for p in scene.plates]))

    def amplified(*chosen):
        grey = grey_image(scene, view, table, pipeline.light_spread(view, chosen))
        features, information, measured = measure_plates(
            grey, states_at(truth + 0.3, codes), np.ones(2, bool), codes, FINE
        )
        return noise_amplification(grey, features, information, measured, codes)

    side = np.linalg.norm(truth[0, 1] - truth[0, 0])
    assert (amplified() == 1).all()
    assert (amplified(("motion_blur", {"dx_px": 0.2 * side, "dy_px": 0.2 * side})) > 2).all()
