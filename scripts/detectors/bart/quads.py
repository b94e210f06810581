"""From dark regions to quadrilaterals: their outer borders, four lines each; small ones are looked at more finely.

Compiled with numba; nothing here knows of codes. Pixel coordinates are those of the image that was binarised.
"""

import numpy as np

from detectors.bart.regions import candidates, components
from kernels import njit

# Moore neighbourhood, clockwise from the right (y down).
STEP_Y = np.array([0, 1, 1, 1, 0, -1, -1, -1], np.int64)
STEP_X = np.array([1, 1, 0, -1, -1, -1, 0, 1], np.int64)

SMALLEST_PX = 6  # longer side of the smallest region that is looked at
RETRY_PX = 32  # longer side of the largest region that a finer look may help: larger ones lack no pixels
THIN_PX = 48  # the same for regions of thin lines
SHAPELESS_PX = 14  # shorter side: below it a marker's shape may be lost; above, what is no quadrilateral is no marker
LONG_PX = 64  # longer side of the largest region with such a short one: a marker seen at a grazing angle

# Cubic interpolation (Keys 1981, a = -0.75 as in OpenCV) half way between the pixels of a doubled image.
CUBIC = np.array([-0.10546875, 0.87890625, 0.26171875, -0.03515625])


@njit(cache=True, nogil=True)
def follow_border(binary, x, y, limit, px, py):
    """Write the outer border from the region's top left pixel to px, py; return its length, 0 beyond ``limit``.

    Moore's border following, clockwise. The image has a border of zeros, so that no index leaves it.
    """
    px[0], py[0] = x, y
    n, cx, cy = 1, x, y
    came = 4  # from the left, which is white at the start
    first_step = -1
    while True:
        step = -1
        for k in range(1, 9):
            d = (came + k) & 7
            if binary[cy + STEP_Y[d], cx + STEP_X[d]] != 0:
                step = d
                break
        if step < 0:
            return 1
        if cx == x and cy == y:
            if first_step < 0:
                first_step = step
            elif step == first_step:
                return n - 1
        cx += STEP_X[step]
        cy += STEP_Y[step]
        came = (step + 4) & 7
        if n >= limit:
            return 0
        px[n], py[n] = cx, cy
        n += 1


@njit(cache=True, nogil=True)
def _farthest_on_arc(px, py, n, i, j):
    """Return (index, distance) of the border point farthest from the chord i to j, on the arc from i to j."""
    ax, ay = px[i], py[i]
    dx, dy = px[j] - ax, py[j] - ay
    best, where = -1, i
    m = (j - i) % n
    for k in range(1, m):
        q = i + k
        if q >= n:
            q -= n
        x, y = px[q] - ax, py[q] - ay
        d = abs(x * dy - y * dx) if dx != 0 or dy != 0 else x * x + y * y
        if d > best:
            best, where = d, q
    if best < 0:
        return where, -1.0
    length = np.sqrt(float(dx * dx + dy * dy))
    return where, best / length if length > 0 else np.sqrt(float(best))


@njit(cache=True, nogil=True)
def four_vertices(px, py, n, vertices):
    """Write the indices of the four border points that carry the region's shape, in border order."""
    a, best = 0, -1
    for k in range(n):
        d = (px[k] - px[0]) ** 2 + (py[k] - py[0]) ** 2
        if d > best:
            a, best = k, d
    c, best = a, -1
    for k in range(n):
        d = (px[k] - px[a]) ** 2 + (py[k] - py[a]) ** 2
        if d > best:
            c, best = k, d
    found = np.empty(4, np.int64)
    found[0], found[1] = a, c
    for have in range(2, 4):
        widest, place, after = -1.0, 0, 0
        for s in range(have):
            q, d = _farthest_on_arc(px, py, n, found[s], found[(s + 1) % have])
            if d > widest:
                widest, place, after = d, q, s
        if widest < 1.0:
            return False
        for s in range(have, after + 1, -1):
            found[s] = found[s - 1]
        found[after + 1] = place
    vertices[:] = found
    return True


