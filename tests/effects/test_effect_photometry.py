"""Effects on light keep what physics keeps: energy, spreads, noise by its law, levels by their curve."""

import cv2
import numpy as np
import pytest
from effect_views import MARGIN, noise_image, parameters, view

from effects import encoding, filters, jpeg_compression, library, pipeline
from effects.base import light_factor
from effects.motion_blur import motion_blur_kernel

FOUND = library.available_effects()
FRAME = np.s_[MARGIN:-MARGIN, MARGIN:-MARGIN]
LOW_QUALITY = ("jpeg_compression", {"loss": 73.0})


def spot(v):
    """Return an image that is dark but for one bright pixel near the frame's middle."""
    image = np.zeros((v.height + 2 * v.margin, v.width + 2 * v.margin, 1), np.float32)
    image[v.margin + v.height // 2, v.margin + v.width // 2] = 1
    return image


def moments(image):
    """Return (sum, variance along x, variance along y) of an image."""
    plane = image[..., 0].astype(float)
    y, x = np.mgrid[: plane.shape[0], : plane.shape[1]]
    total = plane.sum()
    mx, my = (plane * x).sum() / total, (plane * y).sum() / total
    return total, (plane * (x - mx) ** 2).sum() / total, (plane * (y - my) ** 2).sum() / total


@pytest.mark.parametrize(
    ("name", "values"),
    [
        ("lens_blur", {"sigma_px": 1.3}),
        ("lens_blur", {"sigma_px": 1.3, "softness": 0.2}),
        ("denoising", {"average_share": 1.0, "average_square": 0.5}),
        ("defocus", {"blur_px_per_dioptre": 2.0, "focus_m": 1.5, "softness": 0.4}),
        ("field_curvature", {"sigma_corner_px": 6.0}),
        ("motion_blur", {"dx_px": 5.0, "dy_px": -2.0}),
        ("veiling_glare", {"share": 0.2}),
        ("bayer_demosaic", {"gbrg": 1.0}),
    ],
)
def test_even_light_stays(name, values):
    """A blur that makes light or loses it would be read as exposure."""
    v = view()
    image = np.full((v.height + 2 * v.margin, v.width + 2 * v.margin, 3), 0.37, np.float32)
    out = FOUND[name].apply(image, v, parameters(name, **values), None)
    np.testing.assert_allclose(out, 0.37, atol=2e-6)


@pytest.mark.parametrize("sigma", [0.1, 0.3, 0.49, 0.51, 0.8, 1.7, 3.3])
@pytest.mark.parametrize("blur", [filters.gaussian, filters.box, filters.disc, filters.soft_disc(0.5)])
def test_blurs_spread_what_they_say(blur, sigma):
    """Sampled kernels of a fraction of a pixel spread too little or too much, and jump; a fit would stick there."""
    total, vx, vy = moments(blur(spot(view()), sigma))
    assert total == pytest.approx(1, abs=1e-5)
    assert (vx, vy) == pytest.approx((sigma**2, sigma**2), rel=2e-3)


@pytest.mark.parametrize(("dx", "dy"), [(0.3, 0), (1.0, 0.0), (0, 4.0), (3.0, -2.0), (10.5, 7.0)])
def test_motion_spreads_what_it_says(dx, dy):
    """Motion blur of length L has the variance L^2 / 12 along its way."""
    kernel = motion_blur_kernel(dx, dy)
    _, vx, vy = moments(kernel[..., None])
    assert kernel.sum() == pytest.approx(1)
    assert vx + vy == pytest.approx((dx * dx + dy * dy) / 12, rel=1e-3)


def test_varying_blur_is_the_even_one_where_it_is_even():
    """Mixing levels must not change the spread."""
    v = view()
    sigma = np.full((v.height + 2 * v.margin, v.width + 2 * v.margin), 1.2)
    total, vx, vy = moments(filters.varying_blur(spot(v), sigma))
    assert (total, vx, vy) == pytest.approx((1, 1.44, 1.44), rel=1e-3)


def test_photon_transfer():
    """EMVA 1288: variance against mean is a line whose slope is the gain, whose foot is the read noise."""
    v = view(encoding="linear", width=400, height=400)
    gain, read = 0.1, 1.5
    means, variances = [], []
    for level in (0.1, 0.3, 0.6, 0.8):
        radiance = np.full((v.height + 2 * v.margin, v.width + 2 * v.margin), level)
        chosen = [("sensor_noise", {"gain_dn_per_e": gain, "read_noise_dn": read})]
        image = pipeline.form_image(radiance, v, chosen, np.random.default_rng(7))
        means.append(image.mean())
        variances.append(image.var())
    slope, foot = np.polyfit(means, variances, 1)
    assert slope == pytest.approx(gain, rel=0.03)
    assert foot == pytest.approx(read**2, rel=0.15)


@pytest.mark.parametrize("encoding", ["srgb", "linear"])
@pytest.mark.parametrize("level", [0.0, 0.01, 0.3, 0.98])
def test_expected_image_is_the_mean_of_noisy_ones(encoding, level):
    """Clipping lifts black and lowers white, a bent encoding shifts the rest: left out, noise looks like a tone curve."""
    v = view(encoding=encoding, width=700, height=700)
    radiance = np.full((v.height + 2 * v.margin, v.width + 2 * v.margin), level)
    chosen = [("sensor_noise", {"gain_dn_per_e": 0.3, "read_noise_dn": 4.0})]
    noisy = pipeline.form_image(radiance, v, chosen, np.random.default_rng(3))
    expected = pipeline.form_image(radiance, v, chosen, None)
    assert expected.mean() == pytest.approx(noisy.mean(), abs=0.08)


def test_declared_noise_and_the_expected_image():
    """The declared deviation, whatever the level; none where the expected image is asked for; seeds decide."""
    v = view(noise_dn=2.0)
    radiance = np.full((v.height + 2 * v.margin, v.width + 2 * v.margin), 0.3)
    clean = pipeline.form_image(radiance, v, [], None)
    noisy = pipeline.form_image(radiance, v, [], np.random.default_rng(1))
    assert (noisy - clean).std() == pytest.approx(2.0, rel=0.03)
    assert np.ptp(clean) == 0
    np.testing.assert_array_equal(noisy, pipeline.form_image(radiance, v, [], np.random.default_rng(1)))


def test_fixed_pattern_belongs_to_the_pixels():
    """The same in every capture and with any margin, another in another camera; its sizes are the parameters."""
    chosen = [("fixed_pattern_noise", {"prnu": 0.02, "column_offset_dn": 1.0})]

    def pattern(margin, seed):
        v = view(encoding="linear", margin=margin)
        radiance = np.full((v.height + 2 * margin, v.width + 2 * margin), 0.5)
        return pipeline.form_image(radiance, v, chosen, np.random.default_rng(seed))[..., 0] - 127.5

    np.testing.assert_allclose(pattern(0, 1), pattern(40, 2), atol=1e-4)
    columns = pattern(0, 1).mean(axis=0)
    assert columns.std() == pytest.approx(1.0, rel=0.2)
    assert (pattern(0, 1) - columns).std() == pytest.approx(0.02 * 127.5, rel=0.05)


@pytest.mark.parametrize("name", ["srgb", "linear"])
def test_encoding_round_trip(name):
    """The table against IEC 61966-2-1, and back."""
    linear = np.linspace(0, 1, 100_001).astype(np.float32)
    grey = encoding.encode(linear, name)
    exact = encoding.srgb_encode(linear.astype(float)) if name == "srgb" else linear
    np.testing.assert_allclose(grey, 255 * exact, atol=0.002)
    np.testing.assert_allclose(encoding.decode(grey, name), linear, atol=2e-5)
    assert encoding.encode(np.float32([[-0.5, 2.0]]), name).tolist() == [[0, 255]]


def test_exposure_clips():
    """What exceeds full scale is lost."""
    v = view()
    radiance = np.full((v.height + 2 * v.margin, v.width + 2 * v.margin), 0.6)
    assert pipeline.form_image(radiance, v, [("exposure", {"scale": 2.0})], None).max() == 255


def test_order_is_physical():
    """Sharpening and JPEG work on a noisy image, whatever the order of the list."""
    v = view(noise_dn=1.0)
    radiance = noise_image(1, v, high=0.8)[..., 0]
    chosen = [("jpeg_compression", {"loss": 30.0}), ("lens_blur", {"sigma_px": 1.0}), ("sharpening", {"amount": 0.5})]
    images = [pipeline.form_image(radiance, v, c, np.random.default_rng(2)) for c in (chosen, chosen[::-1])]
    np.testing.assert_array_equal(*images)


def test_jpeg_is_the_real_one():
    """A whole quality gives what a camera's library gives for the rounded frame of a capture that was taken."""
    v = view()
    image = cv2.GaussianBlur(noise_image(1, v), (0, 0), 2)[..., None]
    out = FOUND["jpeg_compression"].apply(image, v, {"loss": 40.0, "full_colour": 0.0}, np.random.default_rng(0))[FRAME]
    _, data = cv2.imencode(".jpg", pipeline.to_uint8(image[FRAME]), [cv2.IMWRITE_JPEG_QUALITY, 60])
    np.testing.assert_array_equal(out[..., 0], cv2.imdecode(data, cv2.IMREAD_GRAYSCALE))


@pytest.mark.parametrize(("channels", "full_colour"), [(1, False), (3, False), (3, True)])
def test_expected_jpeg_is_the_library_s_but_for_its_whole_numbers(channels, full_colour):
    """Wrong tables, a transposed transform or colour stored the other way would be off by many levels, not by rounding."""
    image = np.stack([cv2.GaussianBlur(noise_image(1, view(), k), (0, 0), 2) for k in range(channels)], axis=-1)
    pixels = np.rint(image[FRAME]).astype(np.uint8)
    for quality in (30, 75, 95):
        expected = jpeg_compression.expected(pixels.astype(np.float32), quality, full_colour, 0.0)
        right, other = (
            expected - jpeg_compression.compressed(pixels, quality, way).astype(float)
            for way in (full_colour, not full_colour)
        )
        assert np.sqrt((right**2).mean()) < 2
        assert np.abs(right.mean()) < 0.1
        assert channels == 1 or np.sqrt((right**2).mean()) < 0.6 * np.sqrt((other**2).mean())


# ITU-T T.81, tables K.1 and K.2
K1 = """16 11 10 16 24 40 51 61  12 12 14 19 26 58 60 55  14 13 16 24 40 57 69 56  14 17 22 29 51 87 80 62
18 22 37 56 68 109 103 77  24 35 55 64 81 104 113 92  49 64 78 87 103 121 120 101  72 92 95 98 112 100 103 99"""
K2 = "17 18 24 47 99 99 99 99  18 21 26 66 99 99 99 99  24 26 56 99 99 99 99 99  47 66 99 99 99 99 99 99" + 32 * " 99"


@pytest.mark.parametrize("quality", range(1, 101))
def test_jpegs_tables_are_the_standards_scaled_as_libjpeg_does(quality):
    """Fails if a table stays in the file's order (zigzag), or if brightness and colour are exchanged."""
    scale = 5000 // quality if quality < 50 else 200 - 2 * quality
    for table, text in zip(jpeg_compression.tables(quality), (K1, K2), strict=True):
        standard = np.array(text.split(), int).reshape(8, 8)
        assert (table == np.clip((standard * scale + 50) // 100, 1, 255)).all()


def test_expected_jpeg_minds_the_sensor_s_noise_too():
    """A codec that knew the declared noise alone would give one step, or the next, where repeats are spread over several."""
    sensor = ("sensor_noise", {"gain_dn_per_e": 0.2, "read_noise_dn": 2.0})
    for level in (158.6, 159.5, 160.3):
        expected, taken = flats_after_jpeg(level, ("jpeg_compression", {"loss": 73.0}), sensor)
        assert expected.mean() == pytest.approx(taken.mean(), abs=0.3)
    steps = jpeg_compression.tables(27)[0][0, 0] / 8
    alone, _ = flats_after_jpeg(158.6, ("jpeg_compression", {"loss": 73.0}))
    assert abs(alone.mean() - taken.mean()) > 0.2 * steps


def test_expected_jpeg_keeps_the_side_of_a_coarse_step_that_noise_would_take():
    """Rounded before, a flat of 159.6 would go to 160 and so to the next level that quality 27 has, 3.75 further."""
    expected, taken = flats_after_jpeg(159.6, LOW_QUALITY)
    assert expected.mean() == pytest.approx(taken.mean(), abs=0.3)


@pytest.mark.parametrize("level", [159.5, 159.58, 159.66, 159.72])
def test_expected_jpeg_lies_between_two_steps_where_noise_takes_either(level):
    """Quality 36 has a step from 158.25 to 161: one of them, in the place of their mean, is off by up to 1.4 levels."""
    expected, taken = flats_after_jpeg(level, ("jpeg_compression", {"loss": 64.0}))
    assert expected.mean() == pytest.approx(taken.mean(), abs=0.15)


def flats_after_jpeg(level, *effects):
    """Return (expected, taken) levels of the frame of an even image under a noise of one level."""
    v = view(encoding="linear", width=400, height=400, noise_dn=1.0)
    flat = np.full((v.height + 2 * v.margin, v.width + 2 * v.margin, 1), level / 255, np.float32)
    frame = np.s_[MARGIN:-MARGIN, MARGIN:-MARGIN]
    return [pipeline.photometric(flat, v, list(effects), rng)[frame] for rng in (None, np.random.default_rng(3))]


def test_tone_curve_keeps_ends_and_order():
    """Black and white stay, and no two levels change places, over all of the bounds."""
    levels = np.linspace(0, 255, 256, dtype=np.float32)[None, :, None]
    known = FOUND["tone_curve"].PARAMETERS
    for name in FOUND["tone_curve"].LIFTS:
        for value in (known[name].lower, known[name].upper):
            bent = {k: 5.0 for k in FOUND["tone_curve"].LIFTS} | {name: value}
            out = FOUND["tone_curve"].apply(levels, view(), bent, None)[0, :, 0]
            assert (out[0], out[-1]) == (0, 255)
            assert (np.diff(out) > -1e-4).all()


def test_medians_of_both_windows():
    """Fails if the wide median were the narrow one, or its share not what is mixed in."""
    image = noise_image(1, view())
    narrow, wide, half = (
        FOUND["denoising"].apply(image, view(), parameters("denoising", median_share=1.0, median_wide=w), None)[..., 0]
        for w in (0.0, 1.0, 0.5)
    )
    np.testing.assert_allclose(narrow, cv2.medianBlur(image[..., 0], 3), atol=1e-4)
    np.testing.assert_allclose(wide, cv2.medianBlur(image[..., 0], 5), atol=1e-4)
    np.testing.assert_allclose(half, (narrow + wide) / 2, atol=1e-4)


@pytest.mark.parametrize("square", [0.0, 0.4, 1.0])
def test_averages_are_of_the_kind_and_size_that_they_say(square):
    """Fails if a square were a Gaussian, or noise after it were told to be more or less than it is."""
    p = parameters("denoising", average_share=0.8, average_px=np.sqrt(2 / 3), average_square=square)
    v = view()
    out = FOUND["denoising"].apply(spot(v), v, p, None)[..., 0]
    kernel = out[out.shape[0] // 2 - 1 : out.shape[0] // 2 + 2, out.shape[1] // 2 - 1 : out.shape[1] // 2 + 2]
    if square == 1.0:
        np.testing.assert_allclose(kernel, 0.8 / 9 + 0.2 * np.outer([0, 1, 0], [0, 1, 0]), atol=1e-6)
    total, vx, vy = moments(out[..., None])
    assert (total, vx, vy) == pytest.approx((1, 0.8 * 2 / 3, 0.8 * 2 / 3), rel=2e-3)
    noise = np.random.default_rng(2).normal(128, 5, (*out.shape, 1)).astype(np.float32)
    left = FOUND["denoising"].apply(noise, v, p, None)[FRAME].std() / noise[FRAME].std()
    assert np.linalg.norm(FOUND["denoising"].noise_kernel(p, 5.0)) == pytest.approx(left, rel=0.03)


@pytest.mark.parametrize("slope", [(0.4, 0.0), (-0.3, 0.4)])
def test_a_gradient_levels_off(slope):
    """Fails if it went on as steeply far away, or another way than along the gradient, or were another one at the middle."""
    light = parameters("illumination_gradient", gradient_x=slope[0], gradient_y=slope[1], levelling_per_m2=4.0)
    steepness = np.hypot(*slope)
    along = np.array([-50.0, -1e-4, 0.0, 1e-4, 50.0])[:, None] * np.array(slope) / steepness
    got = light_factor(light, along[:, 0], 1 + along[:, 1])
    assert got[[0, 4]] == pytest.approx([1 - steepness / 2, 1 + steepness / 2], rel=1e-3)  # a length of half a metre
    assert (got[3] - got[1]) / 2e-4 == pytest.approx(steepness, rel=1e-5)
    across = 0.7 * np.array([-slope[1], slope[0]]) / steepness
    assert light_factor(light, across[0], 1 + across[1]) == pytest.approx(1.0)


CURVE = {"lift_at_30_pct_dn": 12.0, "lift_at_50_pct_dn": 18.0, "lift_at_70_pct_dn": 10.0}
SMOOTH, SHARP = ("denoising", {"strength_dn": 20.0}), ("sharpening", {"amount": 1.0})


def images_by_place(others, rng=None, v=None):
    """Return the grey levels of an image by the curve's place, 0 to 2, beside other effects."""
    v = v or view(noise_dn=1.0)
    radiance = cv2.GaussianBlur(noise_image(1, v, high=1.0), (0, 0), 3)
    radiance = 3 * (radiance - radiance.mean()) + 0.3
    for place in (0, 1, 2):
        curve = ("tone_curve", parameters("tone_curve", **CURVE, place=place))
        yield pipeline.photometric(radiance[..., None], v, [curve, *others], rng and rng(3))[FRAME]


@pytest.mark.parametrize("rng", [None, np.random.default_rng])
def test_a_curve_acts_in_its_place(rng):
    """Fails if a place were not heeded, or made a difference where nothing lies between two of them."""
    first, between, last = images_by_place([SMOOTH, SHARP], rng)
    assert min(np.abs(a - b).max() for a, b in ((first, between), (first, last), (between, last))) > 1
    alone = list(images_by_place([("jpeg_compression", {"loss": 20.0})], rng))
    np.testing.assert_array_equal(alone[0], alone[1])
    np.testing.assert_array_equal(alone[0], alone[2])
    beside_one = list(images_by_place([SHARP], rng))
    np.testing.assert_array_equal(beside_one[0], beside_one[1])
    assert np.abs(beside_one[0] - beside_one[2]).max() > 1


@pytest.mark.parametrize("place", [0, 1, 2])
def test_an_expected_image_follows_the_curve_s_place(place):
    """Fails if what sharpening throws beyond white were cut off before noise, which takes half of it back, is minded."""
    v = view(noise_dn=2.0)
    radiance = np.where(np.arange(v.width + 2 * v.margin) % 24 < 12, 0.02, 0.96).astype(np.float32)
    radiance = np.repeat(radiance[None, :, None], v.height + 2 * v.margin, axis=0)
    chosen = [("tone_curve", parameters("tone_curve", **CURVE, place=place)), ("sharpening", {"amount": 0.8})]
    expected = pipeline.expected_levels(radiance, v, chosen)[FRAME].mean(axis=0)
    random = np.random.default_rng(8)
    taken = [np.clip(pipeline.photometric(radiance, v, chosen, random), 0, 255)[FRAME].mean(axis=0) for _ in range(20)]
    assert np.abs(expected - np.mean(taken, axis=0)).max() < 0.5


def test_a_place_that_makes_no_difference_is_no_other_twin():
    """Fails if a search compared places between which nothing lies, or took two different images for one."""
    curves = [("tone_curve", parameters("tone_curve", **CURVE, place=place)) for place in (0, 1, 2)]
    assert len({pipeline.key_of([curve, ("jpeg_compression", {"loss": 20.0})]) for curve in curves}) == 1
    assert len({pipeline.key_of([curve, SHARP]) for curve in curves}) == 2
    assert len({pipeline.key_of([curve, SMOOTH, SHARP]) for curve in curves}) == 3
    assert pipeline.key_of([("tone_curve", parameters("tone_curve", place=2))]) == ()


def test_colour_only_where_there_is_colour():
    """Grey images stay one channel; balance and mosaic make three; the frame has no margin."""
    v = view()
    radiance = np.full((v.height + 2 * v.margin, v.width + 2 * v.margin), 0.3)
    assert pipeline.form_image(radiance, v, [("lens_blur", {"sigma_px": 1.0})], None).shape == (140, 200, 1)
    warm = pipeline.form_image(radiance, v, [("colour_balance", {"red_gain": 1.2})], None)
    assert warm.shape == (140, 200, 3)
    assert warm[0, 0, 0] == pytest.approx(float(encoding.encode(np.float32([0.36]), "srgb")[0]), abs=0.01)
    assert warm[0, 0, 1] == warm[0, 0, 2]


@pytest.mark.parametrize("name", [n for n, m in FOUND.items() if hasattr(m, "apply")])
def test_images_stay_single_precision(name):
    """The next effect's filter may take no other: OpenCV's bilateral filter ends with an error."""
    v = view()
    known = FOUND[name].PARAMETERS
    starts = {k: min(value + 0.01, known[k].upper) for k, value in library.starts_of(name)[0].items()}
    out = FOUND[name].apply(noise_image(3, v), v, starts, np.random.default_rng(1))
    assert out.dtype == np.float32


@pytest.mark.parametrize("corrected", [0.0, 1.0])
def test_a_mosaic_keeps_what_is_linear(corrected):
    """Interpolation reproduces planes of colours that rise together; a wrong kernel or mask does not."""
    v = view(margin=4)
    rows, columns = v.height + 2 * v.margin, v.width + 2 * v.margin
    y, x = np.mgrid[:rows, :columns].astype(np.float32)
    plane = 0.2 + 0.3 * x / columns + 0.2 * y / rows
    image = np.stack([plane, plane + 0.1, plane - 0.1], axis=-1).astype(np.float32)
    module = library.effect_named("bayer_demosaic")
    for name in module.RED:
        p = dict.fromkeys(module.PARAMETERS, 0.0) | {name: 1.0, "corrected": corrected}
        inner = module.apply(image, v, p, None)[4:-4, 4:-4]
        np.testing.assert_allclose(inner, image[4:-4, 4:-4], atol=2e-5)
