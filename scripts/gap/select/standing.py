"""Where a fitted twin stands: at the floor or not, which groups of observables are open, and the verdict's word."""

import numpy as np

from gap.bounds import CLEAR_GAIN, CLOSED, LITTLE, MAX_FLOOR_GAP, MIN_GAIN, MOST, TWICE
from gap.fit.residuals import GROUPS
from gap.fit.score import excess_of, gap_error, group_gaps


def is_at_floor(twin):
    """Return whether every group of observables, poses too, is at its floor: what helps further has nothing to explain."""
    floors = {name: MAX_FLOOR_GAP * twin.floors.get(name, 1.0) for name in GROUPS}
    return not any(excess_of(twin.groups, floors).values())


def is_nothing_left(twin):
    """Return whether what a twin leaves above its floors is too little for a name."""
    return sum(twin.excess.values()) < MIN_GAIN


def is_enough(by_group, gain, least, excess, share):
    """Return whether a gain, ``by_group`` of observables, is a ``share`` of all that is left (``excess``) or most of a group's.

    The latter only if it is ``least`` or more.
    """
    if gain > share * sum(excess.values()):
        return True
    return any(g > max(least, MOST * excess.get(name, 0.0)) for name, g in by_group.items())


def has_good_share(group, before):
    """Return whether a group of observables has a good share of the first excess ``before`` {group: loss}."""
    return before[group] > LITTLE * sum(before.values())


def is_open(twin, group, before):
    """Return whether a twin leaves a group open: more than CLOSED of the first excess ``before``."""
    return twin.excess[group] > CLOSED * before[group]


def closes_a_good_share(twin, group, before):
    """Return whether a twin closes a group that had a good share of the first excess ``before``."""
    return has_good_share(group, before) and not is_open(twin, group, before)


def groups_left(twin, before, floor_within=1.0):
    """Return the groups of observables, above their floors, of whose first excess ``before`` {group: loss} most is left.

    The form of what closed other groups leaves little of all that it changes: this is something else.
    """
    most = [g for g, left in twin.excess.items() if left > max(CLEAR_GAIN, MOST * before[g])]
    return [g for g in most if is_above_floor(*_gap_of(twin, g), floor_within)]


def residue_of(twin, group, before, floor_within=1.0):
    """Return {group: gap in floors} of a group of observables that a twin closes but leaves above the floor, {} of any other."""
    gap, error = _gap_of(twin, group)
    return {group: gap} if is_above_floor(gap, error, floor_within) and not is_open(twin, group, before) else {}


def _gap_of(twin, group):
    """Return the gap of a group of observables, in floors, and its error; (0.0, 0.0) of a pose, which is no observable."""
    of_group = {i: {group: g[group]} for i, g in twin.groups.items() if group in g}
    gap = group_gaps(of_group, twin.floors).get(group)
    return (0.0, 0.0) if gap is None else (gap, gap_error(of_group, twin.floors))


def is_above_floor(gap, error, floor_within):
    """Return whether a gap, in units of a floor that is known to a factor, is above it, its standard error allowed for.

    A gap that captures disagree about is no smaller for that: the error is allowed for up to what is the floor only.
    """
    return gap - min(TWICE * np.nan_to_num(error), MAX_FLOOR_GAP - 1) > MAX_FLOOR_GAP * floor_within


def verdict_of(steps, twin, share_left=1.0, floor_within=1.0):
    """Return ``adequate``, ``explained`` or ``unexplained`` from the steps taken and the gap that is left.

    ``share_left`` is what was left of the first excess: effects have the right name before they have the last form.
    ``floor_within`` is the factor to which the floor is known.
    """
    nearly_closed = steps and share_left < CLOSED and twin.gap < TWICE
    if is_above_floor(twin.gap, twin.gap_se, floor_within) and not nearly_closed:
        return "unexplained"
    return "explained" if steps else "adequate"
