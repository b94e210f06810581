"""The warped image and the map of points are one geometry: corners go where the points go, within 0.02 px."""

import cv2
import numpy as np
import pytest
from effect_views import MARGIN, STRONG, scene, view

from effects import library, pipeline
from rig.errors import InputError

SIDE_PX = 16
SQUARES = [(30 + 45 * i + 0.37 * j, 22 + 40 * j + 0.29 * i) for i in range(4) for j in range(3)]  # top left corners
CHANNELS_OF = {"lateral_chromatic_aberration": (0, 2)}


def drawn(v):
    """Return black squares on white (exact coverage of axis-parallel squares), array with margin."""
    image = np.ones((v.height + 2 * v.margin, v.width + 2 * v.margin), np.float32)
    rows, columns = np.arange(image.shape[0]) - v.margin, np.arange(image.shape[1]) - v.margin

    def cover(pixels, start):
        low, high = np.maximum(pixels - 0.5, start), np.minimum(pixels + 0.5, start + SIDE_PX)
        return np.clip(high - low, 0, 1)

    for x, y in SQUARES:
        image -= np.outer(cover(rows, y), cover(columns, x)).astype(np.float32)
    return image


def outline(x, y, inset, n=33):
    """Return points (4, n, 2) along the left, top, right and bottom side, ``inset`` px away from the corners."""
    t = np.linspace(inset, SIDE_PX - inset, n)
    zero = np.zeros(n)
    sides = [(zero, t), (t, zero), (zero + SIDE_PX, t), (t, zero + SIDE_PX)]
    return np.array([np.stack([x + a, y + b], axis=1) for a, b in sides])


def crossing(lines):
    """Return the corner where an upright line x = a + b y meets a level one y = c + d x."""
    (a, b), (c, d) = lines
    y = (c + d * a) / (1 - d * b)
    return np.array([a + b * y, y])


def corners_of_points(points):
    """Return corners (4, 2) where straight lines fitted to the sides' points meet."""
    left, top, right, bottom = (
        np.polynomial.polynomial.polyfit(p[:, 1 - k], p[:, k], 1) for p, k in zip(points, (0, 1, 0, 1), strict=True)
    )
    return np.array([crossing(pair) for pair in ((left, top), (right, top), (right, bottom), (left, bottom))])


