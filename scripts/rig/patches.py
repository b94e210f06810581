"""Patches of a calibration board: small squares of known cells that a photograph is measured by, as a rig's plates are.

A patch has a black square, its code, with white about it, and whatever of the board's other cells lies near.
"""

from dataclasses import dataclass

import numpy as np

from rig.board_markers import board_markers
from rig.plates import black_rectangles, white_cell_at

CHECKERED = ("chessboard", "charuco")  # types of boards whose points are corners of squares
WHITE_ABOUT = 0.25  # of a chessboard's square, that is looked at on each side of a black one
# Points of a square, from its middle, that tell a black one from a marker
INSIDE_SQUARE = 0.48 * np.array([[0, 0], [-1, -1], [-1, 1], [1, -1], [1, 1]])
MAX_CELLS = 1.5  # half sides of a patch, up to which the board's cells are part of it


@dataclass(frozen=True)
class Patch:
    """One patch; metres, x right and y up in the board's frame.

    centre (2,); half_code, half_patch: half the sides of its black square and of what is looked at; black (n, 4): x0, y0, x1,
    y1 of all black cells near, from the centre.
    """

    name: str
    centre: np.ndarray
    half_code: float
    half_patch: float
    black: np.ndarray

    @property
    def corners(self):
        """The corners (4, 3) of the black square on the board: top left, top right, bottom right, bottom left."""
        (x, y), h = self.centre, self.half_code
        return np.array([[x - h, y + h, 0], [x + h, y + h, 0], [x + h, y - h, 0], [x - h, y - h, 0]])


def board_patches(board, plate):
    """Return the Patches of a CalibrationBoard with a Plate: its inner black squares, or a grid's markers."""
    cells = black_rectangles(plate)
    if board.type in CHECKERED:
        half = board.square_m / 2
        return [
            _patch(name, xy, half, half + WHITE_ABOUT * board.square_m, cells)
            for name, xy in _inner_black_squares(board, plate)
        ]
    return [
        _patch(f"{m.dictionary}/{int(m.id)}", np.array([m.x, m.y]), m.code_m / 2, m.plate_m / 2, cells)
        for m in board_markers(board).itertuples()
    ]


def _inner_black_squares(board, plate):
    """Return [(name, centre (2,))] of the squares that are black throughout and have others on all sides, from the top left."""
    side = board.square_m
    more = int(board.type == "chessboard")  # its points are counted, not its squares
    columns, rows = board.columns + more, board.rows + more
    found = []
    for row in range(1, rows - 1):
        for column in range(1, columns - 1):
            centre = np.array([column + 0.5, rows - row - 0.5]) * side
            about = centre + side * INSIDE_SQUARE
            if not white_cell_at(plate, *about.T).any():
                found.append((f"{column}/{row}", centre))
    return found


def _patch(name, centre, half_code, half_patch, cells):
    """Return the Patch about a centre with its share of the board's black cells (n, 4)."""
    from_centre = cells - np.tile(centre, 2)
    far = MAX_CELLS * half_patch
    near = np.clip(from_centre, -far, far)
    near = near[(near[:, 2] > near[:, 0]) & (near[:, 3] > near[:, 1])]
    return Patch(name, centre, half_code, half_patch, stacked(near))


def stacked(rectangles):
    """Return disjoint rectangles (n, 4) with those made one that lie on one another, as wide: the same area in fewer."""
    out = []
    for x0, y0, x1, y1 in sorted(map(tuple, rectangles.round(9)), key=lambda r: (r[0], r[2], r[1])):
        if out and out[-1][0] == x0 and out[-1][2] == x1 and out[-1][3] == y0:
            out[-1][3] = y1
        else:
            out.append([x0, y0, x1, y1])
    return np.array(out, float).reshape(-1, 4)
