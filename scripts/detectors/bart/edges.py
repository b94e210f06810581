"""Exact corners: each side of the black frame measured to a few hundredths of a pixel, neighbours intersected.

Along a side, each pixel column (or row) that crosses it gives one point: where between the paper's level and the
frame's level the sum of its pixels puts the edge (partial area effect, Trujillo-Pino et al. 2013). The blur of a
lens and the pixel's box are symmetric and so leave that point where it is, in linear light. No half pixel
enters: positions are those of pixel centres.
"""

import numpy as np

from detectors.bart.codes import read_levels, square_to_quad
from kernels import njit


def srgb_to_linear():
    """Return the linear light (0..255) of the 256 sRGB grey levels (IEC 61966-2-1), float32."""
    s = np.arange(256) / 255
    return (255 * np.where(s <= 0.04045, s / 12.92, ((s + 0.055) / 1.055) ** 2.4)).astype(np.float32)


def identity():
    """Return the light (0..255) of the 256 grey levels of an image that holds linear light, float32."""
    return np.arange(256, dtype=np.float32)


@njit(cache=True, nogil=True)
def _line(t, e, use, n):
    """Return (offset, slope, count) of the least squares line e = offset + slope (t - t[0]) over the points in use."""
    s = st = se = stt = ste = 0.0
    for k in range(n):
        if use[k]:
            x = t[k] - t[0]
            s += 1
            st += x
            se += e[k]
            stt += x * x
            ste += x * e[k]
    det = s * stt - st * st
    if s < 3 or det <= 0:
        return 0.0, 0.0, 0
    slope = (s * ste - st * se) / det
    return (se - slope * st) / s, slope, int(s)


@njit(cache=True, nogil=True, inline="always")
def _margin(dy, dx, steep, heading, half):
    """Return how far from a corner, along the scan's axis, windows stay clear of the side (dx, dy) that leaves it."""
    t, e = (dy, dx) if steep else (dx, dy)
    lean = heading * t / max(abs(e), 1e-3)
    return 2.0 + (half + 1.5) * max(lean, 0.0)


