"""Whether a found chessboard's squares go on beyond those that are described, and how many there are where none is found."""

import cv2
import numpy as np

NEXT = (-1.2, -1.35, -1.5, -1.65, -1.8)  # in the squares after the outermost, from the first inner corners, in squares
MIN_CONTRAST, MIN_SHARE_OF_PHOTOGRAPHS = (
    0.4,
    0.5,
)  # of the board's own, between any of those squares; of the photographs
CORNERS_IN_REACH = 3  # that a line is continued by
MIN_COUNTS = (3, 3)  # of inner corners, from which OpenCV's finder grows a pattern


def _centres(grid):
    """Return where squares lie between neighbouring corners (rows, columns, 2), pixels."""
    return (grid[:-1, :-1] + grid[1:, :-1] + grid[:-1, 1:] + grid[1:, 1:]) / 4


def _continued(grid, at):
    """Return where lines of corners (rows, columns, 2) are, ``at`` squares from the first row: a parabola through three."""
    a, b, c = grid[:CORNERS_IN_REACH]
    return a * (at - 1) * (at - 2) / 2 - b * at * (at - 2) + c * at * (at - 1) / 2


def goes_on(grey, grid):
    """Return whether black and white squares alternate on beyond the board: before the first row of corners.

    grey (H, W) uint8; grid (rows, columns, 2) pixels, the inner corners. False where the place is out of the frame.
    """
    inner = _values(grey, _centres(grid))
    odd = np.add.outer(np.arange(inner.shape[0]), np.arange(inner.shape[1])) % 2 == 1
    contrast = inner[odd].mean() - inner[~odd].mean()  # of either sign
    return any(_alternates(grey, _continued(grid, at), odd[0], contrast) for at in NEXT)


def _alternates(grey, ring, odd, contrast):
    """Return whether squares between a row of places (n, 2), pixels, alternate as the row two further in does.

    odd (n - 1,) which squares are of the one colour; contrast grey levels of these over the others
    """
    middle = (ring[:-1] + ring[1:]) / 2
    if (middle < 0).any() or (middle > np.array(grey.shape[::-1]) - 1).any():
        return False
    values = _values(grey, middle) * np.sign(contrast)
    return values[odd].min() - values[~odd].max() > MIN_CONTRAST * abs(contrast)


def _values(grey, xy):
    """Return an image's values at places (..., 2), to the nearest pixel, each the mean of 3 x 3."""
    x, y = np.moveaxis(np.round(xy).astype(int), -1, 0)
    return cv2.blur(grey, (3, 3))[np.clip(y, 0, grey.shape[0] - 1), np.clip(x, 0, grey.shape[1] - 1)].astype(float)


def whole_grid(points, board):
    """Return a chessboard's corners (rows, columns, 2) in pixels of its BoardPoints, None where some were left out."""
    shape = (board.rows, board.columns, 2)
    return points.image.reshape(shape) if points.image.size == np.prod(shape) else None


def more_squares(views, board):
    """Return (columns, rows) that boards go on by beyond the description, each 0 or 1 where most photographs show it.

    views  [(grey image (H, W) uint8, BoardPoints)]
    """
    seen = [(grey, whole_grid(points, board)) for grey, points in views]
    seen = [(grey, grid) for grey, grid in seen if grid is not None]
    if not seen or min(board.columns, board.rows) < CORNERS_IN_REACH:
        return 0, 0
    found = []
    for turn in (lambda g: g.transpose(1, 0, 2), lambda g: g):
        shows = [goes_on(grey, turn(grid)) or goes_on(grey, turn(grid)[::-1]) for grey, grid in seen]
        found.append(int(sum(shows) >= MIN_SHARE_OF_PHOTOGRAPHS * len(seen)))
    return tuple(found)


def counts_shown(images, board):
    """Return [(columns, rows)] of inner corners that a chessboard in grey images may have, the most first.

    In the described order of the longer side and the shorter; last those of a board whose squares were described. None is
    sure: what lies about a board may look like squares.
    """
    grown = [cv2.findChessboardCornersSBWithMeta(grey, MIN_COUNTS, cv2.CALIB_CB_LARGER) for grey in images]
    sides = {tuple(sorted(meta.shape, reverse=board.columns >= board.rows)) for found, _, meta in grown if found}
    shown = sorted(sides, key=lambda counts: (-counts[0] * counts[1], counts))
    return shown + [(board.columns - 1, board.rows - 1)] * (min(board.columns, board.rows) > min(MIN_COUNTS))
