"""What is measured in images whose values are known: flats and their noise, colours, and the floor of trials."""

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest
from drawn import grey_image, scene_and_view

from gap.bounds import MAX_FLOOR
from gap.fit.residuals import RHO_NOISE
from gap.fit.score import floors_of, group_gaps, robust_scatter
from gap.measure.capture import Codes, measure_colour
from gap.measure.regions import GROUND, SKY, WHITE, choose_regions, noise_features
from gap.observables import COLOUR_FEATURES, MIN_FLOOR, NOISE_FEATURES
from gap.problem import code_corners_world, encoding_table
from gap.select.search import Search
from rig.geometry import project

SHAPE = 240, 320
SQUARES = np.array([[x, y, x + 16, y + 16] for y in range(8, 216, 16) for x in range(8, 296, 16)], np.int64)


def white_noise(sd, seed):
    return np.random.default_rng(seed).normal(100, sd, SHAPE)


def noise_of(green, red=None, blue=None, classes=None):
    """Return ({feature: value}, {feature: standard error}) of an image, ground throughout unless classes say otherwise."""
    classes = np.full(SHAPE, GROUND, np.uint8) if classes is None else classes
    measured = noise_features(green, red, blue, classes, SQUARES)
    return [dict(zip(NOISE_FEATURES, values, strict=True)) for values in measured]


def test_noise_of_a_known_variance_is_measured_class_by_class():
    """Fails if differences are not halved, classes are mixed up or compared across, or a class without pixels has noise."""
    classes = np.full(SHAPE, GROUND, np.uint8)
    classes[150:] = WHITE
    image = np.where(classes == WHITE, 100 + white_noise(3.0, 1), white_noise(2.0, 2))
    value, error = noise_of(image, classes=classes)
    assert value["noise_ground"] == pytest.approx(np.log(4.0), abs=4 * error["noise_ground"])
    assert value["noise_white"] == pytest.approx(np.log(9.0), abs=4 * error["noise_white"])
    assert error["noise_white"] < 0.02
    assert np.isnan([value["noise_black"], value["noise_sky"], value["noise_colour"]]).all()


def test_white_noise_has_no_structure():
    """Fails if a ratio of variances lacks a factor: noise without correlation, blocks or stripes would then show some."""
    value, error = noise_of(white_noise(2.0, 3))
    for name in NOISE_FEATURES[4:12]:
        assert abs(value[name]) < 4 * error[name] < 0.3, name