@njit(cache=True, nogil=True)
def measure_side(image, light, before, p, q, after, thickness, line):
    """Write the line (a, b, c), a x + b y + c = 0, of the edge near the side p to q; return its points.

    image      uint8; light (256,) its levels' light
    p, q       ends of the side, clockwise as seen, so that the paper lies to the left; before, after: next corners
    thickness  of the black frame, pixels
    points     how many columns or rows carried the line; 0 where there is no edge
    """
    rows, columns = image.shape
    dx, dy = q[0] - p[0], q[1] - p[1]
    steep = abs(dy) > abs(dx)
    if steep:
        t0, t1, e0, along, across = p[1], q[1], p[0], dy, dx
        sign = 1.0 if dy > 0 else -1.0  # which way of the scan the paper lies
        n_t, n_e = rows, columns
    else:
        t0, t1, e0, along, across = p[0], q[0], p[1], dx, dy
        sign = -1.0 if dx > 0 else 1.0
        n_t, n_e = columns, rows
    if along == 0:
        return 0
    slope = across / along
    reach = thickness * np.sqrt(1 + slope * slope)  # the frame along the scan
    half = min(max(int(reach - 1.5), 2), int(3 * np.sqrt(1 + slope * slope) + 0.5))
    # Near an acute corner the window would run through the neighbouring side.
    heading = 1.0 if along > 0 else -1.0
    start = _margin(before[1] - p[1], before[0] - p[0], steep, heading, half)
    end = _margin(after[1] - q[1], after[0] - q[0], steep, -heading, half)
    if start + end > 0.6 * abs(along):
        start, end = start * 0.6 * abs(along) / (start + end), end * 0.6 * abs(along) / (start + end)
    if heading < 0:
        start, end = end, start
    first = max(int(np.ceil(min(t0, t1) + start)), 0)
    last = min(int(np.floor(max(t0, t1) - end)), n_t - 1)
    count = last - first + 1
    if count < 3:
        return 0
    t = np.empty(count)
    total = np.empty(count)
    white = np.empty(count)
    black = np.empty(count)
    centre = np.empty(count, np.int64)
    n = 0
    for k in range(first, last + 1):
        c = int(np.floor(e0 + slope * (k - t0) + 0.5))
        if c - half < 0 or c + half >= n_e:
            continue
        s = 0.0
        for r in range(c - half, c + half + 1):
            s += light[image[k, r]] if steep else light[image[r, k]]
        low = light[image[k, c - half]] if steep else light[image[c - half, k]]
        high = light[image[k, c + half]] if steep else light[image[c + half, k]]
        t[n], total[n], centre[n] = k, s, c
        white[n] = high if sign > 0 else low
        black[n] = low if sign > 0 else high
        n += 1
    if n < 3:
        return 0
    use = np.ones(n, np.bool_)
    w0, w1, _ = _line(t, white, use, n)
    b0, b1, _ = _line(t, black, use, n)
    edge = np.empty(n)
    for k in range(n):
        x = t[k] - t[0]
        high, low = w0 + w1 * x, b0 + b1 * x
        if high - low < 1e-3:
            return 0
        # Black pixels counted from the inner end of the window.
        dark = ((2 * half + 1) * high - total[k]) / (high - low)
        edge[k] = centre[k] + sign * (dark - half - 0.5)
    a0, a1, m = _line(t, edge, use, n)
    for _ in range(2):
        square = 0.0
        for k in range(n):
            if use[k]:
                square += (edge[k] - a0 - a1 * (t[k] - t[0])) ** 2
        limit = max(2.5 * np.sqrt(square / max(m, 1)), 0.02)
        for k in range(n):
            use[k] = abs(edge[k] - a0 - a1 * (t[k] - t[0])) <= limit
        b, c, m = _line(t, edge, use, n)
        if m == 0:
            return 0
        a0, a1 = b, c
    norm = np.sqrt(1 + a1 * a1)
    offset = a0 - a1 * t[0]
    if steep:
        line[0], line[1], line[2] = 1 / norm, -a1 / norm, -offset / norm
    else:
        line[0], line[1], line[2] = -a1 / norm, 1 / norm, -offset / norm
    return m


@njit(cache=True, nogil=True)
def refine_quad(image, light, quad, size, passes, out):
    """Write the quad (4, 2) of the measured sides to ``out``; return whether it worked.

    size  bits a side of the code. It fails where a side has no edge or a corner would move by more than a
    module; ``out`` is then the quad as given.
    """
    lines = np.empty((4, 3))
    line = np.empty(3)
    current = quad.copy()
    out[:] = quad
    n = size + 2
    for _ in range(passes):
        area = 0.0
        for s in range(4):
            t = (s + 1) % 4
            area += 0.5 * (current[s, 0] * current[t, 1] - current[t, 0] * current[s, 1])
        for s in range(4):
            p, q = current[s], current[(s + 1) % 4]
            opposite = current[(s + 2) % 4]
            after = current[(s + 3) % 4]
            length = np.sqrt((q[0] - p[0]) ** 2 + (q[1] - p[1]) ** 2)
            if length < 4:
                return False
            # Distance of the opposite side, its smaller end: how thick the frame is at least.
            d1 = abs((q[0] - p[0]) * (opposite[1] - p[1]) - (q[1] - p[1]) * (opposite[0] - p[0])) / length
            d2 = abs((q[0] - p[0]) * (after[1] - p[1]) - (q[1] - p[1]) * (after[0] - p[0])) / length
            m = measure_side(image, light, after, p, q, opposite, min(d1, d2) / n, line)
            if m == 0:
                return False
            lines[s] = line
        for s in range(4):
            a, b = lines[(s + 3) % 4], lines[s]
            det = a[0] * b[1] - a[1] * b[0]
            if abs(det) < 0.05:
                return False
            current[s, 0] = (a[1] * b[2] - b[1] * a[2]) / det
            current[s, 1] = (b[0] * a[2] - a[0] * b[2]) / det
        limit = max(2.5, np.sqrt(abs(area)) / n)
        for s in range(4):
            if abs(current[s, 0] - quad[s, 0]) > limit or abs(current[s, 1] - quad[s, 1]) > limit:
                return False
    out[:] = current
    return True


