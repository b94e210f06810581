"""Rings and discs as drawn, against sampling apart from the project's own synthesis; cells of other types as before."""

from types import SimpleNamespace

import cv2
import numpy as np
import pytest
from numba import njit

from effects.base import Scene, View
from effects.encoding import srgb_encode
from gap.measure.capture import COARSE_TO_FINE, Codes, measure_plates, states_at
from gap.predict.synthesis import Prints, coverages, shade
from gap.problem import code_corners_world, encoding_table
from markers import contract
from rig.discs import no_discs
from rig.geometry import camera_matrix, invert_pose, make_pose, project, station_pose
from rig.plates import Plate, black_rectangles, disc_changes, spread_ink

LEVELS = {"white": 0.8, "black": 0.05, "ground": 0.35, "background": 0.3}
SIDE = 64  # samples along a pixel's side: 4,096 in all
PROBES = 17  # along the side of a pixel, that tell whether it is of one colour


def marker(dictionary, number=5, code_m=0.06, plate_m=0.12, **place):
    return SimpleNamespace(
        **({"x": 0.0, "y": 0.6, "z": 0.0, "rx": 0.0, "ry": 0.0, "rz": 0.3} | place),
        dictionary=dictionary,
        id=number,
        code_m=code_m,
        plate_m=plate_m,
    )


def seen_from(height_m=0.5, tilt_deg=40, focal_px=330, width=76, height=54):
    T = station_pose(height_m, tilt_deg)
    aim = project(camera_matrix(focal_px, focal_px, 0, 0), T, np.array([0, 0.6, 0]))
    K = camera_matrix(focal_px, focal_px, (width - 1) / 2 - aim[0], (height - 1) / 2 - aim[1])
    return View(K, width, height, 0, T, "c", "a", "s")


def drawn(plate, view):
    return shade(Scene((plate,), **LEVELS), view, *coverages(Prints((plate,)), view))


def sampled(plate, view):
    """Return the radiance (H, W): SIDE x SIDE rays a pixel, each asked which cell and which discs it meets, where
    a pixel is not of one colour.
    """
    T = invert_pose(plate.T_world_plate) @ invert_pose(view.T_cam_world)
    levels = np.array([LEVELS[name] for name in ("black", "white", "ground")])
    image = np.zeros((view.height, view.width))
    _sample(image, T, view.K, plate.x_m, plate.y_m, plate.white, plate.discs, levels)
    return image