def test_ground_that_a_codec_left_flat_tells_little_of_its_noise():
    """Fails if it counts to a tenth of a level how flat: that hangs on where the level lies between a codec's steps."""
    one_block_higher = np.where(np.arange(SHAPE[1]) // 8 == 5, 101.0, 100.0) + np.zeros(SHAPE)
    (flat, error), (noisy, of_noisy) = noise_of(one_block_higher), noise_of(white_noise(0.4, 3))
    assert flat["noise_ground"] < np.log(1 / 12) < noisy["noise_ground"]
    assert error["noise_ground"] == 1.0 and of_noisy["noise_ground"] < 0.02
    assert (
        np.isnan([flat[n] for n in NOISE_FEATURES[4:]]).all()
        and np.isfinite([noisy[n] for n in NOISE_FEATURES[4:12]]).all()
    )


def test_steps_between_blocks_show_as_blocks_of_their_direction():
    """Fails if x and y are swapped, steps are looked for beside the blocks' edges, or their square is not set against noise."""
    sd, half_step = 2.0, 1.5
    image = white_noise(sd, 4)
    steps = np.where(np.arange(SHAPE[1]) // 8 % 2, half_step, -half_step)
    before, error = noise_of(image)
    after, _ = noise_of(image + steps)
    risen = np.log((2 * sd**2 + (2 * half_step) ** 2) / (2 * sd**2))
    assert after["blocks_x"] == pytest.approx(risen, abs=4 * error["blocks_x"])
    assert after["blocks_y"] == pytest.approx(before["blocks_y"], abs=1e-9)
    assert after["stripes_row"] == pytest.approx(before["stripes_row"], abs=1e-9)


def test_offsets_of_columns_show_as_stripes_of_columns():
    """Fails if rows and columns are swapped, or a step of 16 pixels' mean is not weighed by their number."""
    sd, half_step, side = 2.0, 0.6, 16
    image = white_noise(sd, 5)
    offsets = np.where(np.arange(SHAPE[1]) % 2, half_step, -half_step)
    before, error = noise_of(image)
    after, _ = noise_of(image + offsets)
    step = (2 * half_step) ** 2
    risen = np.log((side * step + 2 * sd**2) / (step + 2 * sd**2))
    assert after["stripes_column"] == pytest.approx(risen, abs=4 * error["stripes_column"])
    assert after["stripes_row"] == pytest.approx(before["stripes_row"], abs=1e-9)
    assert abs(after["blocks_x"]) < 4 * error["blocks_x"]


def test_noise_of_colours_is_that_of_red_minus_blue_over_twice_the_greens():
    """Fails if another channel is taken for red or blue, or a common noise of all channels counts as colour."""
    green, red, blue = white_noise(2.0, 6), white_noise(3.0, 7), white_noise(1.0, 8)
    value, error = noise_of(green, red, blue)
    assert value["noise_colour"] == pytest.approx(np.log((9.0 + 1.0) / (2 * 4.0)), abs=4 * error["noise_colour"])
    assert noise_of(green, green, green)[0]["noise_colour"] < -8


def test_regions_are_the_squares_nearest_to_the_middle_of_their_cells():
    """Fails if a square holds another class, begins beside the blocks' middles, leaves its cell, or is found where none is."""
    classes = np.full(SHAPE, GROUND, np.uint8)
    classes[:48] = SKY
    classes[68, 20] = WHITE  # in the square that would be the nearest of the second row's first cell
    classes[96:144, 40:80] = WHITE  # the whole second cell of the third row
    classes[200, 100] = 0
    found = choose_regions(classes).reshape(2, 5, 8, 4)
    ground, sky = found
    assert not ground[0].any() and not sky[1:].any()
    assert sky[0, 0].tolist() == [8, 8, 24, 24]
    assert ground[1, 0].tolist() == [8, 72, 24, 88]
    assert ground[1, 1].tolist() == [56, 56, 72, 72]
    assert not ground[2, 1].any()
    for kind, regions in zip((GROUND, SKY), found, strict=True):
        for row, column in np.argwhere(regions.any(-1)):
            x0, y0, x1, y1 = regions[row, column]
            assert (x1 - x0, y1 - y0, x0 % 16, y0 % 16) == (16, 16, 8, 8)
            assert column * 40 <= x0 and x1 <= (column + 1) * 40 and row * 48 <= y0 and y1 <= (row + 1) * 48
            assert (classes[y0:y1, x0:x1] == kind).all()


def colour_of_plates(change_of):
    """Return [{feature: value}] of two plates in an image whose red and green are changed alike and oppositely: its mean is
    the blue.

    change_of  function of (scene, view, sign) that returns both as they are drawn
    """
    scene, view = scene_and_view()
    table = encoding_table("linear", 1.0)
    codes = Codes.of(scene.plates, [scene.white, scene.black, scene.ground], table)
    image = np.stack([grey_image(*change_of(scene, view, sign), table) for sign in (1, -1, 0)], axis=-1)
    corners = project(view.K, view.T_cam_world, np.array([code_corners_world(p) for p in scene.plates]))
    colour = measure_colour(image.astype(np.float32), corners, np.array([True, True]), codes)
    assert not measure_colour(image[..., :1], corners, np.array([True, True]), codes).any()
    return [dict(zip(COLOUR_FEATURES, values, strict=True)) for values in colour]


def test_red_that_is_brighter_in_white_is_measured_in_grey_levels():
    """Fails if levels are mixed up with one another, channels are swapped, or grey levels are not what is returned."""

    def brighter(scene, view, sign):
        return scene.with_(white=scene.white + sign * 5 / 255), view

    for colour in colour_of_plates(brighter):
        assert colour.pop("red_white") == pytest.approx(5.0, abs=0.05)
        assert np.abs(list(colour.values())).max() < 0.05


@pytest.mark.parametrize(("axis", "along", "across"), [(0, "dx", "dy"), (1, "dy", "dx")])
def test_red_that_is_shifted_is_measured_as_a_shift(axis, along, across):
    """Fails if a shift has the wrong sign or axis, is shared out among the four corners, or passes for a level."""

    def shifted(scene, view, sign):
        K = view.K.copy()
        K[axis, 2] += 0.2 * sign
        return scene, replace(view, K=K)

    # A sharp edge that lies at f of its pixel has the slope 1 there and, by central differences, f / 2, 1 / 2, (1 - f) / 2
    # about it. A fit of these to that, over all f, has the coefficient (1 / 2) / (1 / 4 + 1 / 6).
    of_sharp_edges = 1.2
    for colour in colour_of_plates(shifted):
        assert colour.pop(f"red_{along}") == pytest.approx(of_sharp_edges * 0.2, rel=0.1)
        assert abs(colour.pop(f"red_{across}")) < 0.06 and abs(colour.pop(f"blue_{along}")) < 0.02
        assert np.abs(list(colour.values())).max() < 1.0


def trials(measured, stations=None):
    """Return a case of captures, of one station unless stations say otherwise, whose plates were measured as given."""
    stations = stations or ["s"] * len(measured)
    return SimpleNamespace(
        captures=[
            SimpleNamespace(view=SimpleNamespace(station=s), observation=SimpleNamespace(measured=np.array(m)))
            for s, m in zip(stations, measured, strict=True)
        ]
    )


@pytest.mark.parametrize(
    ("apart", "floor"),
    [
        (0.01, MIN_FLOOR["field"]),
        (1.0, np.sqrt(8 * np.log(1 + 1 / 8) / RHO_NOISE)),
        (50.0, MAX_FLOOR),
    ],
)
def test_the_floor_is_how_far_trials_lie_apart(apart, floor):
    """Fails if what the twin lacks of both trials counts, differences of two are not scaled to one, or no bound holds."""
    lacking = np.linspace(-9, 9, 80)
    groups = {0: {"field": lacking}, 1: {"field": lacking + apart * np.sqrt(2) * np.resize([1, -1], 80)}}
    assert floors_of(trials([[True], [True]]), groups) == pytest.approx({"field": floor})


def test_trials_of_unit_noise_have_a_floor_of_one():
    """Fails if the robust loss is not set against that of a unit normal."""
    rng = np.random.default_rng(9)
    groups = {k: {"noise": 3.0 + rng.normal(size=20_000)} for k in range(3)}
    assert floors_of(trials([[True]] * 3), groups)["noise"] == pytest.approx(1.0, abs=0.02)


def test_only_plates_that_both_trials_show_have_a_floor():
    """Fails if the rows of different plates are subtracted: each has residuals of its own, the same in every trial."""
    own = np.arange(3.0)[:, None] * np.ones(20) * 30
    groups = {0: {"edges": own[[0, 1]]}, 1: {"edges": own[[1, 2]]}}
    floors = floors_of(trials([[True, True, False], [False, True, True]]), groups)
    assert floors == {"edges": MIN_FLOOR["edges"]}


@pytest.mark.parametrize(("stations", "count"), [(["a", "b"], 80), (["a", "a"], 19)])
def test_without_trials_or_with_too_few_values_there_is_no_floor(stations, count):
    """Fails if captures of different stations are compared, or a handful of values makes a floor."""
    groups = {k: {"field": np.full(count, float(k))} for k in range(2)}
    assert floors_of(trials([[True], [True]], stations), groups) == {}


@pytest.mark.parametrize(("own_noise", "raised"), [(2.0, True), (0.5, False)])
def test_floors_rise_to_a_twins_own_scatter_where_its_noise_is_like_the_real_one_as_far_as_noise_tells(
    own_noise, raised
):
    """Fails if noise that a codec lets scatter keeps a right twin at the floors of repeats, or if a wrong one's rise."""
    real = {0: {"corners": np.full(40, 2.0), "noise": np.full(10, 2.5)}}
    own = {0: {"corners": np.full(40, 2.0), "noise": np.full(10, own_noise)}}
    search = SimpleNamespace(
        problem=SimpleNamespace(floors_of=lambda groups: {"corners": MAX_FLOOR}),
        solver=SimpleNamespace(each=lambda function, indices: own),
        train=[0],
    )
    floors = Search.floors_at(search, (), np.zeros((1, 6)), real)
    assert (floors["corners"] > MAX_FLOOR) == raised
    assert ("noise" in floors) == raised


def test_a_twin_that_is_right_but_for_the_scatter_of_photographs_has_a_gap_of_one():
    """Fails if floors of signs count outliers otherwise than gaps do: a set that hands shook stays open whatever is named."""
    values = 7.0 + np.random.default_rng(4).standard_t(3, 300) * 0.2
    scale = robust_scatter(np.append(values, np.nan), 0.01)
    groups = {0: {"edges": (values - np.median(values)) / scale}}
    assert group_gaps(groups, {})["edges"] == pytest.approx(1.0, abs=0.01)
    assert robust_scatter(values, 2.0) == 2.0 and robust_scatter(np.full(9, 3.0), 0.01) == 0.01


def test_what_photographs_scatter_by_does_not_leap():
    """Fails if one of a score of photographs makes all of them count twice as much, as it does by their median deviation."""
    values = np.array([-2.0] * 5 + [-1.0] * 5 + [0.0] + [1.0] * 4 + [2.0] * 6)
    moved = np.where(np.arange(21) == 15, 1.0, values)
    deviations = [np.median(np.abs(v)) for v in (values, moved)]
    assert deviations == [2.0, 1.0]
    assert robust_scatter(moved, 0.01) == pytest.approx(robust_scatter(values, 0.01), rel=0.05)
