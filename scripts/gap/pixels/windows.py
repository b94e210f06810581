"""Windows of a frame, put together in one small image: a fit looks at plates and a sample of the ground, nothing else.

Windows are whole blocks of 16 pixels, laid on whole blocks, so that a codec's blocks and a mosaic's cells lie in them as
they do in the frame. The last one is the whole frame in small: what depends on all of a frame's light sees it there.
"""

import math
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.lib.stride_tricks import sliding_window_view

from effects.base import Windows
from gap.pixels.raster import add_edge, running_sums
from kernels import njit

BLOCK_PX = 16
WIDTH_PX = 512  # of the small image, unless a window is wider
FRAME_COLUMNS, FRAME_ROWS = 96, 64  # of the frame in small


@dataclass(frozen=True)
class Atlas:
    """Where windows of a frame lie in one small image.

    cores  (t, 4) int, frame pixels x0, y0, x1, y1 (exclusive) that are measured; what lies about them is there for filters
    boxes  (t, 4) int, frame pixels of the window that holds each core, multiples of 16
    places (t, 2) int, column and row of that window in the small image, multiples of 16
    shape  (rows, columns) of the small image, without the frame in small that lies below
    frame  (width, height) of the frame, pixels
    """

    cores: np.ndarray
    boxes: np.ndarray
    places: np.ndarray
    shape: tuple
    frame: tuple

    @property
    def whole_shape(self):
        """(rows, columns) with the frame in small."""
        return self.shape[0] + FRAME_ROWS, self.shape[1]

    @cached_property
    def tiles(self):
        """Return (windows + 1, 8): x0, y0, px per column, px per row in the frame, and column, row, columns, rows here."""
        width, height = self.frame
        _, first = np.unique(self.places, axis=0, return_index=True)
        x, y, x1, y1 = self.boxes[first].T
        one = np.ones(len(x))
        windows = np.stack([x - 0.5, y - 0.5, one, one, *self.places[first].T, x1 - x, y1 - y], axis=1)
        small = [-0.5, -0.5, width / FRAME_COLUMNS, height / FRAME_ROWS, 0, self.shape[0], FRAME_COLUMNS, FRAME_ROWS]
        return np.concatenate([windows, [small]]).astype(np.float64)

    @cached_property
    def windows(self):
        """Return the effects.base.Windows: the frame's pixels x and y that are seen here, and where the frame in small is."""
        x, y = (np.zeros(self.whole_shape, np.float32) for _ in range(2))
        for x0, y0, along, down, column, row, columns, rows in self.tiles:
            at = np.s_[int(row) : int(row + rows), int(column) : int(column + columns)]
            x[at] = x0 + (np.arange(columns) + 0.5) * along
            y[at] = (y0 + (np.arange(rows) + 0.5) * down)[:, None]
        frame = np.s_[self.shape[0] : self.shape[0] + FRAME_ROWS, :FRAME_COLUMNS]
        return Windows(x, y, frame)

    def gather(self, image):
        """Return a frame's pixels (H, W, C) as they lie here (rows, columns, C); edges repeated, no frame in small."""
        x, y = (np.rint(c[: self.shape[0]]).astype(int) for c in (self.windows.x, self.windows.y))
        return image[np.clip(y, 0, self.frame[1] - 1), np.clip(x, 0, self.frame[0] - 1)]

    def window(self, k):
        """Return the slices of window k in the small image."""
        (column, row), (x0, y0, x1, y1) = self.places[k], self.boxes[k]
        return slice(row, row + y1 - y0), slice(column, column + x1 - x0)

    def core(self, k):
        """Return the slices of the core of window k in the small image."""
        (column, row), (x0, y0, _, _), (a, b, c, d) = self.places[k], self.boxes[k], self.cores[k]
        return slice(row + b - y0, row + d - y0), slice(column + a - x0, column + c - x0)

    def offset(self, k):
        """Return what to take from a frame's pixel (x, y) to get its place in window k."""
        return self.boxes[k, :2].astype(float)


def make_atlas(cores, reach_px, frame):
    """Return the Atlas of cores (t, 4) with ``reach_px`` about them, in a frame (width, height)."""
    cores = np.asarray(cores, int).reshape(-1, 4)
    reach = math.ceil(reach_px)
    low = np.floor_divide(cores[:, :2] - reach, BLOCK_PX) * BLOCK_PX
    high = -np.floor_divide(-(cores[:, 2:] + reach), BLOCK_PX) * BLOCK_PX
    boxes, holder = _merged(np.concatenate([low, high], axis=1))
    places, shape = _packed(boxes[:, 2:] - boxes[:, :2])
    return Atlas(cores, boxes[holder], places[holder], shape, frame)


@njit(cache=True)
def _merged(boxes):
    """Return (boxes (w, 4), which of them (t,) holds each of the given ones (t, 4)): two are one where that is no larger."""
    n = len(boxes)
    out, holder, alive = boxes.copy(), np.arange(n), np.ones(n, np.bool_)
    again = True
    while again:
        again = False
        for a in range(n):
            for b in range(a + 1, n):
                if not (alive[a] and alive[b]):
                    continue
                x0, y0 = min(out[a, 0], out[b, 0]), min(out[a, 1], out[b, 1])
                x1, y1 = max(out[a, 2], out[b, 2]), max(out[a, 3], out[b, 3])
                one = (out[a, 2] - out[a, 0]) * (out[a, 3] - out[a, 1]) + (out[b, 2] - out[b, 0]) * (
                    out[b, 3] - out[b, 1]
                )
                if (x1 - x0) * (y1 - y0) <= one:
                    out[a, 0], out[a, 1], out[a, 2], out[a, 3] = x0, y0, x1, y1
                    holder[holder == b] = a
                    alive[b], again = False, True
    number = np.cumsum(alive) - 1
    return out[alive], number[holder]


