"""The observables: all that is measured of an image, in one table. Names, columns, groups, floors and ridges are its own.

A plate's fit finds the features of PLATE_GROUPS together, in one array; the other groups have an array each, the columns of all
in the table's order. Signs are a photograph's of a board (gap.signatures), by its patches.
"""

from typing import NamedTuple

import numpy as np

PLATE_GROUPS = ("corners", "levels", "edges")
MIN_FLOOR = {"corners": 0.25, "levels": 0.5, "edges": 0.25, "colour": 0.5, "field": 0.5, "noise": 0.5}
FREE, HELD = 1e-4, 1e-2  # ridges of what a fit's iterations move, and of the rest, that is held to sense


class Observable(NamedTuple):
    """One number that is measured."""

    name: str
    unit: str  # px, px2, dn (grey levels), ln (natural logarithm), 1
    group: str
    floor: float  # standard deviation below which no difference counts: synthesis against an ideal camera's image
    ridge: float = 0.0  # prior precision of a fit's coefficient, in grey levels of noise; 0 where none is fitted


def _alike(names, *rest):
    return [Observable(name, *rest) for name in names.split()]


OBSERVABLES = (
    *_alike("corner_x0 corner_y0 corner_x1 corner_y1 corner_x2 corner_y2 corner_x3 corner_y3", "px", "corners", 0.006, FREE),
    *_alike("white black ground white_slope_u white_slope_v", "dn", "levels", 0.15, FREE),
    *_alike("spread_x spread_y spread_xy", "px2", "edges", 0.012, HELD),
    Observable("overshoot", "1", "edges", 0.004, HELD),
    Observable("ink", "px", "edges", 0.005, HELD),
    Observable("rim", "px", "edges", 0.006, FREE),
    *_alike("red_white red_black red_ground", "dn", "colour", 0.15, 1e-3),
    *_alike("red_dx red_dy", "px", "colour", 0.006, 1e-3),
    *_alike("blue_white blue_black blue_ground", "dn", "colour", 0.15, 1e-3),
    *_alike("blue_dx blue_dy", "px", "colour", 0.006, 1e-3),
    Observable("field", "dn", "field", 0.12),  # of each region of ground and sky
    *_alike("noise_ground noise_white noise_black noise_sky noise_y_over_x noise_lag2_x noise_lag2_y", "ln", "noise", 0.02),
    *_alike("noise_tails blocks_x blocks_y stripes_row stripes_column noise_colour", "ln", "noise", 0.02),
)  # fmt: skip
OF_PHOTOGRAPHS = (  # floors are the least that is taken for one, set by hand: few photographs may agree by chance
    *_alike("spread_x spread_y", "px2", "edges", 0.02),
    Observable("spread_xy", "px2", "edges", 0.03),
    Observable("overshoot", "1", "edges", 0.01),
    Observable("ink", "px", "edges", 0.015),
    Observable("overshoot_outwards", "1", "edges", 0.02),
    *_alike("fine_x fine_y fine_turn", "ln", "", 0.0),  # between photographs alone: no effect's edges have a lens's tails
    *_alike("noise_white noise_black", "ln", "noise", 0.15),
    *_alike("noise_across noise_coarse", "ln", "noise", 0.1),
    Observable("noise_colour", "ln", "noise", 0.2),
    Observable("blocks", "ln", "noise", 0.15),
    Observable("flat_blocks", "1", "noise", 0.03),
    Observable("light", "ln", "levels", 0.1),
    Observable("black", "1", "levels", 0.02),
    Observable("light_outwards", "ln", "levels", 0.03),
    *_alike("red blue", "ln", "colour", 0.03),
    *_alike("red_outwards blue_outwards", "px", "colour", 0.01),
)  # fmt: skip


def names_of(*groups, table=OBSERVABLES):
    """Return the names of the observables of some groups."""
    return tuple(o.name for o in table if o.group in groups)


GAP_GROUPS = tuple(dict.fromkeys(o.group for o in OBSERVABLES))
FEATURES, COLOUR_FEATURES, NOISE_FEATURES = names_of(*PLATE_GROUPS), names_of("colour"), names_of("noise")
N_FEATURES, N_COLOUR = len(FEATURES), len(COLOUR_FEATURES)
FLOORS, RIDGES = ({g: np.array([o[k] for o in OBSERVABLES if o.group == g]) for g in GAP_GROUPS} for k in (3, 4))
FEATURE_FLOOR, FEATURE_RIDGE = (np.concatenate([of[g] for g in PLATE_GROUPS]) for of in (FLOORS, RIDGES))
COLUMN = {name: k for names in (FEATURES, COLOUR_FEATURES, NOISE_FEATURES) for k, name in enumerate(names)}
SIGNS, MIN_SIGN_FLOOR = tuple(o.name for o in OF_PHOTOGRAPHS), np.array([o.floor for o in OF_PHOTOGRAPHS])
SIGNS_OF_GROUP = {g: names for g in GAP_GROUPS if (names := names_of(g, table=OF_PHOTOGRAPHS))}


def columns(first, last):
    """Return the slice of an array's columns from one observable to another."""
    return slice(COLUMN[first], COLUMN[last] + 1)


FEATURE_GROUPS = {g: columns(names_of(g)[0], names_of(g)[-1]) for g in PLATE_GROUPS}
CORNERS, LEVELS, EDGES = FEATURE_GROUPS.values()
SURFACES = columns("white", "ground")
# The state, what a fit's iterations move, is features: corners and levels have the columns that they have there
STATE_FEATURES, HELD_FEATURES = (np.flatnonzero(FEATURE_RIDGE == ridge) for ridge in (FREE, HELD))
STATE_RIM = STATE_FEATURES.tolist().index(COLUMN["rim"])


def corners_in(features):
    """Return the corners (..., 4, 2) of features (..., 19), pixels; (..., 1, 2) of a board's points (..., 2)."""
    corners = features[..., CORNERS]
    return corners.reshape(*corners.shape[:-1], corners.shape[-1] // 2, 2)


def states_of(features):
    """Return the states (..., 14) of measured features (..., 19)."""
    return features[..., STATE_FEATURES]


def shifted(features, by):
    """Return features or states (n,) of a plate that lies ``by`` (2,) pixels elsewhere."""
    out = features.copy()
    out[CORNERS] += np.tile(by, 4)
    return out
