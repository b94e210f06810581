"""What a photograph shows by itself of its compression: Pillow writes the files, the effect reads pixels alone."""

import io

import numpy as np
import pytest
from PIL import Image

from effects import jpeg_compression

FULL, HALF = {"subsampling": "4:4:4"}, {"subsampling": "4:2:0"}


def scene(noise_dn):
    """Return grey levels (240, 320, 3) of tilted dark squares on a bright ground, with edges a pixel wide, colours and noise."""
    y, x = np.mgrid[:240, :320].astype(float)
    u, v = 0.9 * x + 0.4 * y, -0.4 * x + 0.9 * y
    ink = 1 / (1 + np.exp(-2.5 * (5 * np.sin(u / 9) * np.sin(v / 11))))
    colours = np.array([0.9, 1.0, 1.1]) * (1 + 0.1 * np.sin(x / 40)[..., None])
    levels = (60 + 120 * ink)[..., None] * colours + np.random.default_rng(1).normal(0, noise_dn, (240, 320, 3))
    return np.clip(np.rint(levels), 0, 255).astype(np.uint8)


def photographed(pixels, quality, sampling):
    """Return the levels (H, W, C) of a file that Pillow wrote, and its table of brightness."""
    file = io.BytesIO()
    Image.fromarray(pixels).save(file, "JPEG", quality=quality, **sampling)
    with Image.open(file) as image:
        levels = np.asarray(image, np.float32)
        return levels.reshape(*levels.shape[:2], -1), sorted(image.quantization[0])


@pytest.mark.parametrize("quality", [30, 50, 70, 85, 92])
@pytest.mark.parametrize("noise_dn", [0.5, 2.0])
def test_a_quality_is_read_off_pixels(quality, noise_dn):
    """Fails if a block's grid is taken one pixel off, or a finer or coarser table passes for the file's."""
    levels, table = photographed(scene(noise_dn), quality, HALF)
    found = jpeg_compression.starts_from(levels)
    low = jpeg_compression.LOW_FREQUENCIES.T
    seen, true = (jpeg_compression.tables(int(q))[0][*low] for q in (100 - found["loss"], quality))
    assert sorted(jpeg_compression.tables(quality)[0].ravel()) == table
    assert np.array_equal(seen, true)  # 50 and 51 have the same


@pytest.mark.parametrize("quality", [50, 70, 85])
def test_colour_in_full_is_told_from_half(quality):
    """Fails if a start has the other way of colour, which costs a search of many effects its JPEG."""
    full, half = (
        jpeg_compression.starts_from(photographed(scene(1.0), quality, s)[0])["full_colour"] for s in (FULL, HALF)
    )
    assert (full, half) == (1, 0)


def test_grey_photographs_have_no_colour_to_tell():
    """Fails if planes of colour are asked for where there are none."""
    levels, _ = photographed(scene(1.0)[..., 1], 60, {})
    assert jpeg_compression.starts_from(levels) == {"loss": 40.0, "full_colour": 0.0}


def test_an_overexposed_photograph_shows_its_codec():
    """Fails if blocks count whose levels were clipped after decoding: where all edges are of white, none is seen."""
    pixels = np.clip(np.rint(1.5 * scene(1.0).astype(float) - 20), 0, 255).astype(np.uint8)
    levels, _ = photographed(pixels, 40, FULL)
    assert (levels == 255).any(2).mean() > 0.1
    assert jpeg_compression.starts_from(levels) == {"loss": 60.0, "full_colour": 1.0}


@pytest.mark.parametrize(
    "pixels", [scene(1.0), scene(1.0) // 8 * 8, np.full((64, 64, 3), 128, np.uint8), np.zeros((5, 7, 1), np.uint8)]
)
def test_steps_that_are_no_codecs_are_not_taken_for_one(pixels):
    """Fails if any image gets a start: plain noise, levels in steps of 8, one flat level, one smaller than a block."""
    assert jpeg_compression.starts_from(pixels.astype(np.float32)) is None


def test_what_was_filtered_after_shows_nothing():
    """Fails if a start is read off what no longer lies in steps: a scaled or shifted photograph."""
    levels, _ = photographed(scene(1.0), 70, HALF)
    assert jpeg_compression.starts_from(levels[3:, 5:]) is None
    assert jpeg_compression.starts_from((levels[:, 1:] + levels[:, :-1]) / 2) is None