@njit(cache=True, nogil=True)
def move_sides(quad, outward):
    """Move the four sides of a quad (4, 2), clockwise, outward by so many pixels, in place."""
    lines = np.empty((4, 3))
    for s in range(4):
        p, q = quad[s], quad[(s + 1) % 4]
        nx, ny = q[1] - p[1], -(q[0] - p[0])
        norm = np.sqrt(nx * nx + ny * ny)
        nx, ny = nx / norm, ny / norm
        lines[s, 0], lines[s, 1], lines[s, 2] = nx, ny, -(nx * p[0] + ny * p[1]) - outward
    for s in range(4):
        a, b = lines[(s + 3) % 4], lines[s]
        det = a[0] * b[1] - a[1] * b[0]
        quad[s, 0] = (a[1] * b[2] - b[1] * a[2]) / det
        quad[s, 1] = (b[0] * a[2] - a[0] * b[2]) / det


@njit(cache=True, nogil=True)
def white_excess(image, light, quad, size, levels):
    """Return (by how many pixels white spreads over black at each edge of the code, length of these edges).

    The light inside the code's frame is added up and compared with the area of the white bits within the measured
    sides; an image whose levels are not the assumed light shows too much (or too little) white by the length of the
    bits' edges times the spread, and sides that lie inward (or outward) by as much.
    quad    (4, 2) measured sides; levels (size + 4, size + 4) light of the cells (codes.read_levels)
    """
    n = size + 2
    h = np.empty(9)
    inverse = np.empty(9)
    if not square_to_quad(quad, h):
        return 0.0, 0.0
    inverse[0] = h[4] - h[5] * h[7]
    inverse[1] = h[2] * h[7] - h[1]
    inverse[2] = h[1] * h[5] - h[2] * h[4]
    inverse[3] = h[5] * h[6] - h[3]
    inverse[4] = h[0] - h[2] * h[6]
    inverse[5] = h[2] * h[3] - h[0] * h[5]
    inverse[6] = h[3] * h[7] - h[4] * h[6]
    inverse[7] = h[1] * h[6] - h[0] * h[7]
    inverse[8] = h[0] * h[4] - h[1] * h[3]
    # Levels of paper and frame, each a plane over the code; the four sides' means carry it.
    paper = np.zeros(4)
    frame = np.zeros(4)
    for k in range(1, n + 1):
        paper[0] += levels[0, k]
        paper[1] += levels[k, n + 1]
        paper[2] += levels[n + 1, k]
        paper[3] += levels[k, 0]
        frame[0] += levels[1, k]
        frame[1] += levels[k, n]
        frame[2] += levels[n, k]
        frame[3] += levels[k, 1]
    paper /= n
    frame /= n
    p0, px, py = paper.mean(), paper[1] - paper[3], paper[2] - paper[0]
    f0, fx, fy = frame.mean(), (frame[1] - frame[3]) * n / (n - 1), (frame[2] - frame[0]) * n / (n - 1)
    middle = f0 + 0.5 * (p0 - f0)
    # Corners of the cells in the image; which bits are white; their area and edges.
    grid = np.empty((n + 1, n + 1, 2))
    for r in range(n + 1):
        for c in range(n + 1):
            w = (h[6] * c + h[7] * r) / n + 1.0
            grid[r, c, 0] = ((h[0] * c + h[1] * r) / n + h[2]) / w
            grid[r, c, 1] = ((h[3] * c + h[4] * r) / n + h[5]) / w
    white = np.zeros((n, n), np.bool_)
    for r in range(1, n - 1):
        for c in range(1, n - 1):
            white[r, c] = levels[r + 1, c + 1] > middle
    area = edges = 0.0
    for r in range(n - 1):
        for c in range(n - 1):
            if white[r, c] != white[r, c + 1]:
                d = grid[r + 1, c + 1] - grid[r, c + 1]
                edges += np.sqrt(d[0] * d[0] + d[1] * d[1])
            if white[r, c] != white[r + 1, c]:
                d = grid[r + 1, c + 1] - grid[r + 1, c]
                edges += np.sqrt(d[0] * d[0] + d[1] * d[1])
            if white[r, c]:
                a = grid[r + 1, c + 1] - grid[r, c]
                b = grid[r + 1, c] - grid[r, c + 1]
                area += 0.5 * (a[0] * b[1] - a[1] * b[0])
    # The light within half a module inside the frame's outer edge: its rim is black, so pixels there need no share.
    y0, y1 = max(int(quad[:, 1].min()), 0), min(int(quad[:, 1].max()) + 1, image.shape[0] - 1)
    rim = 0.5 / n
    total = 0.0
    for y in range(y0, y1 + 1):
        low, high = 1e9, -1e9
        for s in range(4):
            p, q = quad[s], quad[(s + 1) % 4]
            if (p[1] <= y) != (q[1] <= y):
                x = p[0] + (y - p[1]) * (q[0] - p[0]) / (q[1] - p[1])
                low, high = min(low, x), max(high, x)
        for x in range(max(int(low), 0), min(int(high) + 1, image.shape[1] - 1) + 1):
            w = 1 / (inverse[6] * x + inverse[7] * y + inverse[8])
            u = (inverse[0] * x + inverse[1] * y + inverse[2]) * w
            v = (inverse[3] * x + inverse[4] * y + inverse[5]) * w
            if rim < u < 1 - rim and rim < v < 1 - rim:
                black = f0 + fx * (u - 0.5) + fy * (v - 0.5)
                paper_here = p0 + px * (u - 0.5) + py * (v - 0.5)
                total += (light[image[y, x]] - black) / (paper_here - black)
    around = whole = 0.0
    for s in range(4):
        p, q = quad[s], quad[(s + 1) % 4]
        around += np.sqrt((q[0] - p[0]) ** 2 + (q[1] - p[1]) ** 2)
        whole += 0.5 * (p[0] * q[1] - q[0] * p[1])
    return (total - area) / (edges + around * area / whole), edges


@njit(cache=True, nogil=True)
def spread_of_white(image, light, quads, sizes, least_module, most):
    """Return by how many pixels white spreads over black in this image, from the ``most`` largest quads (n, 4, 2).

    0 where no module has ``least_module`` pixels.
    """
    modules = np.empty(len(quads))
    for k in range(len(quads)):
        square = 0.0
        for s in range(4):
            t = (s + 1) % 4
            square += 0.5 * (quads[k, s, 0] * quads[k, t, 1] - quads[k, t, 0] * quads[k, s, 1])
        modules[k] = np.sqrt(abs(square)) / (sizes[k] + 2)
    total = weight = 0.0
    for k in np.argsort(-modules)[:most]:
        levels = np.empty((sizes[k] + 4, sizes[k] + 4))
        module = read_levels(image, light, quads[k], sizes[k], levels)
        if module < least_module or np.isnan(levels).any():
            continue
        spread, edges = white_excess(image, light, quads[k], sizes[k], levels)
        # Blur reaches into the levels of small cells and biases the spread by about 1 / module squared.
        total += edges * module**2 * spread
        weight += edges * module**2
    return total / weight if weight > 0 else 0.0
