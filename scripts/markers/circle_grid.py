"""Asymmetric circle grids: rows of discs, each second row moved by half a distance; an odd number of rows tells top from bottom.

``CIRCLES_4X11_60``: 4 discs in each of 11 rows, their diameter 60 % of the distance between rows.
"""

import re

import numpy as np

from markers.contract import Drawing

FAMILIES = "circle grids such as CIRCLES_4X11_60"
CORNERS = "those of the smallest square about the grid's middle that holds all discs"
PATTERN = re.compile(r"CIRCLES_([2-9]|1\d)X([3579]|1[13579])_([1-9]\d)")


def centres_of(family):
    """Return (centres (rows * columns, 2), radius) in sides of the square, x right and y down from the middle, row by row."""
    columns, rows, percent = map(int, PATTERN.fullmatch(family).groups())
    row, column = np.divmod(np.arange(rows * columns), columns)
    places = np.stack([2.0 * column + row % 2, row], axis=1)
    diameter = percent / 100
    extent = np.ptp(places, axis=0)
    side = extent.max() + diameter
    return (places - extent / 2) / side, diameter / 2 / side


def ids(family):
    """Return 1, as a grid's discs carry no code; None for another family."""
    return 1 if PATTERN.fullmatch(family) else None


def draw(family, number):
    """Return the Drawing: black discs on white."""
    centres, radius = centres_of(family)
    black = np.column_stack([centres * [1, -1], np.full(len(centres), radius), np.zeros(len(centres))])
    return Drawing(np.ones((1, 1), bool), discs=black)
