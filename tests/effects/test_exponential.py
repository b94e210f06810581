"""Compiled arithmetic of effects is what it stands for. Each test fails for the reason in its name."""

import cv2
import numpy as np
import pytest

from effects.denoising import DIAMETER_PX, bilateral
from effects.exponential import FLATTER, steep_exponential


def test_a_power_of_a_cubic_is_the_exponential():
    """Fails if the number of squarings or a coefficient's sign is another: a probability's tail may be off by 1e-5."""
    t = np.linspace(0, 24, 4001)
    power = np.array([steep_exponential(np.float32(x / FLATTER)) for x in t])
    np.testing.assert_allclose(power, np.exp(-t), atol=1e-5)


@pytest.mark.parametrize("strength_dn", [1.0, 8.0, 40.0])
def test_a_bilateral_filter_is_opencvs(strength_dn):
    """Fails if a neighbour is left out or has another's weight, or if what is faint or thin counts as even ground."""
    y, x = np.mgrid[:96, :128].astype(np.float32)
    image = 60 + 0.2 * x + 0.05 * y
    image[20:40, 20:60] += 100
    image[60:, 80:] += 0.5
    image[50, :] += 2
    image[80, 100] += 3
    image[:30, 90:] += np.random.default_rng(1).normal(0, 3, (30, 38)).astype(np.float32)
    own = bilateral(image, {"strength_dn": strength_dn, "reach_px": 1.5})
    np.testing.assert_allclose(own, cv2.bilateralFilter(image, DIAMETER_PX, strength_dn, 1.5), atol=0.01)
