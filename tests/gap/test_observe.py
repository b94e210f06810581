"""What is measured in an image, and what is left out of it."""

import cv2
import numpy as np
import pytest
from drawn_board import board_case, photograph

from gap.measure.capture import FINE, MAX_PX_OFF, grey_of, states_at
from gap.measure.places import agreeing
from gap.measure.plate import SMALLEST_STEP_PX, code_homography, measure_plate

SIDE_PX = 12.0


def square(x, y):
    """Return the corners (4, 2) of a code at a pixel."""
    return np.array([[x, y], [x + SIDE_PX, y], [x + SIDE_PX, y + SIDE_PX], [x, y + SIDE_PX]])


def test_a_plate_that_was_taken_for_its_neighbour_is_left_out():
    """A find with another plate's id would be fitted a plate's length beside its place, and weigh more than all the rest."""
    starts = np.array([square(100 + 60 * k, 200 + 25 * (k % 3)) for k in range(9)])
    corners = starts + [2.0, -1.5] + 1e-5 * (starts - 300) ** 2  # a lens that is a little off moves all alike
    corners[4] += [0.0, 33.0]
    measured = np.arange(9) != 7
    assert agreeing(starts, corners, measured).tolist() == [k not in (4, 7) for k in range(9)]
    few = np.isin(np.arange(9), (3, 4, 5))
    assert agreeing(starts, corners, few).tolist() == few.tolist()


@pytest.mark.parametrize(
    "corners",
    [
        [[10, 20], [50, 20], [50, 60], [10, 60]],
        [[12, 18], [55, 24], [49, 70], [8, 52]],
        [[60, 9], [52, 48], [5, 40], [20, 2]],
    ],
    ids=["square", "in perspective", "turned"],
)
def test_a_plates_plane_lands_on_its_corners(corners):
    """Fails if two corners change places, the plane's y runs down as the image's does, or lines within bend."""
    half, corners = 0.03, np.array(corners, float)
    plane = half * np.array([[-1.0, 1.0], [1.0, 1.0], [1.0, -1.0], [-1.0, -1.0]])
    of_opencv = cv2.getPerspectiveTransform(plane.astype(np.float32), corners.astype(np.float32))
    H = code_homography(corners, half)
    for H_there, off_px in ((H, 1e-9), (of_opencv, 1e-3)):
        within = np.concatenate([plane, [[0.01, 0.02], [-0.02, 0.0]]])
        there = cv2.perspectiveTransform(within[None], H_there)[0]
        np.testing.assert_allclose(there[:4], corners, atol=off_px)
        np.testing.assert_allclose(there, cv2.perspectiveTransform(within[None], H)[0], atol=off_px)
    assert H[2, 2] == 1.0


@pytest.mark.parametrize(
    "blur", [("lens_blur", {"sigma_px": 0.8, "softness": 1.0}), ("motion_blur", {"dx_px": 2.0, "dy_px": 0.5})]
)
def test_the_fit_of_a_blurred_patch_ends_wherever_it_lies_between_pixels(blur):
    """Fails if the window is cut anew however long a fit goes on: a row comes and goes, and one patch in a hundred is lost."""
    case, steps = board_case(6), []
    codes = case.codes
    for k, capture in enumerate(case.captures):
        grey = np.ascontiguousarray(grey_of(photograph(case, k, [blur])), np.float32)
        for i, state in enumerate(states_at(case.corners_of(capture, [], np.zeros(6)), codes)):
            fit = measure_plate(
                grey, state, codes.half_code[i], codes.half_plate[i], codes.beyond, codes.rectangles[i],
                codes.levels, codes.lut, FINE, MAX_PX_OFF,
            )  # fmt: skip
            steps.append(fit[4])
    assert len(steps) > 100 and max(steps) < SMALLEST_STEP_PX
