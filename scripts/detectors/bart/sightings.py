"""Places in an image that are seen more than once: what lies within a finding, and the best finding of each place."""

import numpy as np

from kernels import njit


def not_inside(boxes, found):
    """Return the boxes (x0, y0, x1, y1) that hold no centre of a finding and lie in none."""
    if not (found and len(boxes)):
        return boxes
    return boxes[_free_boxes(boxes, np.array([f["corners"] for f in found]))]


@njit(cache=True, nogil=True)
def _bounds(quad):
    """Return (x0, y0, x1, y1) of a quad (4, 2)."""
    return quad[:, 0].min(), quad[:, 1].min(), quad[:, 0].max(), quad[:, 1].max()


@njit(cache=True, nogil=True)
def _free_boxes(boxes, corners):
    """Return bool (n,): whether a box (n, 4) neither holds the centre of a quad's bounds (m, 4, 2) nor lies within."""
    free = np.ones(len(boxes), np.bool_)
    for k in range(len(corners)):
        x0, y0, x1, y1 = _bounds(corners[k])
        x, y = 0.5 * (x0 + x1), 0.5 * (y0 + y1)
        for j in range(len(boxes)):
            a, b, c, d = boxes[j]
            if (a < x < c and b < y < d) or (x0 < a and c < x1 and y0 < b and d < y1):
                free[j] = False
    return free


@njit(cache=True, nogil=True)
def _first_of_each(corners):
    """Return bool (n,): whether a quad (n, 4, 2) lies apart from all before it that do."""
    kept = np.ones(len(corners), np.bool_)
    for k in range(len(corners)):
        x0, y0, x1, y1 = _bounds(corners[k])
        reach = 0.25 * max(x1 - x0, y1 - y0)
        x, y = corners[k, :, 0].mean(), corners[k, :, 1].mean()
        for j in range(k):
            apart = max(abs(x - corners[j, :, 0].mean()), abs(y - corners[j, :, 1].mean()))
            if kept[j] and apart < reach:
                kept[k] = False
    return kept


def best_of_each(found):
    """Return the findings without second sightings of one place: fewer wrong bits first, then more contrast."""
    found = sorted(found, key=lambda f: (f["wrong"], -f["contrast"]))
    if len(found) < 2:
        return found
    kept = _first_of_each(np.array([f["corners"] for f in found]))
    return [f for f, first in zip(found, kept, strict=True) if first]
