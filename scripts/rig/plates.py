"""Printed plates as grids of black and white cells and discs on them: what Blender builds, is synthesised, is fitted.

A marker is a plate; a whole calibration board is one plate as well.
"""

from dataclasses import dataclass, field, replace

import cv2
import numpy as np

from rig.discs import no_discs, spread_discs, turning_colour
from rig.geometry import make_pose, transform

BOARD_MARGIN_SQUARES = 0.5  # white paper round a board, in squares: boards do not state their margin
STRIPS = 96  # of a plate with discs, where its black area is wanted as rectangles


@dataclass(frozen=True)
class Plate:
    """A print: a grid of rectangular cells, each black or white, and discs painted over them.

    name          e.g. ``DICT_5X5_1000/3`` or ``board``
    T_world_plate 4 x 4 pose of the plate (x right, y up, z out of the paper), origin at its centre
    x_m, y_m      increasing cell boundaries in metres, shapes (nx+1,), (ny+1,)
    white         bool (ny, nx); row 0 is the *lowest* y
    discs         (k, 4): x, y, radius in metres, 1 white or 0 black; painted in order, each on ground of one colour
    bend_m        how far paper that is not flat rises out of the plane, of ``height``
    """

    name: str
    T_world_plate: np.ndarray
    x_m: np.ndarray
    y_m: np.ndarray
    white: np.ndarray
    discs: np.ndarray = field(default_factory=no_discs)
    bend_m: tuple = (0.0, 0.0, 0.0)

    def grid_world(self):
        """Return the world positions of all grid points, shape (ny+1, nx+1, 3)."""
        return self.to_world(np.stack(np.meshgrid(self.x_m, self.y_m), axis=-1))

    def to_world(self, xy):
        """Return the world positions (..., 3) of printed points (..., 2), metres."""
        return transform(self.T_world_plate, np.concatenate([xy, self.height(xy)[..., None]], axis=-1))

    def height(self, xy):
        """Return by how much printed points (..., 2) rise out of the plate's plane, metres, the same at all four corners but
        for a twist: ``bend_m`` are a bow along x, one along y, and a twist.
        """
        along_x, along_y, twist = self.bend_m
        u, v = (
            (2 * xy[..., k] - lines[0] - lines[-1]) / (lines[-1] - lines[0])
            for k, lines in enumerate((self.x_m, self.y_m))
        )
        return along_x * (1 - u * u) + along_y * (1 - v * v) + twist * u * v

    def outline_world(self):
        """Return the plate's four outer corners (4, 3): top left, top right, bottom right, bottom left."""
        g = self.grid_world()
        return np.stack([g[-1, 0], g[-1, -1], g[0, -1], g[0, 0]])


def aruco_dictionary(name):
    """Return OpenCV's predefined dictionary of that name, such as ``DICT_5X5_1000``.

    Raises ValueError for an unknown name.
    """
    if not name.startswith("DICT_") or not hasattr(cv2.aruco, name):
        raise ValueError(f"unknown dictionary {name!r}")
    return cv2.aruco.getPredefinedDictionary(getattr(cv2.aruco, name))


def code_cells(dictionary, marker_id):
    """Return the code's modules, black border included: bool (n, n), True is white, row 0 is the top."""
    d = aruco_dictionary(dictionary)
    n = d.markerSize + 2
    return d.generateImageMarker(int(marker_id), n, borderBits=1) > 127


def marker_corners_plate(code_m):
    """Return the black frame's outer corners (4, 3) in the plate's frame, in OpenCV's order."""
    h = code_m / 2
    return np.array([[-h, h, 0], [h, h, 0], [h, -h, 0], [-h, -h, 0]])


def board_plate(rectangles, squares_x, squares_y, square_m):
    """Return the Plate of a board drawn as black rectangles on white paper.

    rectangles  (n, 5) array of x0, y0, x1, y1 in metres (y up, origin at the board's lower left corner) and
                1 for white or 0 for black, painted in order
    """
    margin = BOARD_MARGIN_SQUARES * square_m
    width, height = squares_x * square_m, squares_y * square_m

    def boundaries(values, size):
        values = np.sort(np.concatenate([values, [-margin, 0, size, size + margin]]))
        return values[np.concatenate([[True], np.diff(values) > 1e-9])]

    x = boundaries(rectangles[:, [0, 2]].ravel(), width)
    y = boundaries(rectangles[:, [1, 3]].ravel(), height)
    xc, yc = (x[1:] + x[:-1]) / 2, (y[1:] + y[:-1]) / 2
    white = np.ones((len(yc), len(xc)), bool)
    for x0, y0, x1, y1, is_white in rectangles:
        inside = ((yc > y0) & (yc < y1))[:, None] & ((xc > x0) & (xc < x1))[None, :]
        white[inside] = bool(is_white)
    T = make_pose([0, 0, 0], [0, 0, 0])
    return Plate("board", T, x, y, white)


