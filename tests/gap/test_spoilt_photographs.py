"""A finger, a lamp's reflection, a hard shadow or moire on photographs of a board: they get no name, and hide none."""

import cv2
import numpy as np
import pytest
from drawn_board import K
from test_signature_case import FEW, NOISE, NOISE_OF_TWIN

import retaken_board
from gap.boards.photographs import expected_corners
from gap.select.select_effects import verdict
from retaken_board import POINTS, signatures_of, taken
from rig.geometry import project

SKIN, REFLECTED_DN, SHADE = (190, 140, 115), 200, 0.35
COLOURS_OF_STRIPES = np.cos([0, 2, 4])
EVERY = 3  # so many photographs have something on the board
COVERED = (0, 9)  # of the twelve patches of a photograph that are looked at: two of the six that a signature is made of


def pixels_of(image):
    """Return x and y (H, W) of an image's pixels."""
    return np.meshgrid(np.arange(image.shape[1]), np.arange(image.shape[0]))


def behind_fingers(image, k, places):
    """Return photograph k with fingertips on some patches."""
    over = np.zeros(image.shape[:2], np.float32)
    for x, y in places.round().astype(int).tolist():
        cv2.ellipse(over, (x, y), (10, 30), 20 * k, 0, 360, 1.0, -1)
    over = cv2.GaussianBlur(over, (0, 0), 1.0)[..., None]
    return image * (1 - over) + np.array(SKIN) * over


def with_reflections(image, k, places):
    """Return photograph k with a lamp's glossy reflection on some patches, cut off in its middle."""
    x, y = pixels_of(image)
    shine = sum(np.exp(-((x - u) ** 2 + (y - v) ** 2) / 2 / 10**2) for u, v in places)
    return image + REFLECTED_DN * shine[..., None]


def in_a_hard_shadow(image, k, places):
    """Return photograph k with a shadow on half of the board, its border 10 px wide."""
    x, y = pixels_of(image)
    across = (x - image.shape[1] / 2) * np.cos(k) + (y - image.shape[0] / 2) * np.sin(k)
    return image * (1 - SHADE / (1 + np.exp(-across / 3)))[..., None]


def with_moire(image, k, places):
    """Return photograph k with coloured stripes 2.4 to 3.3 px wide, as a screen's pixels beat with a sensor's."""
    (x, y), angle, width_px = pixels_of(image), 0.3 + 0.4 * k, 2.4 + 0.3 * (k % 4)
    stripes = np.sin(2 * np.pi / width_px * (np.cos(angle) * x + np.sin(angle) * y))
    return image * (1 + 0.04 * stripes[..., None] * COLOURS_OF_STRIPES)


@pytest.mark.parametrize("laid", [{}, {"sensor_noise": NOISE}], ids=["nothing", "noise"])
@pytest.mark.parametrize("spoil", [behind_fingers, with_reflections, in_a_hard_shadow, with_moire])
def test_what_lies_on_a_board_gets_no_name(monkeypatch, spoil, laid):
    """Fails if noise is told by white alone, without its grain, its colours and black's: stripes then pass for it; or if what is
    measured of a patch that shows something else counts.
    """

    def spoilt(case, k, effects, printed=()):
        image = taken(case, k, effects, printed)
        if k % EVERY and spoil is not with_moire:
            return image
        expected = expected_corners(POINTS, project(K, case.captures[k].view.T_cam_world, POINTS), case.patches)
        plates, _ = case.patches_seen(image.astype(np.float32), expected)
        places = expected[plates[list(COVERED)]].mean(1)
        return np.clip(np.rint(spoil(image, k, places)), 0, 255).astype(np.uint8)

    plain = signatures_of(laid).signs
    monkeypatch.setattr(retaken_board, "taken", spoilt)
    case = signatures_of(laid)
    assert (case.signs[0] != plain[0]).any()
    _, _, _, outcome = verdict(case, candidates=FEW)
    assert [step.effect for step in outcome.steps] == list(laid)
    for _, found in outcome.twin.effects:
        assert found["gain_dn_per_e"] == pytest.approx(NOISE_OF_TWIN["gain_dn_per_e"], rel=0.3)
