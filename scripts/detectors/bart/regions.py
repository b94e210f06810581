"""Connected dark regions of a binary image, and those of them that may be quadrilaterals.

Compiled with numba. Pixel coordinates are those of the image that was binarised.
"""

import numpy as np

from detectors.bart.codes import popcount
from kernels import njit

ZERO, ONE, THREE, EIGHT, BYTE = (np.uint64(v) for v in (0, 1, 3, 8, 255))


@njit(cache=True, nogil=True)
def _root(parent, k):
    while parent[k] != k:
        parent[k] = parent[parent[k]]
        k = parent[k]
    return k


@njit(cache=True, nogil=True)
def _runs(words):
    """Return (row starts, first x, last x) of the runs of dark pixels; ``words`` are eight pixels, 0 or 255, each."""
    rows, n_words = words.shape
    capacity = 1 << 14
    first = np.empty(capacity, np.int32)
    last = np.empty(capacity, np.int32)
    starts = np.empty(rows + 1, np.int32)
    n = 0
    for y in range(rows):
        starts[y] = n
        if n + 4 * n_words + 2 > capacity:
            capacity *= 2
            while n + 4 * n_words + 2 > capacity:
                capacity *= 2
            grown = np.empty(capacity, np.int32)
            grown[:n] = first[:n]
            first = grown
            grown = np.empty(capacity, np.int32)
            grown[:n] = last[:n]
            last = grown
        inside = False
        before = ZERO  # the last pixel of the word before, in the lowest byte
        for w in range(n_words):
            word = words[y, w]
            # Bytes that differ from the one before them, the first pixel in the lowest byte (little endian).
            changes = word ^ ((word << EIGHT) | before)
            before = word >> np.uint64(56)
            while changes != ZERO:
                bit = popcount((changes & (~changes + ONE)) - ONE)
                changes ^= BYTE << bit
                x = 8 * w + np.int64(bit >> THREE)
                if inside:
                    last[n] = x - 1
                    n += 1
                else:
                    first[n] = x
                inside = not inside
        if inside:
            last[n] = 8 * n_words - 1
            n += 1
    starts[rows] = n
    return starts, first, last


@njit(cache=True, nogil=True)
def components(words):
    """Return int32 (n, 7) of the 8-connected dark regions: x0, y0, x1, y1 (inclusive), area, start x, start y.

    The start is the leftmost pixel of the top row, where a border may be followed from.
    """
    starts, first, last = _runs(words)
    rows = len(starts) - 1
    n = starts[rows]
    parent = np.arange(n).astype(np.int32)
    for y in range(1, rows):
        a, a_end = starts[y - 1], starts[y]
        b, b_end = starts[y], starts[y + 1]
        while a < a_end and b < b_end:
            if last[a] + 1 < first[b]:
                a += 1
            elif last[b] + 1 < first[a]:
                b += 1
            else:
                ra, rb = _root(parent, a), _root(parent, b)
                # The root is the earliest run, hence on the top row.
                if ra < rb:
                    parent[rb] = ra
                elif rb < ra:
                    parent[ra] = rb
                if last[a] < last[b]:
                    a += 1
                else:
                    b += 1
    index = np.full(n, -1, np.int32)
    out = np.empty((n, 7), np.int32)
    count = 0
    for y in range(rows):
        for k in range(starts[y], starts[y + 1]):
            r = _root(parent, k)
            c = index[r]
            if c < 0:
                c = count
                count += 1
                index[r] = c
                out[c, 0], out[c, 1], out[c, 2], out[c, 3] = first[k], y, last[k], y
                out[c, 4], out[c, 5], out[c, 6] = 0, first[k], y
            out[c, 0] = min(out[c, 0], first[k])
            out[c, 2] = max(out[c, 2], last[k])
            out[c, 3] = y
            out[c, 4] += last[k] - first[k] + 1
    return out[:count]


@njit(cache=True, nogil=True)
def candidates(regions, smallest, largest):
    """Return those of components' regions that may be quadrilaterals of a size.

    smallest, largest  side of a region's bounding box, pixels: the longer one is within these limits
    """
    n = 0
    kept = np.empty_like(regions)
    for k in range(len(regions)):
        w, h = regions[k, 2] - regions[k, 0] + 1, regions[k, 3] - regions[k, 1] + 1
        if smallest <= max(w, h) <= largest and min(w, h) >= 3 and regions[k, 4] >= w + h:
            kept[n] = regions[k]
            n += 1
    return kept[:n]
