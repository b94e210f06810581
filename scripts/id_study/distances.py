"""How many cells differ between codes, the one turned as it may be: what keeps ids apart."""

import numpy as np

from markers.contract import count_of, drawing_of

TURNS = 4


def cells_of(family):
    """Return the cells (ids, n, n) bool of all markers of a family; None where discs carry the code."""
    drawings = [drawing_of(family, number) for number in range(count_of(family))]
    if any(len(d.discs) for d in drawings):
        return None
    return np.stack([d.white for d in drawings])


def distances_between(cells, others):
    """Return (n, m) how many cells differ at least between each of cells (n, k, k) and each of others, turned in any way.

    All the largest number where the two have not equally many cells.
    """
    if cells.shape[1:] != others.shape[1:]:
        return np.full((len(cells), len(others)), cells[0].size)
    flat = cells.reshape(len(cells), -1).astype(np.float32)
    least = np.full((len(cells), len(others)), flat.shape[1], int)
    for turn in range(TURNS):
        turned = np.rot90(others, turn, axes=(1, 2)).reshape(len(others), -1).astype(np.float32)
        same = flat @ turned.T + (1 - flat) @ (1 - turned).T
        least = np.minimum(least, flat.shape[1] - np.rint(same).astype(int))
    return least


def nearest_others(cells):
    """Return (nearest id (n,), its distance (n,), all distances (n, n) with the largest on the diagonal)."""
    between = distances_between(cells, cells)
    np.fill_diagonal(between, cells[0].size)
    nearest = between.argmin(axis=1)
    return nearest, between[np.arange(len(cells)), nearest], between
