"""The light of a photograph by its board's own white and black, of boards drawn here by a formula of the test's own."""

import numpy as np
import pytest

from effects.base import Scene
from gap.boards.capture_light import light_of, photograph_light, seen_places
from inputs.campaign import CalibrationBoard
from rig.light import LIGHT, BoardPlace, free_numbers, lit
from rig.targets import target_plate

BOARD = CalibrationBoard.model_validate({"type": "chessboard", "columns": 8, "rows": 6, "square_m": 0.03})
PLATE = target_plate(BOARD)
WHITE, BLACK = 0.9, 0.05
EVERYTHING = free_numbers(("light", "exposure", "white_balance", "reflectance"))


def photograph(px_a_square):
    """Return (linear image (H, W, 3), points (p, 3), pixels (p, 2)) of a board seen straight on, under a lamp to its right."""
    x_px, y_px = (int(n * px_a_square) for n in (BOARD.columns + 1, BOARD.rows + 1))
    column, row = np.meshgrid(np.arange(x_px), np.arange(y_px))
    is_white = (column // px_a_square + row // px_a_square) % 2 == (0 if PLATE.white[-2, 1] else 1)
    across = (column - x_px / 2) / (x_px / 2)
    light = (
        0.5
        * np.exp(0.3 * across + 0.04 * across**2)[..., None]
        * [0.8, 1.0, 1.3]
        * np.where(is_white, WHITE, BLACK)[..., None]
    )
    xy = np.array([[x, y] for y in range(1, BOARD.rows + 1) for x in range(1, BOARD.columns + 1)])
    pixels = np.column_stack([xy[:, 0], BOARD.rows + 1 - xy[:, 1]]) * px_a_square - 0.5
    return light + [0.02, 0.03, 0.04], np.column_stack([xy * BOARD.square_m, 0 * xy[:, 0]]), pixels


def test_a_lamp_beside_the_board_is_found():
    """Fails if slope, curvature, colour or stray light go to one another, or a place's colour is read of the wrong cell."""
    image, points, pixels = photograph(24)
    image = image + 0.005 * np.random.default_rng(1).standard_normal(image.shape)
    image[60:110, 60:120] = 0.9  # a finger, or a reflection
    shown, white, xy = seen_places(PLATE, points, pixels, image)
    assert len(shown) > 500 and 0.3 < white.mean() < 0.7
    place = BoardPlace(PLATE)
    found = light_of(shown, np.where(white, WHITE, BLACK), *place(*xy.T), EVERYTHING)
    X = np.linspace(-0.8, 0.8, 9)
    made = lit(np.full((1, 9, 1), WHITE), found, X[None], 0 * X[None])[0]
    paper = PLATE.x_m[-1] - PLATE.x_m[0]
    across = X * (paper / 2) / ((BOARD.columns + 1) * BOARD.square_m / 2)
    truth = WHITE * 0.5 * np.exp(0.3 * across + 0.04 * across**2)[:, None] * [0.8, 1.0, 1.3] + [0.02, 0.03, 0.04]
    np.testing.assert_allclose(made, truth, rtol=0.02)
    black = lit(np.full((1, 1, 1), BLACK), found, np.zeros((1, 1)), np.zeros((1, 1)))[0, 0]
    np.testing.assert_allclose(black, 0.5 * BLACK * np.array([0.8, 1.0, 1.3]) + [0.02, 0.03, 0.04], atol=0.004)


@pytest.mark.parametrize("key", ["light", "exposure", "white_balance", "reflectance"])
def test_what_is_declared_stays(key):
    """Fails if a campaign that declares its exposure or its lamps has them estimated all the same."""
    image, points, pixels = photograph(24)
    shown, white, xy = seen_places(PLATE, points, pixels, image)
    free = free_numbers([key])
    assert free.any() and not free.all()
    found = light_of(shown, np.where(white, WHITE, BLACK), *BoardPlace(PLATE)(*xy.T), free)
    assert (found[~free] == 0).all() and (found[free] != 0).any()


def twin_of(image, camera):
    """Return the function LIGHT -> what a camera, itself a function of radiance, makes of the board of ``photograph(24)``."""
    place, (height, width) = BoardPlace(PLATE), image.shape[:2]
    across, up = ((np.arange(n) + 0.5 - n / 2) / 24 * BOARD.square_m / place.half_size for n in (width, height))
    X, Y = np.meshgrid(across, -up)
    reflectance = np.where(image[..., 1] > 0.2, WHITE, BLACK)[..., None]
    return lambda light: camera(lit(reflectance, light, X, Y))


def lights_of(camera):
    """Return (twin, its camera's photograph, LIGHTs: as it is, as found without a twin, behind it) of the board."""
    image, points, pixels = photograph(24)
    twin, scene, lut = twin_of(image, camera), Scene((PLATE,), WHITE, BLACK, 0.3, 0.3), np.linspace(0, 1, 1001)
    asked = (image, None), (camera(image), None), (camera(image), twin)
    lights = [photograph_light(shown, scene, points, pixels, lut, EVERYTHING, by) for shown, by in asked]
    return twin, camera(image), *lights


def test_what_a_twin_does_to_levels_is_no_light():
    """Fails if a vignetting and a glare that a twin has are found again as the photograph's light: both would be shown twice."""
    height, width, _ = photograph(24)[0].shape
    r2 = (
        ((np.stack(np.meshgrid(np.arange(width), np.arange(height)), -1) - [width / 2, height / 2]) / width * 2) ** 2
    ).sum(-1)
    _, _, truth, alone, behind = lights_of(lambda radiance: 0.1 + 0.9 * (radiance * (1 - 0.5 * r2[..., None])) ** 0.8)
    assert np.abs(alone - truth).max() > 0.1 > 10 * np.abs(behind - truth).max()


@pytest.mark.parametrize(
    "camera",
    [
        lambda radiance: np.clip(1.1 * radiance - 0.06, 0, 1),
        lambda radiance: np.clip(radiance, 0, 1) ** 2.2,
        lambda radiance: np.clip(2.0 * radiance, 0, 1),
    ],
    ids=["black cut off", "a steep curve", "white cut off"],
)
def test_a_light_that_was_known_is_not_lost_behind_a_twin(camera):
    """Fails if a twin that cuts off black or white ends the search for its light, or leads it away from what was there."""
    twin, shown, _, alone, behind = lights_of(camera)
    before, after = (np.abs(twin(light) - shown).mean() for light in (alone, behind))
    assert after < 0.6 * before


def test_a_grey_photograph_has_a_light_without_colour():
    """Fails if photographs of one channel end in a traceback, or in a coloured light."""
    image, points, pixels = photograph(24)
    shown, white, xy = seen_places(PLATE, points, pixels, image[..., 1:2])
    found = light_of(shown, np.where(white, WHITE, BLACK), *BoardPlace(PLATE)(*xy.T), EVERYTHING)
    np.testing.assert_allclose(
        [found[LIGHT.index(n)] for n in ("red", "blue", "stray_red", "stray_blue")], 0, atol=1e-3
    )
    assert found[0] == pytest.approx(np.log(0.5), abs=0.03)


def test_a_board_that_is_hardly_seen_has_no_light():
    """Fails if a light is made up of a handful of pixels."""
    image, points, pixels = photograph(2)
    shown, white, xy = seen_places(PLATE, points, pixels, image)
    with pytest.raises(ValueError, match="too little white or black"):
        light_of(shown, np.where(white, WHITE, BLACK), *BoardPlace(PLATE)(*xy.T), EVERYTHING)
    pixels[5:] = np.nan
    assert len(seen_places(PLATE, points, pixels, image)[0]) == 0


def test_no_light_of_its_own_leaves_the_render_as_it_is():
    """Fails if the nominal light is not LIGHT's zero."""
    radiance = np.random.default_rng(2).uniform(0, 1, (4, 5, 1)).astype(np.float32)
    np.testing.assert_array_equal(
        lit(radiance, np.zeros(len(LIGHT)), np.ones((4, 5)), np.ones((4, 5))), np.repeat(radiance, 3, 2)
    )
