"""Small markers, whose cells mix: codes compared as they look when blurred, corners fitted to that look.

Compiled with numba.
"""

import math

import numpy as np

from detectors.bart.codes import NO_CODE, cell_size, popcount, read_levels
from kernels import njit

COMPETING_BITS = 5  # wrong bits up to which codes compete for a small marker
COMPETING_SHARE = 0.2  # of all bits: of large families of few bits half would compete
BELIEVED_BITS = 2  # wrong bits that blur between small cells may explain


@njit(cache=True, nogil=True)
def _gauss(x):
    return 0.5 * (1 + math.erf(x / np.sqrt(2.0)))


@njit(cache=True, nogil=True)
def _mixing(n, thickness, blur):
    """Return (n, n): how much of each cell reaches the middle of each other one of a row, for a blur in pixels.

    The outermost cells go on for ever: paper. Their middle lies 0.38 cells outside the frame (read_levels).
    """
    mix = np.zeros((n, n))
    s = blur / thickness
    for i in range(n):
        at = 0.62 if i == 0 else (n - 0.62 if i == n - 1 else i + 0.5)
        for j in range(n):
            low = -1e9 if j == 0 else (j - at) / s
            high = 1e9 if j == n - 1 else (j + 1 - at) / s
            mix[i, j] = _gauss(high) - _gauss(low)
    return mix


@njit(cache=True, nogil=True)
def _misfit(levels, mix_down, mix_across, cells):
    """Return (RMS, largest) residual of levels against mixed cells (1 white, 0 black), in fitted contrasts."""
    n = len(levels)
    half = np.zeros((n, n))
    mixed = np.empty((n, n))
    for i in range(n):
        for k in range(n):
            m = mix_down[i, k]
            if m > 1e-3:
                for j in range(n):
                    half[i, j] += m * cells[k, j]
    sx = sy = sxx = sxy = syy = 0.0
    for i in range(n):
        for j in range(n):
            x = 0.0
            for k in range(max(j - 3, 0), min(j + 4, n)):
                x += half[i, k] * mix_across[j, k]
            mixed[i, j] = x
            y = levels[i, j]
            sx += x
            sy += y
            sxx += x * x
            sxy += x * y
            syy += y * y
    count = n * n
    vxx, vxy, vyy = sxx - sx * sx / count, sxy - sx * sy / count, syy - sy * sy / count
    if vxy <= 0:
        return 1e9, 1e9
    contrast = vxy / vxx
    worst = 0.0
    for i in range(1, n - 1):
        for j in range(1, n - 1):
            worst = max(worst, abs(levels[i, j] - sy / count - contrast * (mixed[i, j] - sx / count)))
    return np.sqrt(max(vyy - vxy * vxy / vxx, 0.0) / count) / contrast, worst / contrast


