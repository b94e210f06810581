"""Circle grids: rows of discs, each second one moved by half a distance (asymmetric), or one above the other (symmetric).

``CIRCLES_4X11_60``: asymmetric, 4 discs in each of 11 rows, their diameter 60 % of the distance between rows. Its odd number of
rows tells top from bottom. ``CIRCLES_SYMMETRIC_6X4_60``: symmetric, 6 discs in each of 4 rows. Nothing in it tells top from
bottom, so its trackers take for top what is further up in the image. As many discs both ways would look alike
after a quarter turn as well: there is no such family.
"""

import re

import numpy as np

from markers.contract import Drawing

FAMILIES = "circle grids such as CIRCLES_4X11_60 and, of unequal sides, CIRCLES_SYMMETRIC_6X4_60"
CORNERS = "those of the smallest square about the grid's middle that holds all discs"
ASYMMETRIC = re.compile(r"CIRCLES_([2-9]|1\d)X([3579]|1[13579])_([1-9]\d)")
SYMMETRIC = re.compile(r"CIRCLES_SYMMETRIC_([3-9]|1\d)X(?!\1_)([3-9]|1\d)_([1-9]\d)")


def grid_of(family):
    """Return (columns, rows, diameter in % of a row's distance from the next, whether it looks alike upside down) of a family,
    None where it is no circle grid.
    """
    for pattern, alike in ((ASYMMETRIC, False), (SYMMETRIC, True)):
        if found := pattern.fullmatch(family):
            return *map(int, found.groups()), alike
    return None


def centres_of(family):
    """Return (centres (rows * columns, 2), radius) in sides of the square, x right and y down from the middle, row by row."""
    columns, rows, percent, alike = grid_of(family)
    row, column = np.divmod(np.arange(rows * columns), columns)
    across = column if alike else 2 * column + row % 2
    places = np.stack([across, row], axis=1).astype(float)
    diameter = percent / 100
    extent = np.ptp(places, axis=0)
    side = extent.max() + diameter
    return (places - extent / 2) / side, diameter / 2 / side


def ids(family):
    """Return 1, as a grid's discs carry no code; None for another family."""
    return 1 if grid_of(family) else None


def draw(family, number):
    """Return the Drawing: black discs on white."""
    centres, radius = centres_of(family)
    black = np.column_stack([centres * [1, -1], np.full(len(centres), radius), np.zeros(len(centres))])
    return Drawing(np.ones((1, 1), bool), discs=black)