@njit(cache=True, nogil=True)
def fit_quad(px, py, n, quad):
    """Write the quad (4, 2) whose sides are lines fitted to the border; return how well it fits.

    0: no quadrilateral; 1: roughly one; 2: its sides are straight to about a pixel. Corners are in border order
    (clockwise as seen), sides moved outward by half a pixel, from the centres of dark pixels to the edge.
    """
    vertices = np.empty(4, np.int64)
    if n < 8 or not four_vertices(px, py, n, vertices):
        return 0
    lines = np.empty((4, 3))
    straight = True
    for s in range(4):
        i, j = vertices[s], vertices[(s + 1) % 4]
        m = (j - i) % n
        if m < 2:
            return 0
        skip = m // 6
        sx = sy = sxx = sxy = syy = 0.0
        count = 0
        for k in range(skip, m - skip + 1):
            q = (i + k) % n
            x, y = float(px[q]), float(py[q])
            sx += x
            sy += y
            sxx += x * x
            sxy += x * y
            syy += y * y
            count += 1
        mx, my = sx / count, sy / count
        vxx, vxy, vyy = sxx / count - mx * mx, sxy / count - mx * my, syy / count - my * my
        angle = 0.5 * np.arctan2(2 * vxy, vxx - vyy)
        nx, ny = -np.sin(angle), np.cos(angle)
        # Outward is to the left of the clockwise walk.
        if nx * (py[j] - py[i]) - ny * (px[j] - px[i]) < 0:
            nx, ny = -nx, -ny
        rms = np.sqrt(max(vxx * nx * nx + 2 * vxy * nx * ny + vyy * ny * ny, 0.0))
        if rms > 0.5 + 0.012 * m:
            straight = False
        if rms > 1.0 + 0.04 * m:
            return 0
        lines[s, 0], lines[s, 1], lines[s, 2] = nx, ny, -(nx * mx + ny * my) - 0.5
    for s in range(4):
        a, b = lines[(s + 3) % 4], lines[s]
        det = a[0] * b[1] - a[1] * b[0]
        if abs(det) < 0.1:
            return 0
        quad[s, 0] = (a[1] * b[2] - b[1] * a[2]) / det
        quad[s, 1] = (b[0] * a[2] - a[0] * b[2]) / det
        v = vertices[s]
        reach = 2.0 + 0.1 * ((vertices[(s + 1) % 4] - v) % n)
        if abs(quad[s, 0] - px[v]) > reach or abs(quad[s, 1] - py[v]) > reach:
            return 0
    for s in range(4):
        ax, ay = quad[(s + 1) % 4, 0] - quad[s, 0], quad[(s + 1) % 4, 1] - quad[s, 1]
        bx, by = quad[(s + 2) % 4, 0] - quad[(s + 1) % 4, 0], quad[(s + 2) % 4, 1] - quad[(s + 1) % 4, 1]
        if ax * by - ay * bx <= 0:
            return 0
    return 2 if straight else 1


@njit(cache=True, nogil=True)
def quads_of(regions, binary):
    """Return (quads float64 (n, 4, 2), boxes int32 (m, 4) of small regions that deserve a finer look).

    regions   candidates; binary: uint8 with a border of zeros of at least one pixel, 255 is dark
    """
    quads = np.empty((len(regions), 4, 2))
    boxes = np.empty((len(regions), 4), np.int32)
    n_quads = n_boxes = 0
    size = 4 * (binary.shape[0] + binary.shape[1])
    px = np.empty(size, np.int64)
    py = np.empty(size, np.int64)
    quad = np.empty((4, 2))
    for k in range(len(regions)):
        x0, y0, x1, y1, area, sx, sy = regions[k]
        w, h = x1 - x0 + 1, y1 - y0 + 1
        # A convex region's border has at most 2 (w + h) points.
        n = follow_border(binary, sx, sy, min(size, int(2.5 * (w + h)) + 8), px, py)
        if n == 0:
            continue
        fit = fit_quad(px, py, n, quad)
        if fit == 2:
            quads[n_quads] = quad
            n_quads += 1
        small = (fit > 0 and max(w, h) <= RETRY_PX) or (min(w, h) < SHAPELESS_PX and max(w, h) <= LONG_PX)
        # A thin frame, seen at a grazing angle, falls to pieces when shrunk: little area in a large box.
        if small or (fit == 0 and max(w, h) <= THIN_PX and min(w, h) >= 16 and 4 * area < w * h):
            boxes[n_boxes, 0], boxes[n_boxes, 1], boxes[n_boxes, 2], boxes[n_boxes, 3] = x0, y0, x1, y1
            n_boxes += 1
    return quads[:n_quads], boxes[:n_boxes]


@njit(cache=True, nogil=True)
def _doubled(image, x0, y0, x1, y1):
    """Return the crop at twice the size, float32; its first pixel's centre is a quarter pixel before the crop's."""
    h, w = y1 - y0, x1 - x0
    c0, c1, c2, c3 = CUBIC
    row = np.empty(w + 4, np.float32)
    wide = np.empty((h + 4, 2 * w), np.float32)
    for y in range(h + 4):
        at = min(max(y0 + y - 2, 0), image.shape[0] - 1)
        for x in range(w + 4):
            row[x] = image[at, min(max(x0 + x - 2, 0), image.shape[1] - 1)]
        for x in range(w):
            wide[y, 2 * x] = c3 * row[x] + c2 * row[x + 1] + c1 * row[x + 2] + c0 * row[x + 3]
            wide[y, 2 * x + 1] = c0 * row[x + 1] + c1 * row[x + 2] + c2 * row[x + 3] + c3 * row[x + 4]
    out = np.empty((2 * h, 2 * w), np.float32)
    for y in range(h):
        a, b, c, d, e = wide[y], wide[y + 1], wide[y + 2], wide[y + 3], wide[y + 4]
        up, down = out[2 * y], out[2 * y + 1]
        for x in range(2 * w):
            up[x] = c3 * a[x] + c2 * b[x] + c1 * c[x] + c0 * d[x]
            down[x] = c0 * b[x] + c1 * c[x] + c2 * d[x] + c3 * e[x]
    return out