@njit(cache=True, nogil=True)
def match_blurred(levels, across, down, word, words, owner):
    """Return (entry or NO_CODE, misfit, worst, lead) of the code that explains the levels of a small marker best.

    Cells of about a pixel mix: each code near the word as read is blurred as the image may be and compared with
    what is seen, paper and frame included.
    levels   (n, n) linear light of codes.read_levels; across, down: thickness of its columns and rows, pixels
    word     bits as read: codes within COMPETING_BITS of it (COMPETING_SHARE of all) are compared, one within
             BELIEVED_BITS is returned, and only if it explains the levels better than the word itself does
    misfit   residual RMS of the best, in contrasts; worst: its largest residual of a cell within the frame
    lead     misfit of the best other code over that of the best
    """
    n = len(levels)
    size = n - 4
    cells = np.zeros((n, n))
    for k in range(n):
        cells[0, k] = cells[n - 1, k] = cells[k, 0] = cells[k, n - 1] = 1.0
    best, least, second, worst, as_read = NO_CODE, 1e9, 1e9, 1e9, 1e9
    competing = [-1]
    most = min(COMPETING_BITS, int(COMPETING_SHARE * size * size))
    nearest = 65
    for k in range(len(words)):
        d = np.int64(popcount(word ^ words[k]))
        nearest = min(nearest, d)
        if d <= most:
            competing.append(k)
    if nearest > BELIEVED_BITS:
        return NO_CODE, 1e9, 1e9, 0.0
    for blur in (0.5, 0.75, 1.1):
        mix_across = _mixing(n, across, blur)
        mix_down = _mixing(n, down, blur)
        for k in competing:
            code = word if k < 0 else words[k]
            bit = np.uint64(size * size - 1)
            for r in range(size):
                for c in range(size):
                    cells[r + 2, c + 2] = float((code >> bit) & np.uint64(1))
                    bit -= np.uint64(1)
            misfit, largest = _misfit(levels, mix_down, mix_across, cells)
            if k < 0:
                as_read = min(as_read, misfit)
            elif best != NO_CODE and owner[k, 0] == owner[best, 0] and owner[k, 1] == owner[best, 1]:
                if misfit < least:
                    best, least, worst = k, misfit, largest
            elif misfit < least:
                best, least, worst, second = k, misfit, largest, least
            elif misfit < second:
                second = misfit
    if best == NO_CODE or popcount(word ^ words[best]) > BELIEVED_BITS or as_read < least:
        return NO_CODE, 1e9, 1e9, 0.0
    return best, least, worst, second / max(least, 1e-9)


@njit(cache=True, nogil=True)
def _residuals(image, light, quad, size, mixed, levels, out):
    """Write what a multiple of ``mixed`` plus a constant leaves of the levels, in contrasts; return its square sum."""
    read_levels(image, light, quad, size, levels)
    n = len(levels)
    count = n * n
    sx, sy = mixed.sum(), levels.sum()
    sxx, sxy = (mixed * mixed).sum(), (mixed * levels).sum()
    contrast = (sxy - sx * sy / count) / (sxx - sx * sx / count)
    total = 0.0
    for i in range(n):
        for j in range(n):
            r = (levels[i, j] - sy / count) / contrast - (mixed[i, j] - sx / count)
            out[i * n + j] = r
            total += r * r
    return total if contrast > 0 else 1e9


@njit(cache=True, nogil=True)
def fit_small(image, light, quad, size, code):
    """Move the corners of a small marker (4, 2), in place, to where its blurred code looks most like the image.

    Gauss-Newton over the eight coordinates, for the best of three blurs; left as they are where that does not lessen
    the misfit or would move a corner by more than 0.8 pixels.
    """
    n = size + 4
    cells = np.zeros((n, n))
    bit = np.uint64(size * size - 1)
    for k in range(n):
        cells[0, k] = cells[n - 1, k] = cells[k, 0] = cells[k, n - 1] = 1.0
    for r in range(size):
        for c in range(size):
            cells[r + 2, c + 2] = float((code >> bit) & np.uint64(1))
            bit -= np.uint64(1)
    levels = np.empty((n, n))
    now = np.empty(n * n)
    moved = np.empty(n * n)
    J = np.empty((n * n, 8))
    across, down = cell_size(quad, size + 2)
    start = quad.copy()
    best = quad.copy()
    least = 1e9
    for blur in (0.5, 0.75, 1.1):
        mixed = _mixing(n, down, blur) @ cells @ _mixing(n, across, blur).T
        current = start.copy()
        total = _residuals(image, light, current, size, mixed, levels, now)
        for _ in range(4):
            for k in range(8):
                current[k // 2, k % 2] += 0.1
                _residuals(image, light, current, size, mixed, levels, moved)
                current[k // 2, k % 2] -= 0.1
                J[:, k] = (moved - now) / 0.1
            if not np.isfinite(J).all():
                break
            step = np.linalg.solve(J.T @ J + 1e-3 * np.eye(8), J.T @ now)
            trial = current - step.reshape(4, 2)
            after = _residuals(image, light, trial, size, mixed, levels, moved)
            if not after < total:
                break
            current, total = trial, after
            now[:] = moved
        if total < least and np.abs(current - start).max() < 0.8:
            least = total
            best = current
    quad[:] = best