def corners_of_image(image, points):
    """Return corners (4, 2) where lines meet that are fitted to edges in the image near the expected sides.

    An edge's place in a row is where the darkness between the square's middle and 6 px outside ends: a sum, no model.
    """
    sides = []
    for k, side in enumerate(points):
        upright = k in (0, 2)
        plane = image if upright else image.T
        across, along = (0, 1) if upright else (1, 0)
        outward = -1 if k < 2 else 1
        found = []
        for row in range(int(np.ceil(side[:, along].min())), int(side[:, along].max()) + 1):
            middle = round(float(np.interp(row, side[:, along], side[:, across]))) - outward * (SIDE_PX // 2 - 1)
            steps = middle + outward * np.arange(SIDE_PX // 2 + 6)
            dark = (1 - plane[row + MARGIN, steps + MARGIN]).sum()
            found.append([row, middle + outward * (dark - 0.5)])
        found = np.array(found)
        sides.append(found[:, ::-1] if upright else found)
    return corners_of_points(sides)


@pytest.mark.parametrize("name", [n for n, m in library.available_effects().items() if hasattr(m, "map_points")])
def test_corners_go_where_the_points_go(name):
    """A fit by points would else end at other parameters than the twin's images show."""
    v, chosen = view(), [(name, STRONG[name])]
    image = pipeline.resample(drawn(v)[..., None], v, chosen)
    errors = []
    for channel in CHANNELS_OF.get(name, (1,)):
        moved = image[..., min(channel, image.shape[2] - 1)]
        for x, y in SQUARES:
            sides = outline(x, y, 3.0)
            points = pipeline.map_points(sides.reshape(-1, 2), v, chosen, channel).reshape(sides.shape)
            errors.append(corners_of_image(moved, points) - corners_of_points(points))
    errors = np.concatenate(errors)
    assert np.sqrt((errors**2).mean()) < 0.02
    assert np.abs(errors.mean(axis=0)).max() < 0.005


@pytest.mark.parametrize("name", list(STRONG))
def test_inverse_leads_back(name):
    """The one resampling looks where the points came from."""
    v, chosen = view(), [(name, STRONG[name])]
    xy = np.random.default_rng(2).uniform(-20, 160, (200, 2))
    for channel in (0, 1, 2):
        there = pipeline.map_points(xy, v, chosen, channel)
        np.testing.assert_allclose(pipeline.inverse_points(there, v, chosen, channel), xy, atol=1e-5)


@pytest.mark.parametrize("name", list(STRONG))
def test_points_follow_parameters_as_differences_say(name):
    """Fails if a closed derivative takes another axis or wave, or if what comes after an effect does not turn its moves."""
    v = view()
    rng = np.random.default_rng(2)
    xy = rng.uniform((0, 0), (v.width, v.height), (40, 2))
    chosen = [(n, library.nulls_of(n) | p) for n, p in STRONG.items()]
    keys = list(STRONG[name])
    step = 1e-6
    slopes = pipeline.points_by_parameters(xy, v, chosen, [(name, k) for k in keys], [step] * len(keys))
    for column, key in enumerate(keys):
        pair = [
            pipeline.map_points(xy, v, [(n, p | {key: p[key] + s * step}) if n == name else (n, p) for n, p in chosen])
            for s in (1, -1)
        ]
        expected = (pair[0] - pair[1]) / (2 * step)
        np.testing.assert_allclose(slopes[..., column], expected, rtol=1e-4, atol=1e-4 * np.abs(expected).max() + 1e-9)


def test_all_geometry_at_once_is_one_map():
    """Several effects compose in physical order whatever the list's order, and the image follows the composition."""
    v = view()
    chosen = [(n, STRONG[n]) for n in ("rolling_shutter", "principal_point", "radial_distortion", "focal_length")]
    xy = np.random.default_rng(3).uniform(0, 130, (50, 2))
    by_hand = xy
    for name in ("radial_distortion", "focal_length", "principal_point", "rolling_shutter"):
        by_hand = library.available_effects()[name].map_points(by_hand, v, STRONG[name], 1)
    np.testing.assert_array_equal(pipeline.map_points(xy, v, chosen), by_hand)
    np.testing.assert_array_equal(pipeline.map_points(xy, v, chosen[::-1]), by_hand)


def test_resampling_invents_no_blur():
    """Shifted by half a pixel, an edge spreads no more than an ideal pixel's own half pixel."""
    v = view()
    step = np.zeros((v.height + 2 * v.margin, v.width + 2 * v.margin, 1), np.float32)
    step[:, v.margin + 100 :] = 1
    line = pipeline.resample(step, v, [("principal_point", {"dx_px": 0.5, "dy_px": 0.0})])[v.margin + 50, :, 0]
    spread = np.diff(line)
    x = np.arange(len(spread))
    mean = (x * spread).sum()
    assert abs(mean - (v.margin + 99.5)) < 0.006  # half a step of the 89 points in a footprint
    assert spread.min() >= 0  # no ringing
    assert ((x - mean) ** 2 * spread).sum() < 0.26  # [0.5, 0.5]: 0.25


def test_radial_distortion_never_turns_back():
    """Plates far outside the frame would be folded into it."""
    v = view()
    x = np.linspace(v.K[0, 2], v.K[0, 2] + 3000, 500)
    xy = np.stack([x, np.full_like(x, v.K[1, 2])], axis=1)
    moved = pipeline.map_points(xy, v, [("radial_distortion", {"k1": -0.4, "k2": 0.0, "k3": 0.0})])
    assert (np.diff(moved[:, 0]) > 0).all()


def test_too_small_a_margin_says_what_is_needed():
    """Rows of the frame would silently repeat the render's edge."""
    v = view()
    radiance = np.zeros((v.height + 2 * v.margin, v.width + 2 * v.margin))
    with pytest.raises(InputError, match=r"render\.overscan to at least 0\.\d\d"):
        pipeline.form_image(radiance, v, [("focal_length", {"ratio": 0.6})], None)


def test_scene_geometry():
    """Codes, plates, rail and mount move as the words say."""
    s = scene()
    scaled = pipeline.scene_with_effects(s, [("marker_scale", {"scale": 1.1})]).plates[0]
    assert np.ptp(scaled.x_m[1:-1]) == pytest.approx(0.077)
    assert scaled.x_m[-1] == s.plates[0].x_m[-1]
    bent = pipeline.scene_with_effects(s, [("rail_sag", {"bow_m": 0.02, "slope_m": 0.0, "wave_m": 0.0})]).plates
    assert [p.T_world_plate[2, 3] for p in bent] == pytest.approx([0, 0.02, 0])
    assert bent[0].T_world_plate[2, 1] > 0 > bent[2].T_world_plate[2, 1]  # the near plate's far side rises
    mount = pipeline.scene_with_effects(s, [("camera_pose_offset", {"step_x_m": 0.01})]).T_cam_mount
    assert mount[:3, 3] == pytest.approx([0.01, 0, 0])


def test_a_single_board_has_no_rail():
    """Dividing by the rail's length would stand the board on its edge."""
    s = scene().with_(plates=scene().plates[:1])
    bent = pipeline.scene_with_effects(s, [("rail_sag", {"bow_m": 0.02, "slope_m": 0.01, "wave_m": 0.0})])
    np.testing.assert_array_equal(bent.plates[0].T_world_plate, s.plates[0].T_world_plate)


def test_a_panning_rolling_shutter_shows_each_row_as_a_turned_camera_does():
    """A uniform shear in its place leaves the image's sides a third of the shift wrong: it is called a warp."""
    v, pan = view(), 0.02
    points = np.array([[5.0, 8.0], [40.0, 200.0], [600.0, 30.0], [300.0, 150.0]])
    moved = library.effect_named("rolling_shutter").map_points(
        points, v, library.nulls_of("rolling_shutter") | {"pan_x": pan}, 1
    )
    rays = np.column_stack([points, np.ones(len(points))]) @ np.linalg.inv(v.K).T
    for ray, (_, y), found in zip(rays, points, moved, strict=True):
        angle = pan * (y - (v.height - 1) / 2) / v.K[0, 0]
        turned = v.K @ cv2.Rodrigues(np.array([0.0, angle, 0.0]))[0] @ ray
        assert found == pytest.approx(turned[:2] / turned[2], abs=1e-9)
