"""A photograph's twin is compressed with the tables and the sampling of the photograph's own file."""

import cv2
import numpy as np
import pandas as pd
import pytest
from PIL import Image

from declared_effects import declared_of
from effects import library
from effects.base import View
from effects.jpeg_compression import _gains_of_means
from effects.pipeline import photometric
from effects.quantisation import BLOCK, COSINES, COSINES_BACK
from inputs import tables
from inputs.photo_facts import photo_facts

NOISE = np.random.default_rng(0).integers(0, 255, (64, 80, 3)).astype(np.uint8)
PIXELS = cv2.GaussianBlur(NOISE, (0, 0), 1.5)
FLAT = [[24] * 64, [40, *[12] * 63]]  # no quality of libjpeg has such tables
SAMPLINGS = {
    "4:2:2": cv2.IMWRITE_JPEG_SAMPLING_FACTOR_422,
    "4:4:0": cv2.IMWRITE_JPEG_SAMPLING_FACTOR_440,
    "4:1:1": cv2.IMWRITE_JPEG_SAMPLING_FACTOR_411,
}


def declared(path, tmp_path):
    """Return the effects that a file says, by way of the table of files."""
    row = photo_facts(path) | {"capture": "a"}
    files = pd.DataFrame([row], columns=list(tables.FILES.columns))
    files = files.astype({"jpeg_quality": "Int64", "orientation": "Int64"})
    tables.write_table(files, tmp_path / "files.csv", tables.FILES)
    return declared_of(tmp_path / "files.csv")["a"]


def twin_of(pixels, effects):
    """Return the grey levels of pixels (H, W, C) with effects as they are laid on a finished image."""
    height, width, _ = pixels.shape
    view = View(np.eye(3), width, height, 0, np.eye(4), "c", "a", "a", 1.0, "linear", 0.0)
    rng = np.random.default_rng(0)
    return photometric(pixels.astype(np.float32) / 255, view, list(effects), rng).astype(float)


@pytest.mark.parametrize(("sampling", "name"), [(0, "4:4:4"), (1, "4:2:2"), (2, "4:2:0")])
def test_a_twin_has_the_tables_of_its_own_file(sampling, name, tmp_path):
    """Fails if the nearest quality stands for a camera's own tables, or tables change places or order on the way."""
    Image.fromarray(PIXELS).save(tmp_path / "a.jpg", qtables=FLAT, subsampling=sampling)
    assert photo_facts(tmp_path / "a.jpg")["jpeg_sampling"] == name
    with Image.open(tmp_path / "a.jpg") as image:
        np.testing.assert_array_equal(twin_of(PIXELS, declared(tmp_path / "a.jpg", tmp_path)), np.asarray(image))


def test_a_grey_twin_has_the_one_table_of_its_file(tmp_path):
    """Fails if a grey photograph needs a table of colour, or has lost its own."""
    grey = PIXELS[..., :1]
    Image.fromarray(grey[..., 0]).save(tmp_path / "a.jpg", qtables=FLAT[:1])
    with Image.open(tmp_path / "a.jpg") as image:
        shown = np.asarray(image)
    np.testing.assert_array_equal(twin_of(grey, declared(tmp_path / "a.jpg", tmp_path))[..., 0], shown)


def sampled(path, pixels, sampling):
    """Write pixels as a JPEG of libjpeg's quality 50 with a sampling that Pillow's encoder may not have."""
    options = [cv2.IMWRITE_JPEG_QUALITY, 50, cv2.IMWRITE_JPEG_SAMPLING_FACTOR, SAMPLINGS[sampling]]
    cv2.imwrite(str(path), pixels[..., ::-1], options)


