"""Discs of a print, rings being a disc upon a disc: as polygons of the same area, for those who draw and build them.

A disc is a row x, y, radius, 1 white or 0 black; lengths in metres in the plate's frame, x right and y up.
"""

import numpy as np

ARC_PIECES = 24  # of each of the two arcs of a lens
SAGITTA = 2.5e-6  # of a plate's longer side, between a disc and its outline where it is built for good


def no_discs():
    """Return the discs (0, 4) of a print that has none."""
    return np.zeros((0, 4))


def spread_discs(discs, spread_m):
    """Return discs (k, 4) with the boundaries of black moved outward by ``spread_m``; what vanishes is left out."""
    moved = discs.copy()
    moved[:, 2] += np.where(discs[:, 3] > 0, -spread_m, spread_m)
    return moved[moved[:, 2] > 0]


def turning_colour(discs, on_white):
    """Return the discs (n, 4) of (k, 4) whose colour is not that of what they lie on.

    on_white  (k,) bool, whether the cell below each is white; discs that were painted before hide it
    """
    below = np.asarray(on_white, bool).copy()
    for k, (x, y, radius, white) in enumerate(discs):
        inside = np.hypot(discs[k + 1 :, 0] - x, discs[k + 1 :, 1] - y) < radius
        below[k + 1 :][inside] = bool(white)
    return discs[below != (discs[:, 3] > 0)]


def pieces_of(radius, sagitta):
    """Return into how many straight pieces, a power of two, circles are cut that may be off by ``sagitta`` (same unit)."""
    wanted = np.pi * np.sqrt(np.maximum(radius, 0) / (2 * sagitta))
    return 2 ** np.ceil(np.log2(np.maximum(wanted, 16))).astype(int)


def outlines(discs, pieces):
    """Return polygons (k, pieces, 2) of the discs' areas, clockwise as seen from the front."""
    angle = -2 * np.pi * np.arange(pieces) / pieces
    # corners a little outside, middles of edges a little inside the circle
    reach = discs[:, 2] * np.sqrt(2 * np.pi / (pieces * np.sin(2 * np.pi / pieces)))
    circle = np.stack([np.cos(angle), np.sin(angle)], axis=-1)
    return discs[:, None, :2] + reach[:, None, None] * circle


def lenses(discs):
    """Return what pairs of discs of one colour share, as polygons (n, 2 ARC_PIECES, 2), counter-clockwise, and the discs'
    colours (n,): ink that spread makes neighbours overlap, and what both cover counts once.

    Where three overlap, what they share is not told: neighbours would have to grow by a seventh of their radius.
    """
    made, colours = [np.zeros((0, 2 * ARC_PIECES, 2))], []
    for k, (x, y, radius, white) in enumerate(discs):
        for other in discs[k + 1 :]:
            apart = np.hypot(other[0] - x, other[1] - y)
            if other[3] != white or not abs(radius - other[2]) < apart < radius + other[2]:
                continue
            towards = np.arctan2(other[1] - y, other[0] - x)
            arcs = []
            for (cx, cy, r), s, turned in (((x, y, radius), other[2], 0.0), (other[:3], radius, np.pi)):
                half = np.arccos((apart**2 + r**2 - s**2) / (2 * apart * r))
                angle = towards + turned + half * (2 * np.arange(ARC_PIECES) / ARC_PIECES - 1)
                arcs.append(np.stack([cx + r * np.cos(angle), cy + r * np.sin(angle)], axis=1))
            made.append(np.concatenate(arcs)[None])
            colours.append(white)
    return np.concatenate(made), np.array(colours)


def built_outlines(plate):
    """Return [polygon (n, 2)] of all discs of a rig.plates.Plate, in order, cut at the plate's edge."""
    low, high = (np.array([plate.x_m[k], plate.y_m[k]]) for k in (0, -1))
    pieces = pieces_of(plate.discs[:, 2], SAGITTA * (high - low).max())
    return [np.clip(outlines(plate.discs[[k]], n)[0], low, high) for k, n in enumerate(pieces)]
