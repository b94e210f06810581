"""The one resampling that all geometric effects share: edges stay as sharp, and where, the render has them.

A render's pixel is the mean over its square, so a sharp edge can't be interpolated: any kernel moves it by up to 0.1 px
or makes it ring. Instead the edge inside each pixel is rebuilt as a straight line from its 3 x 3 neighbourhood (ELVIRA,
as in volume-of-fluid methods: exact for straight edges between two levels), and each new pixel averages over its own
footprint in the old image. Source: J. E. Pilliod and E. G. Puckett, "Second-order accurate volume-of-fluid algorithms
for tracking material interfaces", Journal of Computational Physics 199 (2004).
"""

import numpy as np

from kernels import njit

MIN_CONTRAST = 0.004  # of full scale, over 3 x 3 pixels; below it a pixel is taken as smooth
POINTS = 89  # Fibonacci lattice in a footprint: no two share a row or a column
LATTICE = np.stack([np.arange(POINTS), (55 * np.arange(POINTS)) % POINTS], axis=1)
LATTICE = ((LATTICE + 0.5) / POINTS - 0.5).astype(np.float32)


@njit(cache=True)
def _share_below(nx, ny, d):
    """Return the share of the unit square about 0 where nx x + ny y < d, |nx| + |ny| = 1."""
    a = d + 0.5
    if a <= 0:
        return 0.0
    if a >= 1:
        return 1.0
    m = min(abs(nx), abs(ny))
    b = min(a, 1 - a)
    share = b * b / (2 * m * (1 - m)) if b < m else (b - m / 2) / (1 - m)
    return share if a <= 0.5 else 1 - share


@njit(cache=True)
def _offset_of(nx, ny, share):
    """Return d such that ``_share_below`` is the share."""
    m = min(abs(nx), abs(ny))
    s = min(share, 1 - share)
    b = np.sqrt(2 * m * (1 - m) * s) if s < m / (2 * (1 - m)) else s * (1 - m) + m / 2
    return (b if share <= 0.5 else 1 - b) - 0.5


@njit(cache=True)
def _fit_line(f):
    """Return (nx, ny, d) of the edge in the middle of 3 x 3 bright shares f: bright where nx x + ny y < d.

    Of six slopes, differences of column and of row sums, the one that explains the neighbours best.
    """
    best, best_x, best_y, best_d = np.inf, 1.0, 0.0, 0.0
    for upright in range(2):
        g = f.T if upright else f
        h0, h1, h2 = g[:, 0].sum(), g[:, 1].sum(), g[:, 2].sum()
        side = 1.0 if g[0].sum() >= g[2].sum() else -1.0
        for k in range(3):
            slope = h1 - h0 if k == 0 else (h2 - h1 if k == 1 else (h2 - h0) / 2)
            size = abs(slope) + 1
            a, b = -slope / size, side / size
            nx, ny = (b, a) if upright else (a, b)
            d = _offset_of(nx, ny, f[1, 1])
            error = 0.0
            for i in range(3):
                for j in range(3):
                    error += (_share_below(nx, ny, d - nx * (j - 1) - ny * (i - 1)) - f[i, j]) ** 2
            if error < best:
                best, best_x, best_y, best_d = error, nx, ny, d
    return best_x, best_y, best_d


@njit(cache=True)
def find_edges(image):
    """Return (index, lines): index (rows, columns) int32 into lines, -1 where smooth; lines (n, 5): nx, ny, d, dark,
    bright.
    """
    rows, columns = image.shape
    index = np.full((rows, columns), -1, np.int32)
    n = 0
    for i in range(rows):
        for j in range(columns):
            low = high = image[i, j]
            for k in range(max(i - 1, 0), min(i + 2, rows)):
                for l in range(max(j - 1, 0), min(j + 2, columns)):
                    low, high = min(low, image[k, l]), max(high, image[k, l])
            spare = np.float32(1e-3) * (high - low)
            if high - low > MIN_CONTRAST and low + spare < image[i, j] < high - spare:
                index[i, j] = n
                n += 1
    lines = np.empty((n, 5), np.float32)
    f = np.empty((3, 3))
    for i in range(rows):
        for j in range(columns):
            if index[i, j] < 0:
                continue
            low, high = np.float32(np.inf), np.float32(-np.inf)
            for k in range(3):
                for l in range(3):
                    f[k, l] = image[min(max(i + k - 1, 0), rows - 1), min(max(j + l - 1, 0), columns - 1)]
                    low, high = min(low, f[k, l]), max(high, f[k, l])
            for k in range(3):
                for l in range(3):
                    f[k, l] = (f[k, l] - low) / (high - low)
            nx, ny, d = _fit_line(f)
            line = lines[index[i, j]]
            line[0], line[1], line[2], line[3], line[4] = nx, ny, d, low, high
    return index, lines


