"""A photograph's twin is compressed with the tables and the sampling of the photograph's own file."""

import cv2
import numpy as np
import pandas as pd
import pytest
from PIL import Image

from declared_effects import declared_of
from effects import library
from effects.base import View
from effects.pipeline import photometric
from inputs import tables
from inputs.photo_facts import photo_facts

NOISE = np.random.default_rng(0).integers(0, 255, (64, 80, 3)).astype(np.uint8)
PIXELS = cv2.GaussianBlur(NOISE, (0, 0), 1.5)
FLAT = [[24] * 64, [40, *[12] * 63]]  # no quality of libjpeg has such tables
SAMPLINGS = {"4:2:2": cv2.IMWRITE_JPEG_SAMPLING_FACTOR_422, "4:4:0": cv2.IMWRITE_JPEG_SAMPLING_FACTOR_440}


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


@pytest.mark.parametrize("sampling", list(SAMPLINGS))
def test_colour_in_half_one_way_is_not_in_half_both_ways(sampling, tmp_path):
    """Fails if libjpeg's tables hide a sampling that no quality has, or rows are halved for columns: then it is off by 5."""
    options = [cv2.IMWRITE_JPEG_QUALITY, 50, cv2.IMWRITE_JPEG_SAMPLING_FACTOR, SAMPLINGS[sampling]]
    _, data = cv2.imencode(".jpg", PIXELS[..., ::-1], options)
    (tmp_path / "a.jpg").write_bytes(data.tobytes())
    facts = photo_facts(tmp_path / "a.jpg")
    assert (facts["jpeg_sampling"], facts["jpeg_tables"]) == (sampling, "libjpeg")
    off = np.abs(twin_of(PIXELS, declared(tmp_path / "a.jpg", tmp_path)) - cv2.imdecode(data, 1)[..., ::-1])
    assert off.mean() < 1.5  # on its side an encoder rounds otherwise


def test_what_a_quality_says_is_said_by_it_alone(tmp_path):
    """Fails if photographs with libjpeg's own tables, or with none, get another twin than their quality's."""
    Image.fromarray(PIXELS).save(tmp_path / "a.jpg", quality=80)
    ((name, said),) = declared(tmp_path / "a.jpg", tmp_path)
    assert said == library.nulls_of(name) | {"loss": 20.0}
    Image.fromarray(PIXELS).save(tmp_path / "a.png")
    assert declared(tmp_path / "a.png", tmp_path) == []


def test_expected_levels_know_own_tables(tmp_path):
    """Fails if what a fit expects has the nearest quality's tables: a mean of noisy twins then lies elsewhere."""
    Image.fromarray(PIXELS).save(tmp_path / "a.jpg", qtables=FLAT, subsampling=0)
    ((name, said),) = declared(tmp_path / "a.jpg", tmp_path)
    module, noise = library.effect_named(name), np.random.default_rng(1)
    height, width, _ = PIXELS.shape
    view = View(np.eye(3), width, height, 0, np.eye(4), "c", "a", "a", 1.0, "linear", 3.0)
    noisy = [PIXELS + 3.0 * noise.standard_normal(PIXELS.shape) for _ in range(200)]
    mean = np.mean([module.apply(levels.astype(np.float32), view, said, noise) for levels in noisy], axis=0)
    nearest = {key: value for key, value in said.items() if key != "own"}
    own, other = (
        np.sqrt(np.mean((module.apply(PIXELS.astype(np.float32), view, p, None) - mean) ** 2)) for p in (said, nearest)
    )
    assert own < 0.5 * other
