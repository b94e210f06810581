"""Exact corners: each side of the black frame measured to a few hundredths of a pixel, neighbours intersected.

Along a side, each pixel column (or row) that crosses it gives one point: where between the paper's level and the
frame's level the sum of its pixels puts the edge (partial area effect, Trujillo-Pino et al. 2013). The blur of a
lens and the pixel's box are symmetric and so leave that point where it is, in linear light. No half pixel
enters: positions are those of pixel centres.
"""

import numpy as np
from numba import njit


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


@njit(cache=True, nogil=True)
def measure_side(image, light, p, q, thickness, line):
    """Write the line (a, b, c), a x + b y + c = 0, of the edge near the side p to q; return (points, skew).

    image      uint8; light (256,) its levels' light
    p, q       ends of the side, clockwise as seen, so that the paper lies to the left
    thickness  of the black frame, pixels
    skew       mean of (edge by area - edge by half level), pixels outward: 0 where the light is right
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
        return 0, 0.0
    slope = across / along
    reach = thickness * np.sqrt(1 + slope * slope)  # the frame along the scan
    half = min(max(int(reach - 1.5), 2), 5)
    margin = min(half + 1.5, 0.25 * abs(along))
    first = max(int(np.ceil(min(t0, t1) + margin)), 0)
    last = min(int(np.floor(max(t0, t1) - margin)), n_t - 1)
    count = last - first + 1
    if count < 3:
        return 0, 0.0
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
        return 0, 0.0
    use = np.ones(n, np.bool_)
    w0, w1, _ = _line(t, white, use, n)
    b0, b1, _ = _line(t, black, use, n)
    edge = np.empty(n)
    for k in range(n):
        x = t[k] - t[0]
        high, low = w0 + w1 * x, b0 + b1 * x
        if high - low < 1e-3:
            return 0, 0.0
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
            return 0, 0.0
        a0, a1 = b, c
    # Where the level passes half way, by linear interpolation along the scan.
    skew, halves = 0.0, 0
    for k in range(n):
        if not use[k]:
            continue
        x = t[k] - t[0]
        middle = 0.5 * (w0 + w1 * x + b0 + b1 * x)
        at = int(t[k])
        i = centre[k] - int(sign) * half
        previous = light[image[at, i]] if steep else light[image[i, at]]
        for _ in range(2 * half):
            i += int(sign)
            value = light[image[at, i]] if steep else light[image[i, at]]
            if previous < middle <= value:
                crossing = i - sign * (value - middle) / (value - previous)
                skew += sign * (edge[k] - crossing)
                halves += 1
                break
            previous = value
    norm = np.sqrt(1 + a1 * a1)
    if halves > 0:
        skew = skew / halves / norm
    offset = a0 - a1 * t[0]
    if steep:
        line[0], line[1], line[2] = 1 / norm, -a1 / norm, -offset / norm
    else:
        line[0], line[1], line[2] = -a1 / norm, 1 / norm, -offset / norm
    return m, skew


@njit(cache=True, nogil=True)
def refine_quad(image, light, quad, size, passes, out):
    """Write the quad (4, 2) of the measured sides to ``out``; return (whether it worked, mean skew in pixels).

    size  bits a side of the code. It fails where a side has no edge or a corner would move by more than a
    module; ``out`` is then the quad as given.
    """
    lines = np.empty((4, 3))
    line = np.empty(3)
    current = quad.copy()
    out[:] = quad
    n = size + 2
    skew = 0.0
    for _ in range(passes):
        area = 0.0
        for s in range(4):
            t = (s + 1) % 4
            area += 0.5 * (current[s, 0] * current[t, 1] - current[t, 0] * current[s, 1])
        skew, points = 0.0, 0
        for s in range(4):
            p, q = current[s], current[(s + 1) % 4]
            opposite = current[(s + 2) % 4]
            after = current[(s + 3) % 4]
            length = np.sqrt((q[0] - p[0]) ** 2 + (q[1] - p[1]) ** 2)
            if length < 4:
                return False, 0.0
            # Distance of the opposite side, its smaller end: how thick the frame is at least.
            d1 = abs((q[0] - p[0]) * (opposite[1] - p[1]) - (q[1] - p[1]) * (opposite[0] - p[0])) / length
            d2 = abs((q[0] - p[0]) * (after[1] - p[1]) - (q[1] - p[1]) * (after[0] - p[0])) / length
            m, bent = measure_side(image, light, p, q, min(d1, d2) / n, line)
            if m == 0:
                return False, 0.0
            lines[s] = line
            skew += bent * m
            points += m
        skew /= points
        for s in range(4):
            a, b = lines[(s + 3) % 4], lines[s]
            det = a[0] * b[1] - a[1] * b[0]
            if abs(det) < 0.05:
                return False, 0.0
            current[s, 0] = (a[1] * b[2] - b[1] * a[2]) / det
            current[s, 1] = (b[0] * a[2] - a[0] * b[2]) / det
        limit = max(2.5, np.sqrt(abs(area)) / n)
        for s in range(4):
            if abs(current[s, 0] - quad[s, 0]) > limit or abs(current[s, 1] - quad[s, 1]) > limit:
                return False, 0.0
    out[:] = current
    return True, skew


@njit(cache=True, nogil=True)
def exact_corners(image, light_a, light_b, quads, sizes, share_of_b):
    """Refine quads (n, 4, 2) in place between two assumptions of the image's light; return the share of b taken.

    share_of_b  0: light a; 1: light b; negative: the share at which the edges of all markers together are
                symmetric, as blurred edges are in linear light. Where edges are too few or too sharp to tell, b.
    """
    n = len(quads)
    a = np.empty((n, 4, 2))
    b = np.empty((n, 4, 2))
    worked = np.zeros(n, np.bool_)
    skew_a = skew_b = 0.0
    found = 0
    for k in range(n):
        ok_a, sa = refine_quad(image, light_a, quads[k], sizes[k], 2, a[k])
        ok_b, sb = refine_quad(image, light_b, quads[k], sizes[k], 2, b[k])
        worked[k] = ok_a and ok_b
        if worked[k]:
            skew_a += sa
            skew_b += sb
            found += 1
    share = share_of_b
    if share < 0:
        share = 1.0
        if found > 0:
            skew_a /= found
            skew_b /= found
            change = skew_a - skew_b
            # Noise of a hundredth of a pixel in the skew pulls the share towards b where there is little to see.
            share = (skew_a * change + 1e-4) / (change * change + 1e-4)
            share = min(max(share, -0.25), 1.25)
    for k in range(n):
        if worked[k]:
            quads[k] = a[k] + share * (b[k] - a[k])
    return share