@njit(cache=True)
def _bilinear(image, u, v):
    rows, columns = image.shape
    j, i = min(int(u), columns - 2), min(int(v), rows - 2)
    fx, fy = u - j, v - i
    top = image[i, j] + fx * (image[i, j + 1] - image[i, j])
    bottom = image[i + 1, j] + fx * (image[i + 1, j + 1] - image[i + 1, j])
    return top + fy * (bottom - top)


@njit(cache=True)
def _clamp(value, last):
    # NaN compares false: such elements take the first value
    return min(value, np.float32(last)) if value > 0 else np.float32(0)


@njit(cache=True)
def _edge_near(index, image, u, v, reach_x, reach_y):
    """Return whether the footprint about (u, v) meets an edge: a pixel that has one, or two unlike pixels."""
    rows, columns = index.shape
    j0, j1 = int(_clamp(u - reach_x + 0.5, columns - 1)), int(_clamp(u + reach_x + 0.5, columns - 1))
    i0, i1 = int(_clamp(v - reach_y + 0.5, rows - 1)), int(_clamp(v + reach_y + 0.5, rows - 1))
    low = high = image[i0, j0]
    for i in range(i0, i1 + 1):
        for j in range(j0, j1 + 1):
            if index[i, j] >= 0:
                return True
            low, high = min(low, image[i, j]), max(high, image[i, j])
    return high - low > MIN_CONTRAST


@njit(cache=True)
def _sample_plane(image, index, lines, x, y, lattice, out):
    rows, columns = image.shape
    height, width = x.shape
    half = np.float32(0.5)
    for r in range(height):
        above, below = max(r - 1, 0), min(r + 1, height - 1)
        for c in range(width):
            left, right = max(c - 1, 0), min(c + 1, width - 1)
            u, v = x[r, c], y[r, c]
            # the footprint: a parallelogram, from differences of the map
            ux, vx = (x[r, right] - x[r, left]) / (right - left), (y[r, right] - y[r, left]) / (right - left)
            uy, vy = (x[below, c] - x[above, c]) / (below - above), (y[below, c] - y[above, c]) / (below - above)
            if not _edge_near(index, image, u, v, (abs(ux) + abs(uy)) / 2, (abs(vx) + abs(vy)) / 2):
                out[r, c] = _bilinear(image, _clamp(u, columns - 1), _clamp(v, rows - 1))
                continue
            total = np.float32(0)
            for k in range(lattice.shape[0]):
                su = _clamp(u + ux * lattice[k, 0] + uy * lattice[k, 1], columns - 1)
                sv = _clamp(v + vx * lattice[k, 0] + vy * lattice[k, 1], rows - 1)
                j, i = int(su + half), int(sv + half)
                n = index[i, j]
                if n < 0:
                    total += image[i, j]
                else:
                    bright = lines[n, 0] * (su - j) + lines[n, 1] * (sv - i) < lines[n, 2]
                    total += lines[n, 4] if bright else lines[n, 3]
            out[r, c] = total / lattice.shape[0]


def sample(image, x, y):
    """Return the image (rows, columns, channels) at array coordinates x, y (float32, of one shape (m, n)), as
    (m, n, channels) float32.
    """
    out = np.empty((*x.shape, image.shape[2]), np.float32)
    for k in range(image.shape[2]):
        plane, moved = np.ascontiguousarray(image[..., k], np.float32), np.empty(x.shape, np.float32)
        _sample_plane(plane, *find_edges(plane), x, y, LATTICE, moved)
        out[..., k] = moved
    return out


@njit(cache=True)
def _cubic(t, p0, p1, p2, p3):
    return p1 + 0.5 * t * (p2 - p0 + t * (2 * p0 - 5 * p1 + 4 * p2 - p3 + t * (3 * (p1 - p2) + p3 - p0)))


@njit(cache=True)
def fine_map(grid, step, shape):
    """Return a coarse map at every array element, float32: Catmull-Rom between nodes ``step`` apart, one node before
    the first element and two after the last.
    """
    out = np.empty(shape, np.float32)
    line = np.empty(grid.shape[1])
    for r in range(shape[0]):
        k = r // step + 1
        t = (r % step) / step
        for n in range(grid.shape[1]):
            line[n] = _cubic(t, grid[k - 1, n], grid[k, n], grid[k + 1, n], grid[k + 2, n])
        for c in range(shape[1]):
            n = c // step + 1
            out[r, c] = _cubic((c % step) / step, line[n - 1], line[n], line[n + 1], line[n + 2])
    return out
