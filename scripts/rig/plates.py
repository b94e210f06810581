"""Printed plates as grids of black and white cells: what Blender builds, what is synthesised, what is fitted.

A marker is a plate; a whole calibration board is one plate as well.
"""

from dataclasses import dataclass, replace

import cv2
import numpy as np

from rig.geometry import make_pose, transform

BOARD_MARGIN_SQUARES = 0.5  # white paper round a board, in squares: boards do not state their margin


@dataclass(frozen=True)
class Plate:
    """A print: a grid of rectangular cells, each black or white.

    name          e.g. ``DICT_5X5_1000/3`` or ``board``
    T_world_plate 4 x 4 pose of the plate (x right, y up, z out of the paper), origin at its centre
    x_m, y_m      increasing cell boundaries in metres, shapes (nx+1,), (ny+1,)
    white         bool (ny, nx); row 0 is the *lowest* y
    bend_m        how far paper that is not flat rises out of the plane, of ``height``
    """

    name: str
    T_world_plate: np.ndarray
    x_m: np.ndarray
    y_m: np.ndarray
    white: np.ndarray
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


def marker_corners_world(marker):
    """Return the four outer corners (4, 3) in the world of a row of the markers' table."""
    T = make_pose([marker.rx, marker.ry, marker.rz], [marker.x, marker.y, marker.z])
    return transform(T, marker_corners_plate(marker.code_m))


def marker_plate(marker):
    """Return the Plate of a row of the markers' table (dictionary, id, code_m, plate_m, x..z, rx..rz)."""
    cells = code_cells(marker.dictionary, marker.id)
    n = len(cells)
    code = np.linspace(-marker.code_m / 2, marker.code_m / 2, n + 1)
    half = marker.plate_m / 2
    lines = np.concatenate([[-half], code, [half]])
    white = np.ones((n + 2, n + 2), bool)
    white[1:-1, 1:-1] = cells[::-1]
    T = make_pose([marker.rx, marker.ry, marker.rz], [marker.x, marker.y, marker.z])
    return Plate(f"{marker.dictionary}/{int(marker.id)}", T, lines, lines, white)


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
    """Return the black area of a plate as disjoint rectangles (n, 4): x0, y0, x1, y1 in metres, runs along x."""
    rectangles = []
    for row in range(len(plate.y_m) - 1):
        black = np.concatenate([[0], ~plate.white[row], [0]]).astype(int)
        starts, ends = np.flatnonzero(np.diff(black) == 1), np.flatnonzero(np.diff(black) == -1)
        for a, b in zip(starts, ends, strict=True):
            rectangles.append([plate.x_m[a], plate.y_m[row], plate.x_m[b], plate.y_m[row + 1]])
    return np.array(rectangles, float).reshape(-1, 4)


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
    return replace(plate, x_m=x, y_m=y, white=~grown if spread_m > 0 else grown)


def _cells_near(centres, lines, distance):
    """Return (n, cells) whether a cell of the grid lines lies within ``distance`` of each centre."""
    return (centres[:, None] > lines[None, :-1] - distance) & (centres[:, None] < lines[None, 1:] + distance)