@njit(cache=True, nogil=True)
def _binarised(crop, window, offset):
    """Return the padded binary image: dark is ``offset`` below the mean of the window; the edge is repeated outside."""
    h, w = crop.shape
    r = window // 2
    column = np.zeros(w + 2 * r + 1, np.float32)  # running sum along x of the sums along y
    below = np.zeros(w, np.float32)
    out = np.zeros((h + 2, (w + 2 + 7) // 8 * 8), np.uint8)
    for y in range(-r, r):
        below += crop[min(max(y, 0), h - 1)]
    count = np.float32(window * window)
    for y in range(h):
        below += crop[min(y + r, h - 1)]
        total = np.float32(0)
        for x in range(w + 2 * r):
            total += below[min(max(x - r, 0), w - 1)]
            column[x + 1] = total
        row, to = crop[y], out[y + 1]
        for x in range(w):
            to[x + 1] = 255 if (row[x] + offset) * count < column[x + window] - column[x] else 0
        below -= crop[max(y - r, 0)]
    return out


@njit(cache=True, nogil=True)
def _is_plain(image, box, least):
    """Return whether the middle of a box, where a marker would have bits, spans fewer grey levels than ``least``."""
    cx, cy = 0.5 * (box[0] + box[2]), 0.5 * (box[1] + box[3])
    w, h = box[2] - box[0] + 1, box[3] - box[1] + 1
    low, high = 255, 0
    for y in range(max(int(cy - 0.35 * h), 0), min(int(cy + 0.35 * h) + 1, image.shape[0] - 1) + 1):
        for x in range(max(int(cx - 0.35 * w), 0), min(int(cx + 0.35 * w) + 1, image.shape[1] - 1) + 1):
            if abs(x - cx) / w + abs(y - cy) / h <= 0.42:
                low, high = min(low, image[y, x]), max(high, image[y, x])
    return high - low < least


@njit(cache=True, nogil=True)
def search_boxes(image, boxes, doubled, window, offset, least_contrast):
    """Return what quads_of returns, for crops round boxes (m, 4) of ``image``: quads and smaller regions, its pixels.

    doubled  whether to magnify the crops twice
    """
    quads = np.empty((64, 4, 2))
    rest = np.empty((64, 4), np.int32)
    n_quads = n_rest = 0
    for k in range(len(boxes)):
        x0, y0 = max(boxes[k, 0] - 4, 0), max(boxes[k, 1] - 4, 0)
        x1, y1 = min(boxes[k, 2] + 5, image.shape[1]), min(boxes[k, 3] + 5, image.shape[0])
        crop = image[y0:y1, x0:x1]
        if crop.shape[0] < 6 or crop.shape[1] < 6:
            continue
        low, high = 255, 0
        for y in range(crop.shape[0]):
            for x in range(crop.shape[1]):
                low, high = min(low, crop[y, x]), max(high, crop[y, x])
        if high - low < least_contrast or _is_plain(image, boxes[k], 0.2 * (high - low)):
            continue
        large = _doubled(image, x0, y0, x1, y1) if doubled else crop.astype(np.float32)
        binary = _binarised(large, window, offset)
        regions = components(binary.view(np.uint64))
        found, small = quads_of(candidates(regions, SMALLEST_PX, 1 << 20), binary)
        scale = 0.5 if doubled else 1.0
        for j in range(len(found)):
            if n_quads == len(quads):
                grown = np.empty((2 * n_quads, 4, 2))
                grown[:n_quads] = quads
                quads = grown
            for c in range(4):
                # Minus the padding; a pixel's centre in the crop, then in the image.
                quads[n_quads, c, 0] = (found[j, c, 0] - 0.5) * scale - 0.5 + x0
                quads[n_quads, c, 1] = (found[j, c, 1] - 0.5) * scale - 0.5 + y0
            n_quads += 1
        for j in range(len(small)):
            if n_rest == len(rest):
                more = np.empty((2 * n_rest, 4), np.int32)
                more[:n_rest] = rest
                rest = more
            rest[n_rest, 0] = int((small[j, 0] - 1) * scale) + x0
            rest[n_rest, 1] = int((small[j, 1] - 1) * scale) + y0
            rest[n_rest, 2] = int(small[j, 2] * scale) + x0
            rest[n_rest, 3] = int(small[j, 3] * scale) + y0
            n_rest += 1
    return quads[:n_quads], rest[:n_rest]