@pytest.mark.parametrize("size", [(64, 80), (61, 75)], ids=["whole blocks", "cut blocks"])
@pytest.mark.parametrize("sampling", list(SAMPLINGS))
def test_colour_stored_for_several_pixels_is_as_libjpeg_stores_it(sampling, size, tmp_path):
    """Fails if libjpeg's tables hide a sampling that no quality has, rows are halved for columns, colour for two pixels is
    stored for four, or an image's edge is filled up otherwise.
    """
    pixels = np.ascontiguousarray(PIXELS[: size[0], : size[1]])
    sampled(tmp_path / "a.jpg", pixels, sampling)
    facts = photo_facts(tmp_path / "a.jpg")
    assert (facts["jpeg_sampling"], facts["jpeg_tables"]) == (sampling, "libjpeg")
    with Image.open(tmp_path / "a.jpg") as image:
        np.testing.assert_array_equal(twin_of(pixels, declared(tmp_path / "a.jpg", tmp_path)), np.asarray(image))


def test_what_a_quality_says_is_said_by_it_alone(tmp_path):
    """Fails if photographs with libjpeg's own tables, or with none, get another twin than their quality's."""
    Image.fromarray(PIXELS).save(tmp_path / "a.jpg", quality=80)
    ((name, said),) = declared(tmp_path / "a.jpg", tmp_path)
    assert said == library.nulls_of(name) | {"loss": 20.0}
    Image.fromarray(PIXELS).save(tmp_path / "a.png")
    assert declared(tmp_path / "a.png", tmp_path) == []


def noisy_mean(module, view, said):
    """Return the mean levels of 200 noisy twins of PIXELS."""
    noise = np.random.default_rng(1)
    noisy = [PIXELS + view.noise_dn * noise.standard_normal(PIXELS.shape) for _ in range(200)]
    return np.mean([module.apply(levels.astype(np.float32), view, said, noise) for levels in noisy], axis=0)


def rms_off(module, view, said, mean):
    """Return by how much expected levels are off a mean."""
    return np.sqrt(np.mean((module.apply(PIXELS.astype(np.float32), view, said, None) - mean) ** 2))


VIEW = View(np.eye(3), 80, 64, 0, np.eye(4), "c", "a", "a", 1.0, "linear", 3.0)


def test_expected_levels_know_own_tables(tmp_path):
    """Fails if what a fit expects has the nearest quality's tables: a mean of noisy twins then lies elsewhere."""
    Image.fromarray(PIXELS).save(tmp_path / "a.jpg", qtables=FLAT, subsampling=0)
    ((name, said),) = declared(tmp_path / "a.jpg", tmp_path)
    module = library.effect_named(name)
    mean = noisy_mean(module, VIEW, said)
    nearest = {key: value for key, value in said.items() if key != "own"}
    assert rms_off(module, VIEW, said, mean) < 0.5 * rms_off(module, VIEW, nearest, mean)


@pytest.mark.parametrize("sampling", list(SAMPLINGS))
def test_expected_levels_know_the_sampling(sampling, tmp_path):
    """Fails if a fit expects colour stored for one or two pixels as if for four (off by 6), an edge that is filled up otherwise
    (4:1:1: 1.5), colour between pixels where a decoder repeats it, or means whose halves go down (4:4:0: 0.85).
    """
    sampled(tmp_path / "a.jpg", PIXELS, sampling)
    ((name, said),) = declared(tmp_path / "a.jpg", tmp_path)
    module = library.effect_named(name)
    assert rms_off(module, VIEW, said, noisy_mean(module, VIEW, said)) < 0.7


@pytest.mark.parametrize("factors", [(2, 1), (1, 2), (4, 1), (2, 2)])
def test_noise_of_stored_colour_is_that_of_means(factors):
    """Fails if noise that is alike along rows counts as alike along columns, or as white, where colour is a mean of pixels."""
    (across, down), rng, row = factors, np.random.default_rng(2), np.zeros((5, 5))
    row[2] = np.array([1, 2, 3, 2, 1]) / 19**0.5
    gain, gains = _gains_of_means(row, across, down)
    white = rng.standard_normal((4000, BLOCK * down, BLOCK * across + 4))
    noise = sum(row[2, k] * white[..., k : k + BLOCK * across] for k in range(5))
    means = noise.reshape(-1, BLOCK, down, BLOCK, across).mean((2, 4))
    np.testing.assert_allclose((COSINES @ means @ COSINES_BACK).std(0), gain * gains, rtol=0.06)
