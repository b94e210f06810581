"""Quadrilaterals of an image to markers: contrast and frame, the bits, corners measured at the edges.

Compiled with numba.
"""

import numpy as np

from detectors.bart.codes import (
    NO_CODE,
    cell_size,
    frame_contrast,
    frame_errors,
    match_word,
    read_levels,
    read_word,
)
from detectors.bart.edges import refine_quad
from detectors.bart.small import fit_small, match_blurred
from kernels import njit

SMALL_MODULE_PX = 4.0  # below it a marker's cells mix, and codes are compared as they look when blurred
WEAK_SHARE = 0.125  # of the pairs of paper and frame that may lack contrast: an occlusion, a shadow
WEAK_SHARE_SMALL = 0.25  # the same for small markers, whose looks are compared as a whole anyway
BLURRED_MODULE_PX = 3.0  # below it a bit's own level says little
SURE_BIT = 0.3  # half contrasts from the threshold: a small marker all of whose bits are as sure is read as it is
LARGEST_MISS = 0.4  # contrasts, of one cell: a bit that is not the code's
LARGEST_MISFIT = 0.13  # contrasts, RMS over all cells: more, and no code explains what is seen
MIN_LEAD = 1.35  # misfit of the next code over that of the best: less, and either may be meant


@njit(cache=True, nogil=True)
def read_blurred(image, light, quad, size, words, owner, levels, plane, margins):
    """Return (entry or NO_CODE, misfit, worst, lead) of a small marker's code, see codes.match_blurred."""
    read_levels(image, light, quad, size, levels)
    contrast = frame_contrast(levels, plane, 1e-3, WEAK_SHARE_SMALL)
    if contrast == 0:
        return NO_CODE, 1e9, 1e9, 0.0
    word = read_word(levels, plane, contrast, 0.25, margins)
    across, down = cell_size(quad, size + 2)
    return match_blurred(levels, across, down, word, words, owner)


@njit(cache=True, nogil=True)
def read_quads(image, grey, light, quads, size, words, owner, wrong_bits, least_contrast, most_wrong, exact):
    """Return (corners (m, 4, 2), owner (m, 3), distance (m,), contrast (m,), fitted (m,)) of readable quads.

    grey, light  (256,) tables: the grey levels as they are, and the light behind them
    quads  float64 (n, 4, 2), pixels of ``image``; corners come in the marker's own order, measured where ``exact``,
           else as in ``quads``. fitted: the entry in ``words`` of a small marker whose corners fit_small found, for
           the code in the marker's own order; else NO_CODE.
    """
    n = len(quads)
    corners = np.empty((n, 4, 2))
    found = np.empty((n, 3), np.int32)
    distance = np.empty(n, np.int32)
    contrasts = np.empty(n)
    fitted = np.empty(n, np.int64)
    levels = np.empty((size + 4, size + 4))
    plane = np.empty(3)
    margins = np.empty(size * size)
    refined = np.empty((4, 2))
    m = 0
    for k in range(n):
        module = read_levels(image, grey, quads[k], size, levels, False)
        weak = WEAK_SHARE if module > SMALL_MODULE_PX else WEAK_SHARE_SMALL
        if module == 0 or frame_contrast(levels, plane, 0.6 * least_contrast, weak) == 0:
            continue
        worked = refine_quad(image, light, quads[k], size, 2, refined)
        read_levels(image, grey, refined, size, levels)
        contrast = frame_contrast(levels, plane, least_contrast, weak)
        entry, wrong, fitted[m] = NO_CODE, 0, NO_CODE
        if contrast > 0 and module > BLURRED_MODULE_PX and frame_errors(levels, plane) <= 1:
            word = read_word(levels, plane, contrast, 0.0, margins)
            if module > SMALL_MODULE_PX:
                entry, wrong = match_word(word, margins, words, owner, wrong_bits, most_wrong, 0.6)
            elif np.abs(margins).min() > SURE_BIT:
                entry, wrong = match_word(word, margins, words, owner, wrong_bits, 0, 0.6)
        if contrast > 0 and module <= SMALL_MODULE_PX and entry == NO_CODE:
            entry, misfit, worst, lead = read_blurred(
                image, light, quads[k], size, words, owner, levels, plane, margins
            )
            # Edges of cells as small as these are not to be trusted; slivers have two long sides, which are.
            tiny = module <= BLURRED_MODULE_PX and max(*cell_size(quads[k], size + 2)) <= SMALL_MODULE_PX
            if worked:
                other = read_blurred(image, light, refined, size, words, owner, levels, plane, margins)
                if other[1] < misfit:
                    entry, misfit, worst, lead = other
                elif tiny:
                    refined[:] = quads[k]
            if misfit > LARGEST_MISFIT or worst > LARGEST_MISS or lead < MIN_LEAD:
                entry = NO_CODE
            elif entry != NO_CODE and exact and tiny:
                fit_small(image, light, refined, size, words[entry])
                fitted[m] = entry - owner[entry, 2]
        if entry == NO_CODE:
            continue
        turn = owner[entry, 2]
        for c in range(4):
            corners[m, c] = refined[(c + turn) % 4] if exact else quads[k, (c + turn) % 4]
        found[m] = owner[entry]
        distance[m] = wrong
        contrasts[m] = contrast
        m += 1
    return corners[:m], found[:m], distance[:m], contrasts[:m], fitted[:m]