@njit(cache=True)
def _sample(image, T, K, x_lines, y_lines, white, discs, levels):
    for row in range(image.shape[0]):
        for column in range(image.shape[1]):
            mixed, first = False, -1
            for k in range(PROBES * PROBES):  # from one border of the pixel to the other
                u, v = column + (k % PROBES) / (PROBES - 1) - 0.5, row + (k // PROBES) / (PROBES - 1) - 0.5
                colour = _colour_at(u, v, T, K, x_lines, y_lines, white, discs)
                mixed |= k > 0 and colour != first
                first = colour
            image[row, column] = levels[first]
            if mixed:
                total = 0.0
                for k in range(SIDE * SIDE):
                    u, v = column + (k % SIDE + 0.5) / SIDE - 0.5, row + (k // SIDE + 0.5) / SIDE - 0.5
                    total += levels[_colour_at(u, v, T, K, x_lines, y_lines, white, discs)]
                image[row, column] = total / SIDE**2


@njit(cache=True)
def _colour_at(u, v, T, K, x_lines, y_lines, white, discs):
    u, v = (u - K[0, 2]) / K[0, 0], (v - K[1, 2]) / K[1, 1]
    depth = -T[2, 3] / (T[2, 0] * u + T[2, 1] * v + T[2, 2])
    x = T[0, 3] + depth * (T[0, 0] * u + T[0, 1] * v + T[0, 2])
    y = T[1, 3] + depth * (T[1, 0] * u + T[1, 1] * v + T[1, 2])
    if not (x_lines[0] < x < x_lines[-1] and y_lines[0] < y < y_lines[-1]):
        return 2
    i, j = 0, 0
    while x_lines[i + 1] <= x:
        i += 1
    while y_lines[j + 1] <= y:
        j += 1
    for k in range(len(discs) - 1, -1, -1):
        if (x - discs[k, 0]) ** 2 + (y - discs[k, 1]) ** 2 < discs[k, 2] ** 2:
            return 1 if discs[k, 3] > 0 else 0
    return 1 if white[j, i] else 0


def grey(radiance):
    return 255 * srgb_encode(np.asarray(radiance))


def ring_plate():
    discs = np.array([[0.003, -0.002, 0.03, 0], [0.003, -0.002, 0.018, 1], [0.003, -0.002, 0.007, 0]])
    lines = np.array([-0.06, -0.05, 0.05, 0.06])
    T = make_pose([0, 0, 0.4], [0, 0.6, 0])
    return Plate("ring", T, lines, lines, np.ones((3, 3), bool), discs)


@pytest.mark.parametrize("plate", [ring_plate(), contract.marker_plate(marker("STAG_HD15", 321))], ids=["ring", "stag"])
def test_rings_and_discs_are_drawn_as_4096_samples_a_pixel_show_them(plate):
    """Fails if a disc is drawn with too few corners, too small, at another place, or if white on black is not taken off."""
    view = seen_from()
    off = np.abs(grey(drawn(plate, view)) - grey(sampled(plate, view)))
    assert off.max() < 1.0
    moved = Plate(plate.name, plate.T_world_plate, plate.x_m, plate.y_m, plate.white, plate.discs * [1, 1, 1.01, 1])
    assert np.abs(grey(drawn(moved, view)) - grey(sampled(plate, view))).max() > 1.0


def test_a_disc_lies_where_it_is_to_a_hundredth_of_a_pixel():
    """Fails if discs are drawn half a pixel off, or with their corners to one side."""
    lines = np.array([-0.06, -0.05, 0.05, 0.06])
    for radius in (0.004, 0.02):
        disc = np.array([[0.001, 0.002, radius, 0]])
        plate = Plate("disc", make_pose([0, 0, 0], [0, 0.6, 0]), lines, lines, np.ones((3, 3), bool), disc)
        view = seen_from()
        centres = []
        for image in (drawn(plate, view), sampled(plate, view)):
            black = np.clip((LEVELS["white"] - image) / (LEVELS["white"] - LEVELS["black"]), 0, 1)
            inside = np.abs(project(view.K, view.T_cam_world, np.array([0.001, 0.602, 0]))[::-1, None, None]
                            - np.mgrid[: view.height, : view.width]).max(0) < 20 * radius / 0.02 + 3  # fmt: skip
            black = np.where(inside, black, 0)
            centres.append([(black * g).sum() / black.sum() for g in np.mgrid[: view.height, : view.width]])
        assert np.abs(np.subtract(*centres)).max() < 0.01


@pytest.mark.parametrize("family", ["STAG_HD13", "STAG_HD23"])
def test_discs_lie_on_ground_of_one_colour(family):
    """Fails if discs of a type overlap or cross an edge: their areas would then be counted twice."""
    plate = contract.marker_plate(marker(family, 3))
    assert len(disc_changes(plate)) == len(plate.discs)
    ring, bits = plate.discs[0], plate.discs[1:]
    assert (np.hypot(*(bits[:, :2] - ring[:2]).T) + bits[:, 2] < ring[2]).all()
    apart = np.linalg.norm(bits[:, None, :2] - bits[None, :, :2], axis=-1) + np.eye(len(bits))
    assert (apart > 2 * bits[0, 2]).all()


def test_ink_grows_on_discs_and_shrinks_their_white():
    """Fails if ink that spreads leaves discs as they are, or makes a white one larger."""
    plate = ring_plate()
    grown = spread_ink(plate, 0.001)
    np.testing.assert_allclose(grown.discs[:, 2], [0.031, 0.017, 0.008])
    assert len(spread_ink(plate, -0.008).discs) == 2
    whole = contract.marker_plate(marker("DICT_5X5_1000"))
    assert whole.discs.shape == no_discs().shape


def test_strips_hold_the_black_of_discs():
    """Fails if the fit's own model of a plate with discs lacks some of its black."""
    plate = ring_plate()
    x0, y0, x1, y1 = black_rectangles(plate).T
    area = np.pi * (plate.discs[:, 2] ** 2 * [1, -1, 1]).sum()
    assert ((x1 - x0) * (y1 - y0)).sum() == pytest.approx(area, rel=0.01)


@pytest.mark.parametrize("family", ["tagStandard41h12", "STAG_HD21"])
def test_the_diagnosis_measures_corners_of_every_type(family):
    """Fails if the fit of a whole code takes markers with discs or with bits beyond their border for something else."""
    plate = contract.marker_plate(marker(family))
    view, table = seen_from(focal_px=1200, width=240, height=200), encoding_table("srgb", 1.0)
    image = np.interp(drawn(plate, view), np.linspace(0, 1, len(table)), table)
    codes = Codes.of([plate], [0.8, 0.05, 0.35], table)
    truth = project(view.K, view.T_cam_world, code_corners_world(plate)[None])
    features, _, measured = measure_plates(
        image, states_at(truth + 0.5, codes), np.ones(1, bool), codes, COARSE_TO_FINE
    )
    assert measured.all()
    assert np.abs(features[0, :8].reshape(4, 2) - truth[0]).max() < 0.05


def test_a_plate_without_discs_is_drawn_as_before():
    """Fails if the new way of drawing markers moves a cell of the old ones."""
    plate = contract.marker_plate(marker("DICT_4X4_50", 7, 0.07, 0.1))
    modules = cv2.aruco.getPredefinedDictionary(cv2.aruco.DICT_4X4_50).generateImageMarker(7, 6) > 127
    np.testing.assert_array_equal(plate.white[1:-1, 1:-1], modules[::-1])
    np.testing.assert_array_equal(plate.x_m, [-0.05, *np.linspace(-0.035, 0.035, 7), 0.05])
