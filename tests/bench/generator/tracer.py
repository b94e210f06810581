"""Ray caster: one ray on flats, 1024 low-discrepancy rays in a pixel that an edge may cross.

A pixel grid comes as the camera-frame directions (x, y, 1) of the pixels' corners, already bent by the lens;
inside a pixel directions are interpolated, which is exact to 1e-6 px for any lens here. Each plate is met
through the plane-to-plane map of its own pose, so plates may stand anywhere; a plate always hides the ground.
"""

import numpy as np
from numba import njit


def sobol_net(bits):
    """Return the 2^bits points (N, 2) in [0, 1) of the (0, bits, 2) net van der Corput x Sobol.

    Every box of area 2^-bits whose sides are powers of two holds one point.
    """
    i = np.arange(2**bits, dtype=np.uint32)
    x, y, v = np.zeros(len(i), np.uint32), np.zeros(len(i), np.uint32), np.uint32(1 << 31)
    for bit in range(bits):
        on = ((i >> np.uint32(bit)) & np.uint32(1)).astype(bool)
        x[on] ^= np.uint32(1 << (31 - bit))
        y[on] ^= v
        v = np.uint32(v ^ (v >> np.uint32(1)))
    return np.stack([x, y], 1) / 2.0**32


# At 256 samples an edge pixel is 0.6 DN off (rms), at 1024 0.2 DN. A grid of nine sub-pixels needs fewer in
# each.
PIXEL_NET = sobol_net(10)
SUBPIXEL_NET = sobol_net(8)


@njit(cache=True)
def _hash(a, b):
    """Return a number in [0, 1) that looks random in ``a`` and ``b`` (32-bit mixing; Numba widens, so
    mask).
    """
    mask = np.uint64(0xFFFFFFFF)
    h = (np.uint64(a) * np.uint64(0x9E3779B1) ^ np.uint64(b) * np.uint64(0x85EBCA77)) & mask
    h = ((h ^ (h >> np.uint64(15))) * np.uint64(0x2C1B3C6D)) & mask
    h = ((h ^ (h >> np.uint64(12))) * np.uint64(0x297A2D39)) & mask
    return float(h ^ (h >> np.uint64(15))) / 4294967296.0


@njit(cache=True)
def _cell(cells, i, j):
    if i < 0 or j < 0 or i >= cells.shape[0] or j >= cells.shape[1]:
        return 0
    return cells[i, j]


@njit(cache=True)
def _is_black(cells, u, v, spread):
    """Whether module coordinates (u right, v down) are black, black's outline moved outwards by ``spread``
    modules.
    """
    i, j = int(np.floor(v)), int(np.floor(u))
    own = _cell(cells, i, j)
    if spread == 0.0:
        return own
    wanted = 1 if spread > 0 else 0
    if own == wanted:
        return own
    r = abs(spread)
    fu, fv = u - j, v - i
    for di in range(-1, 2):
        dy = fv if di < 0 else (1 - fv if di > 0 else 0.0)
        if dy >= r:
            continue
        for dj in range(-1, 2):
            dx = fu if dj < 0 else (1 - fu if dj > 0 else 0.0)
            if dx * dx + dy * dy < r * r and _cell(cells, i + di, j + dj) == wanted:
                return wanted
    return own


@njit(cache=True)
def _plate_point(m, x, y):
    w = m[2, 0] * x + m[2, 1] * y + m[2, 2]
    if w <= 1e-9:
        return np.inf, np.inf
    return (m[0, 0] * x + m[0, 1] * y + m[0, 2]) / w, (m[1, 0] * x + m[1, 1] * y + m[1, 2]) / w


@njit(cache=True)
def _curled(a, b, eye, half, rise, axis):
    """Move a hit on the flat plate to the plate curled to z = rise (1 - (s / half)^2), s along ``axis``."""
    a0, b0 = a, b
    for _ in range(6):
        s = a if axis == 0 else b
        z = rise * (1.0 - (s / half) ** 2)
        a = a0 + z * (eye[0] - a0) / eye[2]
        b = b0 + z * (eye[1] - b0) / eye[2]
    return a, b


