"""How well photographs' patches are told from their twins' (tests/bench/told_apart.py)."""

import sys
from pathlib import Path

import cv2
import numpy as np
import pytest

sys.path.insert(0, str(Path(__file__).parent / "bench"))

from told_apart import FEATURES, PATCH_PX, auc, features_of, patches_of  # noqa: E402


def noisy_squares(seed, number, blur=0.0):
    """Return patches (number, 32, 32, 3) of an edge somewhere, blurred, with noise."""
    rng, out = np.random.default_rng(seed), []
    for _ in range(number):
        image = np.full((PATCH_PX, PATCH_PX, 3), 200.0)
        image[:, rng.integers(6, 26) :] = 40
        out.append((cv2.GaussianBlur(image, (0, 0), blur) if blur else image) + rng.normal(0, 2, image.shape))
    return np.array(out)


def test_the_same_kind_of_patches_is_not_told_apart():
    """Fails if the area counts what the model was shown, or scores of the two are turned round."""
    assert auc(*(noisy_squares(k, 150) for k in range(4))) == pytest.approx(0.5, abs=0.08)


def test_a_blur_is_told_on_patches_never_seen():
    """Fails if features see no edges, or an area below one half comes out."""
    assert auc(noisy_squares(0, 80, 1.2), noisy_squares(1, 80), noisy_squares(2, 80, 1.2), noisy_squares(3, 80)) > 0.95


def test_features_are_finite_and_as_many_as_their_names():
    """Fails if a flat patch, or a twin without noise, divides by zero."""
    flat = np.full((2, PATCH_PX, PATCH_PX, 3), 255.0)
    assert features_of(flat).shape == (2, len(FEATURES)) and np.isfinite(features_of(flat)).all()


def test_patches_lie_inside_and_keep_their_pixels():
    """Fails if rows and columns of the grid are exchanged, or a patch reaches out of the board."""
    rows, columns = np.indices((70, 100))
    image, inside = (1000.0 * rows + columns)[..., None], (columns >= 32) & (rows < 64)
    patches = patches_of(image, inside)
    assert patches.shape == (4, PATCH_PX, PATCH_PX, 3)
    assert [p[0, 0, 0] for p in patches] == [32, 64, 32032, 32064]
