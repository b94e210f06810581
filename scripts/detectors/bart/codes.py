"""Codes as bit matrices: tables of all ids in all four turns, and reading a quadrilateral's bits.

Compiled with numba. A code of n x n bits is one uint64, row by row, the most significant first.
"""

import cv2
import numpy as np

from kernels import njit
from markers.contract import opencv_dictionary

NO_CODE = -1


def code_tables(names):
    """Return a list of groups of dictionaries with the same number of bits.

    Each group is a dict: ``size`` bits a side, ``names``, ``words`` uint64 (n,) all codes in all four turns,
    ``owner`` int32 (n, 3): index into names, id, quarter turns; ``wrong_bits`` int32 a dictionary: how many wrong
    bits its distance forgives with one to spare (0 below a minimum distance of 5).
    """
    groups = {}
    for name in names:
        d = opencv_dictionary(name)
        size = d.markerSize
        weights = np.uint64(1) << np.arange(size * size - 1, -1, -1, dtype=np.uint64)
        bits = np.stack([cv2.aruco.Dictionary.getBitsFromByteList(b[None], size) for b in d.bytesList])
        # Four turns of each id, side by side, clockwise.
        turned = np.stack([np.rot90(bits, -turn, axes=(1, 2)) for turn in range(4)], axis=1)
        words = (turned.reshape(-1, size * size).astype(np.uint64) * weights).sum(axis=1, dtype=np.uint64)
        ids, turns = np.repeat(np.arange(len(bits)), 4), np.tile(np.arange(4), len(bits))
        # A code that looks the same after a turn has no corner order: it cannot be reported honestly.
        unique, counts = np.unique(words, return_counts=True)
        good = ~np.isin(words, unique[counts > 1])
        group = groups.setdefault(size, {"size": size, "names": [], "words": [], "owner": [], "wrong_bits": []})
        index = len(group["names"])
        group["names"].append(name)
        group["words"].append(words[good])
        group["owner"].append(np.stack([np.full(good.sum(), index), ids[good], turns[good]], axis=1))
        group["wrong_bits"].append(max(0, (minimum_distance(words, ids) - 3) // 2))
    for group in groups.values():
        group["words"] = np.concatenate(group["words"])
        group["owner"] = np.concatenate(group["owner"]).astype(np.int32)
        group["wrong_bits"] = np.array(group["wrong_bits"], np.int32)
    return list(groups.values())


@njit(cache=True)
def minimum_distance(words, ids):
    """Return the smallest Hamming distance between two ids in any turns (all turns of each id in ``words``)."""
    smallest = 64
    for a in range(0, len(words), 4):
        for b in range(a + 4, len(words)):
            d = popcount(words[a] ^ words[b])
            if d < smallest:
                smallest = d
    return smallest


@njit(cache=True, nogil=True, inline="always")
def popcount(v):
    """Return the number of ones of a uint64."""
    v = v - ((v >> np.uint64(1)) & np.uint64(0x5555555555555555))
    v = (v & np.uint64(0x3333333333333333)) + ((v >> np.uint64(2)) & np.uint64(0x3333333333333333))
    v = (v + (v >> np.uint64(4))) & np.uint64(0x0F0F0F0F0F0F0F0F)
    return (v * np.uint64(0x0101010101010101)) >> np.uint64(56)


@njit(cache=True, nogil=True)
def square_to_quad(quad, h):
    """Write the homography (9,) that takes the unit square (0,0), (1,0), (1,1), (0,1) to the quad's corners.

    Closed form of Heckbert (1989), Fundamentals of texture mapping. Returns False for a degenerate quad.
    """
    x0, y0, x1, y1 = quad[0, 0], quad[0, 1], quad[1, 0], quad[1, 1]
    x2, y2, x3, y3 = quad[2, 0], quad[2, 1], quad[3, 0], quad[3, 1]
    dx1, dx2, sx = x1 - x2, x3 - x2, x0 - x1 + x2 - x3
    dy1, dy2, sy = y1 - y2, y3 - y2, y0 - y1 + y2 - y3
    det = dx1 * dy2 - dx2 * dy1
    if abs(det) < 1e-9:
        return False
    g = (sx * dy2 - dx2 * sy) / det
    k = (dx1 * sy - sx * dy1) / det
    h[0], h[1], h[2] = x1 - x0 + g * x1, x3 - x0 + k * x3, x0
    h[3], h[4], h[5] = y1 - y0 + g * y1, y3 - y0 + k * y3, y0
    h[6], h[7], h[8] = g, k, 1.0
    return True


@njit(cache=True, nogil=True, inline="always")
def _bilinear(image, light, x, y):
    """Return the interpolated light; NaN outside the image."""
    ix, iy = int(np.floor(x)), int(np.floor(y))
    if ix < 0 or iy < 0 or ix + 1 >= image.shape[1] or iy + 1 >= image.shape[0]:
        return np.nan
    fx, fy = x - ix, y - iy
    top = light[image[iy, ix]] * (1 - fx) + light[image[iy, ix + 1]] * fx
    bottom = light[image[iy + 1, ix]] * (1 - fx) + light[image[iy + 1, ix + 1]] * fx
    return top * (1 - fy) + bottom * fy


@njit(cache=True, nogil=True, inline="always")
def _cell(image, light, h, u, v, spread, points):
    """Return the mean of points x points samples around (u, v) of the unit square, ``spread`` apart."""
    total = 0.0
    for i in range(points):
        for j in range(points):
            a = u + (i - 0.5 * (points - 1)) * spread
            b = v + (j - 0.5 * (points - 1)) * spread
            w = 1 / (h[6] * a + h[7] * b + 1.0)
            total += _bilinear(image, light, (h[0] * a + h[1] * b + h[2]) * w, (h[3] * a + h[4] * b + h[5]) * w)
    return total / (points * points)


@njit(cache=True, nogil=True)
def cell_size(quad, n):
    """Return the thickness in pixels of the columns and of the rows of n x n cells within the quad."""
    area = 0.0
    length = np.empty(4)
    for s in range(4):
        t = (s + 1) % 4
        area += 0.5 * (quad[s, 0] * quad[t, 1] - quad[t, 0] * quad[s, 1])
        length[s] = np.sqrt((quad[t, 0] - quad[s, 0]) ** 2 + (quad[t, 1] - quad[s, 1]) ** 2)
    area = abs(area)
    return area / max(length[1], length[3], 1e-9) / n, area / max(length[0], length[2], 1e-9) / n


@njit(cache=True, nogil=True)
def read_levels(image, light, quad, size, levels, inside=True):
    """Write the light of the code's cells and of the paper round it, (size + 4, size + 4).

    light (256,) is what each grey level stands for; inside: False leaves out the bits, which frame_contrast does not
    need. The outermost ring lies 0.38 modules outside the black frame. Returns the thickness of the thinnest row or
    column of cells in pixels, 0 for a degenerate quad. Levels outside the image are NaN.
    """
    h = np.empty(9)
    if not square_to_quad(quad, h):
        return 0.0
    n = size + 2
    across, down = cell_size(quad, n)
    module = min(across, down)
    points = 3 if module > 6 else (2 if module > 3 else 1)
    spread = 0.2 / n
    for r in range(n + 2):
        v = (r - 0.5) / n
        v = -0.38 / n if r == 0 else (1 + 0.38 / n if r == n + 1 else v)
        for c in range(n + 2):
            if not inside and 2 <= r < n and 2 <= c < n:
                continue
            u = (c - 0.5) / n
            u = -0.38 / n if c == 0 else (1 + 0.38 / n if c == n + 1 else u)
            levels[r, c] = _cell(image, light, h, u, v, spread, points)
    return module


@njit(cache=True, nogil=True)
def frame_contrast(levels, plane, least_contrast, most_weak):
    """Write the plane (3,) of the threshold between black frame and white paper; return their contrast.

    0 where the frame is not dark on light all round: a larger share than ``most_weak`` of the pairs has less than
    two fifths of the mean contrast. ``plane`` holds the level at the centre and its slopes by column and row.
    """
    n = levels.shape[0]
    middle = 0.5 * (n - 1)
    total = s0 = sx = sy = 0.0
    pairs = 4 * (n - 2)
    spread = 0.0
    for k in range(1, n - 1):
        for side in range(4):
            r, c, dr, dc = k, 0, 0, 1
            if side == 1:
                r, c, dr, dc = k, n - 1, 0, -1
            elif side == 2:
                r, c, dr, dc = 0, k, 1, 0
            elif side == 3:
                r, c, dr, dc = n - 1, k, -1, 0
            white, black = levels[r, c], levels[r + dr, c + dc]
            total += white - black
            mid = 0.5 * (white + black)
            x, y = c + 0.5 * dc - middle, r + 0.5 * dr - middle
            s0 += mid
            sx += mid * x
            sy += mid * y
            spread += x * x
    contrast = total / pairs
    if not contrast > least_contrast:  # NaN too
        return 0.0
    weak = 0
    for k in range(1, n - 1):
        weak += levels[k, 0] - levels[k, 1] < 0.4 * contrast
        weak += levels[k, n - 1] - levels[k, n - 2] < 0.4 * contrast
        weak += levels[0, k] - levels[1, k] < 0.4 * contrast
        weak += levels[n - 1, k] - levels[n - 2, k] < 0.4 * contrast
    if weak > most_weak * pairs:
        return 0.0
    plane[0], plane[1], plane[2] = s0 / pairs, sx / spread, sy / spread
    return contrast


@njit(cache=True, nogil=True)
def read_word(levels, plane, contrast, sharpen, margins):
    """Return the code word; write each bit's distance from the threshold, in half contrasts, to ``margins``.

    sharpen  share of the mean of the four neighbours taken away, against blur between small cells
    """
    n = levels.shape[0]
    size = n - 4
    middle = 0.5 * (n - 1)
    word = np.uint64(0)
    k = 0
    for r in range(2, 2 + size):
        for c in range(2, 2 + size):
            v = levels[r, c]
            if sharpen > 0:
                near = levels[r - 1, c] + levels[r + 1, c] + levels[r, c - 1] + levels[r, c + 1]
                v += sharpen * (v - 0.25 * near)
            m = 2 * (v - plane[0] - plane[1] * (c - middle) - plane[2] * (r - middle)) / contrast
            margins[k] = m
            word = (word << np.uint64(1)) | np.uint64(m > 0)
            k += 1
    return word


@njit(cache=True, nogil=True)
def frame_errors(levels, plane):
    """Return how many cells of the black frame are above the threshold."""
    n = levels.shape[0]
    middle = 0.5 * (n - 1)
    errors = 0
    for k in range(1, n - 1):
        at = plane[1] * (k - middle)
        up = plane[2] * (k - middle)
        edge = 1 - middle
        errors += levels[1, k] > plane[0] + at + plane[2] * edge
        errors += levels[n - 2, k] > plane[0] + at - plane[2] * edge
        if 1 < k < n - 2:
            errors += levels[k, 1] > plane[0] + up + plane[1] * edge
            errors += levels[k, n - 2] > plane[0] + up - plane[1] * edge
    return errors


@njit(cache=True, nogil=True)
def match_word(word, margins, words, owner, wrong_bits, most_wrong, surest):
    """Return (entry of the tables or NO_CODE, wrong bits) of the nearest code.

    A wrong bit is forgiven only where it was doubtful: nearer the threshold than ``surest`` half contrasts.
    """
    best, distance = NO_CODE, 65
    for k in range(len(words)):
        d = np.int64(popcount(word ^ words[k]))
        if d < distance:
            best, distance = k, d
    if distance > min(most_wrong, wrong_bits[owner[best, 0]]):
        return NO_CODE, distance
    wrong = word ^ words[best]
    bits = len(margins)
    for k in range(bits):
        if (wrong >> np.uint64(bits - 1 - k)) & np.uint64(1) and abs(margins[k]) > surest:
            return NO_CODE, distance
    return best, distance