@njit(cache=True)
def _base(dx, dy, up, ground, background, net, out):
    """Fill ``out`` with ground below the horizon and background above it."""
    rows, columns = out.shape
    for i in range(rows):
        u = up[i if up.shape[0] > 1 else 0]
        for j in range(columns):
            below = 0
            for k in range(4):
                x, y = dx[i + (k >> 1), j + (k & 1)], dy[i + (k >> 1), j + (k & 1)]
                below += u[0] * x + u[1] * y + u[2] < 0
            if below == 4:
                out[i, j] = ground
            elif below == 0:
                out[i, j] = background
            else:
                n = 0
                for s in range(net.shape[0]):
                    fx, fy = net[s, 0], net[s, 1]
                    x = (dx[i, j] * (1 - fx) + dx[i, j + 1] * fx) * (1 - fy)
                    x += (dx[i + 1, j] * (1 - fx) + dx[i + 1, j + 1] * fx) * fy
                    y = (dy[i, j] * (1 - fx) + dy[i, j + 1] * fx) * (1 - fy)
                    y += (dy[i + 1, j] * (1 - fx) + dy[i + 1, j + 1] * fx) * fy
                    n += u[0] * x + u[1] * y + u[2] < 0
                out[i, j] = background + (ground - background) * n / net.shape[0]


@njit(cache=True)
def _box(m, dx, dy, reach, step):
    """Return rows and columns (first, last, first, last) that may see the plate, from every ``step``-th
    ray.
    """
    rows, columns = dx.shape
    i0, i1, j0, j1 = rows, -1, columns, -1
    i = 0
    while True:
        mi = m[min(i, rows - 2) if m.shape[0] > 1 else 0]
        j = 0
        while True:
            a, b = _plate_point(mi, dx[i, j], dy[i, j])
            if abs(a) < reach and abs(b) < reach:
                i0, i1, j0, j1 = min(i0, i), max(i1, i), min(j0, j), max(j1, j)
            if j == columns - 1:
                break
            j = min(j + step, columns - 1)
        if i == rows - 1:
            break
        i = min(i + step, rows - 1)
    return max(i0 - step, 0), min(i1 + step, rows - 2), max(j0 - step, 0), min(j1 + step, columns - 2)