def _packed(sizes):
    """Return (places (t, 2) column and row, (rows, columns)) of windows (t, 2) columns x rows, whole blocks: those of
    the longest side first, each as far up as it goes.
    """
    width = max(WIDTH_PX, *sizes[:, 0].tolist(), FRAME_COLUMNS) if len(sizes) else WIDTH_PX
    places, filled = np.zeros((len(sizes), 2), int), np.zeros(width // BLOCK_PX, int)
    for k in sorted(range(len(sizes)), key=lambda k: (-sizes[k].max(), k)):
        blocks = sizes[k, 0] // BLOCK_PX
        rows = sliding_window_view(filled, blocks).max(axis=1)
        first = int(rows.argmin())
        places[k] = first * BLOCK_PX, rows[first]
        filled[first : first + blocks] = rows[first] + sizes[k, 1]
    return places, (int(filled.max()), int(width))


@njit(cache=True, nogil=True)
def _tile(tile):
    """Return (x0, y0, x1, y1, frame pixels across and down one of it, column, row, columns, rows) of a row of ``Atlas.tiles``."""
    x0, y0, along, down = tile[0], tile[1], tile[2], tile[3]
    columns, rows = int(tile[6]), int(tile[7])
    return x0, y0, x0 + columns * along, y0 + rows * down, along, down, int(tile[4]), int(tile[5]), columns, rows


@njit(cache=True, nogil=True)
def _add_at(row, column, values, out):
    """Add values (rows, columns) to ``out`` from a row and column on: slices take numba seconds to compile."""
    for r in range(values.shape[0]):
        for c in range(values.shape[1]):
            out[row + r, column + c] += values[r, c]


@njit(cache=True, nogil=True)
def draw(vertices, tiles, out):
    """Add the coverage of closed polygons (n, m, 2), frame pixels, to the small image ``out``; tiles as of ``Atlas.tiles``."""
    n, m = vertices.shape[0], vertices.shape[1]
    boxes = _bounding_boxes(vertices, 0.0)
    for t in range(tiles.shape[0]):
        x0, y0, x1, y1, along, down, column, row, columns, rows = _tile(tiles[t])
        acc = np.zeros((rows, columns + 2))
        for i in range(n):
            if not (boxes[i, 0] < x1 and boxes[i, 2] > x0 and boxes[i, 1] < y1 and boxes[i, 3] > y0):
                continue
            for k in range(m):
                a, b = vertices[i, k], vertices[i, (k + 1) % m]
                add_edge(
                    acc, (a[0] - x0) / along, (a[1] - y0) / down, (b[0] - x0) / along, (b[1] - y0) / down, -1.0
                )  # fmt: skip
        _add_at(row, column, running_sums(acc), out)


@njit(cache=True, nogil=True)
def draw_spread(vertices, directions, shares, tiles, out):
    """Add the coverage of polygons (n, m, 2) in equal parts, each vertex of part k moved by shares[k] @ its directions.

    directions (n, m, j, 2), shares (parts, j); else as ``draw``.
    """
    n, m, parts = vertices.shape[0], vertices.shape[1], shares.shape[0]
    boxes = _bounding_boxes(vertices, _farthest(directions, shares))
    moved = np.empty((m, 2))
    for t in range(tiles.shape[0]):
        x0, y0, x1, y1, along, down, column, row, columns, rows = _tile(tiles[t])
        small = along > 1.0  # the frame in small: a spread changes nothing there
        acc = np.zeros((rows, columns + 2))
        for i in range(n):
            if not (boxes[i, 0] < x1 and boxes[i, 2] > x0 and boxes[i, 1] < y1 and boxes[i, 3] > y0):
                continue
            for k in range(1 if small else parts):
                for v in range(m):
                    x, y = vertices[i, v, 0], vertices[i, v, 1]
                    if not small:
                        for j in range(shares.shape[1]):
                            x += shares[k, j] * directions[i, v, j, 0]
                            y += shares[k, j] * directions[i, v, j, 1]
                    moved[v, 0] = (x - x0) / along
                    moved[v, 1] = (y - y0) / down
                weight = -1.0 if small else -1.0 / parts
                for v in range(m):
                    w = v + 1 if v + 1 < m else 0
                    add_edge(acc, moved[v, 0], moved[v, 1], moved[w, 0], moved[w, 1], weight)
        _add_at(row, column, running_sums(acc), out)


@njit(cache=True, nogil=True)
def _bounding_boxes(vertices, pad):
    n = vertices.shape[0]
    out = np.empty((n, 4))
    for i in range(n):
        out[i, 0] = vertices[i, :, 0].min() - pad
        out[i, 1] = vertices[i, :, 1].min() - pad
        out[i, 2] = vertices[i, :, 0].max() + pad
        out[i, 3] = vertices[i, :, 1].max() + pad
    return out


@njit(cache=True, nogil=True)
def _farthest(directions, shares):
    """Return how far any part of the light of any vertex may land from it, pixels."""
    flat = directions.reshape(-1, directions.shape[2], 2)
    reach = 0.0
    for j in range(shares.shape[1]):
        longest = 0.0
        for i in range(flat.shape[0]):
            longest = max(longest, np.hypot(flat[i, j, 0], flat[i, j, 1]))
        reach += longest * np.abs(shares[:, j]).max()
    return reach