def black_rectangles(plate):
    """Return the black area of a plate as disjoint rectangles (n, 4): x0, y0, x1, y1 in metres, runs along x.

    Discs are cut into strips, STRIPS to a plate: what is drawn with them is off by a share of a strip at their rims.
    """
    if len(plate.discs):
        return _black_strips(plate)
    return cell_rectangles(plate)


def cell_rectangles(plate):
    """Return the black cells of a plate as ``black_rectangles``, discs left out."""
    rectangles = []
    for row in range(len(plate.y_m) - 1):
        for a, b in _black_runs(plate.white[row]):
            rectangles.append([plate.x_m[a], plate.y_m[row], plate.x_m[b], plate.y_m[row + 1]])
    return np.array(rectangles, float).reshape(-1, 4)


def _black_runs(white):
    """Return [(first, after the last)] of the runs of black in a row of cells (n,), whether each is white."""
    black = np.concatenate([[0], ~white, [0]]).astype(int)
    return list(zip(np.flatnonzero(np.diff(black) == 1), np.flatnonzero(np.diff(black) == -1), strict=True))


def white_cell_at(plate, x, y):
    """Return whether the cells at points x, y (n,) of a plate's frame are white, discs left out."""
    column = np.clip(np.searchsorted(plate.x_m, x, side="right") - 1, 0, len(plate.x_m) - 2)
    row = np.clip(np.searchsorted(plate.y_m, y, side="right") - 1, 0, len(plate.y_m) - 2)
    return plate.white[row, column]


def disc_changes(plate):
    """Return the discs (k, 4) of a plate that change the colour of what they lie on."""
    return turning_colour(plate.discs, white_cell_at(plate, *plate.discs[:, :2].T))


def _black_strips(plate):
    """Return the black area of a plate with discs as rectangles (n, 4), strip by strip as seen along its middle."""
    rectangles = []
    lines = np.linspace(*plate.y_m[[0, -1]], STRIPS + 1)
    lines = np.unique(np.concatenate([lines, plate.y_m]))
    for y0, y1 in zip(lines[:-1], lines[1:], strict=True):
        y = (y0 + y1) / 2
        half = np.sqrt(np.maximum(plate.discs[:, 2] ** 2 - (plate.discs[:, 1] - y) ** 2, 0))
        ends = np.concatenate([plate.x_m, plate.discs[:, 0] - half, plate.discs[:, 0] + half])
        ends = np.unique(np.clip(ends, *plate.x_m[[0, -1]]))
        middle = (ends[:-1] + ends[1:]) / 2
        white = white_cell_at(plate, middle, np.full(len(middle), y))
        for (x, _, _, is_white), reach in zip(plate.discs, half, strict=True):
            white = np.where(np.abs(middle - x) < reach, bool(is_white), white)
        rectangles += [[ends[a], y0, ends[b], y1] for a, b in _black_runs(white)]
    return np.array(rectangles, float).reshape(-1, 4)


def printed_plates(scene):
    """Return a scene's plates as they are printed, ink spread included."""
    return [spread_ink(plate, scene.ink_spread_m) if scene.ink_spread_m else plate for plate in scene.plates]


def spread_ink(plate, spread_m):
    """Return the plate with the boundaries of black moved outward by ``spread_m`` (inward where negative).

    The black area is dilated (eroded) by a square, so that corners stay sharp; the outer edge of the paper stays.
    """
    d = abs(spread_m)
    x = np.unique(np.concatenate([plate.x_m - d, plate.x_m + d, plate.x_m[[0, -1]]]))
    y = np.unique(np.concatenate([plate.y_m - d, plate.y_m + d, plate.y_m[[0, -1]]]))
    x = x[(x >= plate.x_m[0]) & (x <= plate.x_m[-1])]
    y = y[(y >= plate.y_m[0]) & (y <= plate.y_m[-1])]
    growing = ~plate.white if spread_m > 0 else plate.white
    near_x = _cells_near((x[1:] + x[:-1]) / 2, plate.x_m, d)
    near_y = _cells_near((y[1:] + y[:-1]) / 2, plate.y_m, d)
    grown = (near_y.astype(int) @ growing.astype(int) @ near_x.T.astype(int)) > 0
    discs = spread_discs(plate.discs, spread_m)
    return replace(plate, x_m=x, y_m=y, white=~grown if spread_m > 0 else grown, discs=discs)


def _cells_near(centres, lines, distance):
    """Return (n, cells) whether a cell of the grid lines lies within ``distance`` of each centre."""
    return (centres[:, None] > lines[None, :-1] - distance) & (centres[:, None] < lines[None, 1:] + distance)
