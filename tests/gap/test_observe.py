"""What is measured in an image, and what is left out of it."""

import numpy as np

from gap.measure.places import agreeing

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
