"""Exact area coverage of polygons on a pixel grid (a box one pixel wide), compiled.

Each edge adds its signed area to an accumulator whose running sum along a row is the coverage; the method of
font rasterisers (Levien, "font-rs", 2016), in double precision.
"""

import numpy as np

from kernels import njit


@njit(cache=True, fastmath=False)
def add_edge(acc, x0, y0, x1, y1, weight):
    """Add the directed edge (x0, y0)-(x1, y1) to the accumulator (rows, columns + 2).

    Pixel (i, j) spans [j, j+1) x [i, i+1). What lies left of the array counts into its first column.
    """
    rows, columns = acc.shape[0], acc.shape[1] - 2
    if y0 == y1:
        return
    sign = 1.0
    if y0 > y1:
        x0, y0, x1, y1, sign = x1, y1, x0, y0, -1.0
    if y1 <= 0 or y0 >= rows:
        return
    slope = (x1 - x0) / (y1 - y0)
    x = x0
    if y0 < 0:
        x -= y0 * slope
        y0 = 0.0
    last = min(rows, int(np.ceil(y1)))
    for row in range(int(y0), last):
        dy = min(row + 1.0, y1) - max(float(row), y0)
        x_next = x + slope * dy
        area = sign * weight * dy
        left, right = (x, x_next) if x < x_next else (x_next, x)
        x = x_next
        if left >= columns:
            continue
        left, right = max(left, 0.0), min(max(right, 0.0), columns + 0.999)
        first = int(left)
        if right <= first + 1:
            middle = 0.5 * (left + right) - first
            acc[row, first] += area * (1.0 - middle)
            acc[row, first + 1] += area * middle
        else:
            density = area / (right - left)
            head = first + 1.0 - left
            a0 = 0.5 * density * head * head
            acc[row, first] += a0
            covered = a0
            stop = int(np.ceil(right))
            for column in range(first + 1, stop - 1):
                total = density * (column + 0.5 - left)
                acc[row, column] += total - covered
                covered = total
            tail = right - (stop - 1)
            total = area - 0.5 * density * tail * tail
            acc[row, stop - 1] += total - covered
            acc[row, stop] += area - total


@njit(cache=True, nogil=True)
def add_polygons(acc, vertices, weights):
    """Add closed polygons, vertices (n, m, 2) in array coordinates (pixel centres at +0.5), with their weights (n,).

    Clockwise on screen (y down) adds a positive weight.
    """
    n, m = vertices.shape[0], vertices.shape[1]
    for i in range(n):
        for k in range(m):
            a, b = vertices[i, k], vertices[i, (k + 1) % m]
            add_edge(acc, a[0], a[1], b[0], b[1], -weights[i])


@njit(cache=True, nogil=True)
def add_spread_polygons(acc, vertices, directions, shares):
    """Add closed polygons (n, m, 2) of weight 1 in equal parts, each vertex of part k moved by shares[k] @ its directions.

    directions (n, m, j, 2), shares (parts, j).
    """
    n, m, parts = vertices.shape[0], vertices.shape[1], shares.shape[0]
    moved = np.empty((m, 2))
    for i in range(n):
        for k in range(parts):
            for v in range(m):
                x, y = vertices[i, v, 0], vertices[i, v, 1]
                for j in range(shares.shape[1]):
                    x += shares[k, j] * directions[i, v, j, 0]
                    y += shares[k, j] * directions[i, v, j, 1]
                moved[v, 0] = x
                moved[v, 1] = y
            for v in range(m):
                w = v + 1 if v + 1 < m else 0
                add_edge(acc, moved[v, 0], moved[v, 1], moved[w, 0], moved[w, 1], -1.0 / parts)


@njit(cache=True, nogil=True)
def running_sums(acc):
    """Return the running sums (rows, columns) of the rows of an accumulator (rows, columns + 2)."""
    out = np.empty((acc.shape[0], acc.shape[1] - 2))
    for row in range(out.shape[0]):
        total = 0.0
        for column in range(out.shape[1]):
            total += acc[row, column]
            out[row, column] = total
    return out
