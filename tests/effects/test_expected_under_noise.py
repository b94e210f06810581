"""An expected image is the mean of those with noise: of filters that keep edges, of a codec, of what filters make of noise."""

import cv2
import numpy as np
import pytest
from effect_views import parameters, view

from effects import jpeg_compression, library, noise_kernels, pipeline
from effects.quantisation import COSINES, LAGS, gains_of

DENOISING, SHARPENING = (library.available_effects()[name] for name in ("denoising", "sharpening"))
MEDIAN, WIDE = {"median_share": 1.0}, {"median_share": 1.0, "median_wide": 1.0}
BILATERAL = {"strength_dn": 6.0, "reach_px": 1.5}


def edges():
    """Return levels (64, 64, 1) of steps of several heights, some pixels wide."""
    image = np.full((64, 64), 60, np.float32)
    image[:, 20:], image[30:, 40:], image[44:, :20] = 200, 70, 72
    return cv2.GaussianBlur(image, (0, 0), 0.8)[..., None]


@pytest.mark.parametrize("noise", [1.0, 4.0])
@pytest.mark.parametrize("values", [MEDIAN, WIDE, BILATERAL])
def test_a_filter_that_keeps_edges_has_the_mean_of_what_noise_makes_of_them(values, noise):
    """Fails if noise is left out, which rounds edges: the filter of the mean image has them too sharp."""
    p, image, rng = parameters("denoising", **values), edges(), np.random.default_rng(1)
    taken = [
        DENOISING.apply(image + np.float32(noise) * rng.standard_normal(image.shape, np.float32), view(), p, rng)
        for _ in range(1500)
    ]
    plain, minding = (
        DENOISING.apply(image, view(noise_dn=n), p, None) - np.mean(taken, axis=0)
        for n in (0.0, np.full(image.shape, noise, np.float32))
    )
    assert np.sqrt(np.mean(minding**2)) < 0.05 * noise
    assert np.sqrt(np.mean(minding**2)) < 0.6 * np.sqrt(np.mean(plain**2))


@pytest.mark.parametrize("values", [{"median_share": 0.6}, BILATERAL, {"average_share": 0.6}, {}])
def test_noise_is_as_strong_in_a_blocks_coefficients_as_filters_leave_it(values):
    """Fails if filtered noise is taken for white: a codec's coarse steps would be dithered where they are not."""
    rng, sharp = np.random.default_rng(2), parameters("sharpening", amount=0.6, radius_px=1.2)
    p = parameters("denoising", **values)
    noise = 128 + 3 * rng.standard_normal((800, 800, 1), np.float32)
    out = SHARPENING.apply(DENOISING.apply(noise, view(), p, rng), view(), sharp, rng)[..., 0]
    blocks = COSINES @ (out - out.mean()).reshape(100, 8, 100, 8).swapaxes(1, 2) @ COSINES.T
    noise_dn, kernel = noise_kernels.processed(3.0, None, lambda n: DENOISING.noise_kernel(p, n))
    noise_dn, kernel = noise_kernels.processed(noise_dn, kernel, lambda n: SHARPENING.noise_kernel(sharp, n))
    told = noise_dn * gains_of(noise_kernels.correlations(kernel, LAGS))
    np.testing.assert_allclose(told, blocks.std((0, 1)), rtol=0.2)


@pytest.mark.parametrize("declared_dn", [0.0, 1.0])
@pytest.mark.parametrize(
    "smooth", [[], [("denoising", {"average_share": 1.0, "average_px": 1.5})]], ids=["", "smoothed"]
)
@pytest.mark.parametrize("values", [{"rggb": 1.0}, {"grbg": 1.0, "corrected": 1.0}, {"rggb": 0.7, "corrected": 0.3}])
def test_noise_through_a_mosaic_is_as_strong_as_it_leaves_it_and_what_smooths_it(values, smooth, declared_dn):
    """Fails if interpolated noise is taken for white, which a filter smooths away, or declared noise for interpolated."""
    noise = ("sensor_noise", parameters("sensor_noise", gain_dn_per_e=0.05, read_noise_dn=1.0))
    effects = [noise, ("bayer_demosaic", parameters("bayer_demosaic", **values))]
    effects += [(name, parameters(name, **p)) for name, p in smooth]
    flat, seen = np.full((300, 300, 3), 0.35, np.float32), view(noise_dn=declared_dn)
    taken = (
        pipeline.photometric(flat, seen, effects, np.random.default_rng(4))[20:-20, 20:-20] @ jpeg_compression.TO_YCC[0]
    )
    _, told_dn = pipeline.form(flat, seen, effects, None).outcome
    assert np.mean(told_dn) * np.linalg.norm(jpeg_compression.TO_YCC[0]) == pytest.approx(taken.std(), rel=0.06)


def coloured_patches():
    """Return levels (160, 160, 3) of patches that are nearly grey, as a rig's are in a light that is off."""
    grey = np.random.default_rng(5).uniform(30, 230, (4, 4)).repeat(40, 0).repeat(40, 1)
    return cv2.GaussianBlur((grey[..., None] * (1.05, 1.0, 0.95)).astype(np.float32), (0, 0), 0.8)


@pytest.mark.parametrize(("quality", "full_colour"), [(58, True), (58, False), (75, True), (75, False)])
def test_expected_jpeg_rounds_its_planes_as_a_decoder_does(quality, full_colour):
    """Fails if colours' planes are not whole numbers after decoding: all flats would be off by as much as a level."""
    image, rng = coloured_patches(), np.random.default_rng(3)
    taken = [
        jpeg_compression.compressed(
            np.clip(np.rint(image + rng.standard_normal(image.shape)), 0, 255).astype(np.uint8), quality, full_colour
        )
        for _ in range(150)
    ]
    off = jpeg_compression.expected(image, quality, full_colour, np.hypot(1, jpeg_compression.ROUNDING_DN)) - np.mean(
        taken, axis=0
    )
    of_blocks = off.reshape(20, 8, 20, 8, 3).mean((1, 3))
    assert np.sqrt(np.mean((of_blocks @ jpeg_compression.TO_YCC[0]) ** 2)) < 0.2
    assert np.sqrt(np.mean(of_blocks**2)) < 0.35


def test_a_rounding_of_much_noise_takes_both_neighbours():
    """Fails if only one of a number's neighbours counts: a coefficient of 0 with noise would have a mean."""
    plane = np.zeros((8, 8), np.float32)
    quantised = jpeg_compression.Plane(
        plane, np.full((1, 1), 3, np.float32), gains_of(noise_kernels.correlations(None, LAGS)), np.float32(0),
        np.full((8, 8), 8, np.float32),
    )  # fmt: skip
    levels, share, _ = quantised.quantised(np.float32(0))
    assert abs(levels[0, 0, 0] + share[0, 0] * (levels[1, 0, 0] - levels[0, 0, 0])) < 0.01
