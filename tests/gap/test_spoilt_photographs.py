"""A finger, a lamp's reflection, a hard shadow or moire on photographs of a board: they get no name, and hide none."""

import cv2
import numpy as np
import pytest
from test_signature_case import FEW, NOISE, NOISE_OF_TWIN

import retaken_board
from gap.select_effects import verdict
from retaken_board import signatures_of, taken

SKIN, REFLECTED_DN, SHADE = (190, 140, 115), 200, 0.35
PLACES = ((60, 200), (250, 190), (160, 30), (70, 60))
COLOURS_OF_STRIPES = np.cos([0, 2, 4])


def pixels_of(image):
    """Return x and y (H, W) of an image's pixels."""
    return np.meshgrid(np.arange(image.shape[1]), np.arange(image.shape[0]))


def behind_a_finger(image, k):
    """Return photograph k with a fingertip over some cells at its border."""
    over = np.zeros(image.shape[:2], np.float32)
    cv2.ellipse(over, PLACES[k % 4], (16, 40), 20 * k, 0, 360, 1.0, -1)
    over = cv2.GaussianBlur(over, (0, 0), 1.0)[..., None]
    return image * (1 - over) + np.array(SKIN) * over


def with_a_reflection(image, k):
    """Return photograph k with a lamp's glossy reflection on the board, cut off in its middle."""
    (x, y), place = pixels_of(image), np.array([(120, 110), (200, 150), (160, 80), (140, 140)][k % 4])
    return image + REFLECTED_DN * np.exp(-((x - place[0]) ** 2 + (y - place[1]) ** 2) / 2 / 14**2)[..., None]


def in_a_hard_shadow(image, k):
    """Return photograph k with a shadow on half of the board, its border 10 px wide."""
    x, y = pixels_of(image)
    across = (x - image.shape[1] / 2) * np.cos(k) + (y - image.shape[0] / 2) * np.sin(k)
    return image * (1 - SHADE / (1 + np.exp(-across / 3)))[..., None]


def with_moire(image, k):
    """Return photograph k with coloured stripes 2.4 to 3.3 px wide, as a screen's pixels beat with a sensor's."""
    (x, y), angle, width_px = pixels_of(image), 0.3 + 0.4 * k, 2.4 + 0.3 * (k % 4)
    stripes = np.sin(2 * np.pi / width_px * (np.cos(angle) * x + np.sin(angle) * y))
    return image * (1 + 0.04 * stripes[..., None] * COLOURS_OF_STRIPES)


SPOILT = {behind_a_finger: 3, with_a_reflection: 3, in_a_hard_shadow: 3, with_moire: 1}  # every so many photographs


@pytest.mark.parametrize("laid", [{}, {"sensor_noise": NOISE}], ids=["nothing", "noise"])
@pytest.mark.parametrize("spoil", SPOILT, ids=lambda spoil: spoil.__name__)
def test_what_lies_on_a_board_gets_no_name(monkeypatch, spoil, laid):
    """Fails if noise is told by white alone, without its grain, its colours and black's: stripes then pass for it."""

    def spoilt(case, k, effects, printed=()):
        image = taken(case, k, effects, printed)
        return image if k % SPOILT[spoil] else np.clip(np.rint(spoil(image, k)), 0, 255).astype(np.uint8)

    monkeypatch.setattr(retaken_board, "taken", spoilt)
    _, _, _, outcome = verdict(signatures_of(laid), candidates=FEW)
    assert [step.effect for step in outcome.steps] == list(laid)
    for _, found in outcome.twin.effects:
        assert found["gain_dn_per_e"] == pytest.approx(NOISE_OF_TWIN["gain_dn_per_e"], rel=0.3)