@njit(cache=True)
def trace(dx, dy, up, maps, eyes, cells, half, to_code, spread, curl, curl_axis, levels, net, step):
    """Cast rays and return radiance and plate coverage, both float32 (H, W), pixel = box.

    ``dx``, ``dy`` (H + 1, W + 1): direction (x, y, 1) of the pixels' corners in the camera frame. ``up`` (1
    or H, 3): the world's z in the camera frame, one for all rows or one a row. ``maps`` (P, 1 or H, 3, 3):
    camera direction to plate metres (homogeneous). ``eyes`` (P, 3): camera centre in each plate's frame,
    metres. ``cells`` (P, 7, 7): 1 is black. ``half``: half a plate's side, m. ``to_code`` (P, 2, 3): plate
    metres to module coordinates (u right, v down). ``spread``: growth of black in modules. ``curl`` (P,):
    rise of a curled plate, m. ``levels``: white, black, ground, background. ``step``: pixels between the rays
    that look for plates.
    """
    rows, columns = dx.shape[0] - 1, dx.shape[1] - 1
    white, black = levels[0], levels[1]
    base = np.empty((rows, columns), np.float32)
    _base(dx, dy, up, levels[2], levels[3], net, base)
    out = base.copy()
    cover = np.zeros((rows, columns), np.float32)
    n_net = net.shape[0]
    for p in range(maps.shape[0]):
        m_all, k, grid = maps[p], to_code[p], cells[p]
        i0, i1, j0, j1 = _box(m_all, dx, dy, 2.2 * half, step)
        for i in range(i0, i1 + 1):
            m = m_all[i if m_all.shape[0] > 1 else 0]
            for j in range(j0, j1 + 1):
                a_lo, a_hi, b_lo, b_hi = np.inf, -np.inf, np.inf, -np.inf
                for c in range(4):
                    a, b = _plate_point(m, dx[i + (c >> 1), j + (c & 1)], dy[i + (c >> 1), j + (c & 1)])
                    a_lo, a_hi, b_lo, b_hi = min(a_lo, a), max(a_hi, a), min(b_lo, b), max(b_hi, b)
                if a_hi == np.inf:
                    continue
                if curl[p] != 0.0:
                    pad = abs(curl[p] / eyes[p, 2])
                    pad_a = pad * (abs(eyes[p, 0]) + 3 * half)
                    pad_b = pad * (abs(eyes[p, 1]) + 3 * half)
                    a_lo, a_hi, b_lo, b_hi = a_lo - pad_a, a_hi + pad_a, b_lo - pad_b, b_hi + pad_b
                if a_lo > half or a_hi < -half or b_lo > half or b_hi < -half:
                    continue
                flat = a_lo > -half and a_hi < half and b_lo > -half and b_hi < half
                if flat:
                    u_lo, u_hi, v_lo, v_hi = np.inf, -np.inf, np.inf, -np.inf
                    for c in range(4):
                        a = a_lo if c & 1 else a_hi
                        b = b_lo if c & 2 else b_hi
                        u = k[0, 0] * a + k[0, 1] * b + k[0, 2]
                        v = k[1, 0] * a + k[1, 1] * b + k[1, 2]
                        u_lo, u_hi, v_lo, v_hi = min(u_lo, u), max(u_hi, u), min(v_lo, v), max(v_hi, v)
                    pad = abs(spread) + 1e-9
                    r0, r1 = int(np.floor(v_lo - pad)), int(np.floor(v_hi + pad))
                    c0, c1 = int(np.floor(u_lo - pad)), int(np.floor(u_hi + pad))
                    first = _cell(grid, r0, c0)
                    for r in range(r0, r1 + 1):
                        for c in range(c0, c1 + 1):
                            if _cell(grid, r, c) != first:
                                flat = False
                    if flat:
                        out[i, j] = black if first else white
                        cover[i, j] = 1.0
                        continue
                n_in, n_black = 0, 0
                su, sv = _hash(i * columns + j, 2 * p), _hash(i * columns + j, 2 * p + 1)
                x00, x01, x10, x11 = dx[i, j], dx[i, j + 1], dx[i + 1, j], dx[i + 1, j + 1]
                y00, y01, y10, y11 = dy[i, j], dy[i, j + 1], dy[i + 1, j], dy[i + 1, j + 1]
                for s in range(n_net):
                    fx, fy = net[s, 0] + su, net[s, 1] + sv
                    if fx >= 1.0:
                        fx -= 1.0
                    if fy >= 1.0:
                        fy -= 1.0
                    x = (x00 + (x01 - x00) * fx) * (1 - fy) + (x10 + (x11 - x10) * fx) * fy
                    y = (y00 + (y01 - y00) * fx) * (1 - fy) + (y10 + (y11 - y10) * fx) * fy
                    a, b = _plate_point(m, x, y)
                    if curl[p] != 0.0:
                        a, b = _curled(a, b, eyes[p], half, curl[p], curl_axis)
                    if abs(a) <= half and abs(b) <= half:
                        n_in += 1
                        u = k[0, 0] * a + k[0, 1] * b + k[0, 2]
                        v = k[1, 0] * a + k[1, 1] * b + k[1, 2]
                        n_black += _is_black(grid, u, v, spread)
                out[i, j] += (n_in * white + n_black * (black - white) - n_in * base[i, j]) / n_net
                cover[i, j] += n_in / n_net
    return out, cover
