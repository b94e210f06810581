"""At null parameters an effect changes nothing, bit for bit, else it would win or lose a fit by its own rounding."""

import numpy as np
import pytest
from effect_views import noise_image, scene, view

from effects import contract, library, pipeline

EFFECTS = library.available_effects()


def having(function):
    """Return the names of effects that have a function."""
    return [name for name, module in EFFECTS.items() if hasattr(module, function)]


def test_all_of_the_vocabulary_is_there():
    """An effect of design.md that has no file could never be named."""
    vocabulary = """camera_pose_offset marker_scale rail_sag ink_spread ink_reflectance illumination_gradient
        specular_highlight focal_length principal_point radial_distortion tangential_distortion
        lateral_chromatic_aberration lens_blur defocus field_curvature vignetting veiling_glare motion_blur
        rolling_shutter exposure sensor_noise fixed_pattern_noise bayer_demosaic colour_balance tone_curve sharpening
        denoising jpeg_compression local_warp""".split()
    assert len(vocabulary) == 29
    assert set(vocabulary) <= set(EFFECTS)


@pytest.fixture
def nothing_skipped(monkeypatch):
    """Let the pipeline call effects at their null as well."""
    monkeypatch.setattr(pipeline, "acting", lambda name, p: library.nulls_of(name) | dict(p))


def test_the_pipeline_calls_no_effect_at_its_null(monkeypatch):
    """Fails if an effect at its null cost time, or a map of points by rounding alone a resampling of the image."""
    for name in EFFECTS:
        chosen, v = [(name, library.nulls_of(name))], view()
        with monkeypatch.context() as patched:
            for hook in contract.HOOKS:
                if hasattr(EFFECTS[name], hook):
                    patched.setattr(EFFECTS[name], hook, None)
            assert pipeline.scene_with_effects(scene(), chosen).plates
            assert pipeline.light_spread(v, chosen) is None
            pipeline.form_image(noise_image(1, v, high=1.0)[..., 0], v, chosen, np.random.default_rng(3))


@pytest.mark.parametrize("name", having("change_scene"))
def test_scene_stays(name, nothing_skipped):
    """Fails if Blender would render again for nothing."""
    before = scene()
    after = pipeline.scene_with_effects(before, [(name, library.nulls_of(name))])
    assert after.with_(plates=(), T_cam_mount=None) == before.with_(plates=(), T_cam_mount=None)
    np.testing.assert_array_equal(after.T_cam_mount, before.T_cam_mount)
    for a, b in zip(after.plates, before.plates, strict=True):
        for x, y in ((a.T_world_plate, b.T_world_plate), (a.x_m, b.x_m), (a.y_m, b.y_m), (a.white, b.white)):
            np.testing.assert_array_equal(x, y)


@pytest.mark.parametrize("name", having("map_points"))
@pytest.mark.parametrize("channel", [0, 1, 2])
def test_points_stay(name, channel, nothing_skipped):
    """Fails if points move by more than the rounding of pixels to rays and back."""
    xy = np.random.default_rng(1).uniform(-50, 250, (100, 2))
    moved = pipeline.map_points(xy, view(), [(name, library.nulls_of(name))], channel)
    np.testing.assert_allclose(moved, xy, atol=1e-10)


@pytest.mark.parametrize("name", having("spread"))
def test_light_stays(name, nothing_skipped):
    """Fails if a part of a point's light lands beside it, or something is left to blur."""
    v, nulls = view(), library.nulls_of(name)
    xy = np.random.default_rng(1).uniform(-50, 250, (20, 2))
    directions, shares = pipeline.light_spread(v, [(name, nulls)])(xy)
    np.testing.assert_array_equal(shares @ directions, 0.0)
    assert all(p == nulls for _, p in pipeline.left_to_apply([(name, nulls)]))


@pytest.mark.parametrize("name", having("apply"))
@pytest.mark.parametrize("channels", [1, 3])
@pytest.mark.parametrize("seeded", [True, False])
def test_pixels_stay(name, channels, seeded):
    """Fails if the effect's own code changes a pixel, also beyond the range, with noise or without."""
    if channels == 1 and getattr(EFFECTS[name], "MAKES_COLOUR", False):
        channels = 3
    v = view()
    image = noise_image(channels, v, high=255.0 if EFFECTS[name].STAGE == "processing" else 1.0)
    rng = np.random.default_rng(5) if seeded else None
    out = EFFECTS[name].apply(image.copy(), v, library.nulls_of(name), rng)
    np.testing.assert_array_equal(out, image)


@pytest.mark.parametrize("name", having("apply"))
def test_formed_image_and_its_noise_stay(name, nothing_skipped):
    """Fails if, through the whole chain, an effect at its null is another image, or says that noise is more or less."""
    v, chosen = view(noise_dn=1.5), [(name, library.nulls_of(name))]
    radiance = noise_image(3, v, high=1.0)
    levels, noise_dn = pipeline.form(radiance, v, chosen, None).outcome
    base, base_noise_dn = pipeline.form(radiance, v, [], None).outcome
    np.testing.assert_array_equal(levels, base)
    np.testing.assert_array_equal(noise_dn, np.broadcast_to(np.float32(base_noise_dn), np.shape(noise_dn)))
    quiet = view()  # an effect's own noise would be drawn before the declared one
    taken = pipeline.photometric(radiance, quiet, chosen, np.random.default_rng(3))
    np.testing.assert_array_equal(taken, pipeline.photometric(radiance, quiet, [], np.random.default_rng(3)))


@pytest.mark.parametrize("name", having("apply"))
def test_an_auxiliary_parameter_does_nothing_by_itself(name):
    """An effect whose strength is nil would be named for a depth in focus, or a radius, that means nothing."""
    parameters, start, v = EFFECTS[name].PARAMETERS, library.starts_of(name)[0], view()
    only = {key: start[key] + 0.3 * (p.upper - start[key]) if p.auxiliary else p.null for key, p in parameters.items()}
    assert set(only) != {key for key, p in parameters.items() if p.auxiliary}  # something must be able to be named
    channels = 3 if getattr(EFFECTS[name], "MAKES_COLOUR", False) else 1
    image = noise_image(channels, v, high=255.0 if EFFECTS[name].STAGE == "processing" else 1.0)
    out = EFFECTS[name].apply(image.copy(), v, only, np.random.default_rng(5))
    np.testing.assert_array_equal(out, image)
