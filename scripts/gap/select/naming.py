"""When an effect is worth its name: what it gains held out, on how many stations, of how much, and beyond its errors."""

import math

from effects import library
from gap.bounds import (
    CERTAIN,
    CHARGE,
    CLEAR_GAIN,
    CLOSED,
    LITTLE,
    MAX_FLOOR_GAP,
    MAX_PARAMETERS,
    MIN_GAIN,
    MIN_STATIONS,
    MOST,
    TWICE,
)
from gap.fit.score import error_of_sum, gains_by_station
from gap.select.standing import is_enough, is_nothing_left
from gap.select.twin import rank

MAX_UNDERSTATED = 3.0  # times the predicted gain that an effect may really have


def is_flexible(name):
    """Return whether an effect is a free warp: one of many waves, that can mimic anything of its kind."""
    return len(library.parameters_of(name)) > MAX_PARAMETERS


def is_missing_from(search, twin, candidate):
    """Return whether a candidate is missing from a twin: it closes more of what is left where all of that may be the floor."""
    within = search.problem.floor_within
    may_be_floor = within > 1 and twin.gap <= MAX_FLOOR_GAP * within
    return is_missing(candidate, twin.excess, TWICE * CLOSED if may_be_floor else LITTLE)


def is_missing(candidate, excess, share):
    """Return whether a candidate gains more than ``least_gain`` held out, on most stations, matters, and closes enough."""
    least = least_gain(candidate.effect)
    return bool(
        is_enough(candidate.group_gains, candidate.gain, least, excess, share)
        and candidate.is_significant
        and candidate.certain_gain > least
        and candidate.stations_gaining >= MIN_STATIONS
    )


def can_be_missing(name, predicted, excess):
    """Return whether an effect's predicted gain {group: gain} is MAX_UNDERSTATED times too small to be enough, or more."""
    amply = {group: MAX_UNDERSTATED * gain for group, gain in predicted.items()}
    return sum(predicted.values()) >= MIN_GAIN and is_enough(
        amply, sum(amply.values()), least_gain(name), excess, LITTLE
    )


def is_one_enough(candidates):
    """Return whether the best of some candidates leaves too little for another name."""
    return bool(candidates) and is_nothing_left(rank(candidates)[0].twin)


def least_gain(name):
    """Return the gain in loss that an effect needs, each parameter charged."""
    return MIN_GAIN + CHARGE * len(library.parameters_of(name))


def errors_to_exceed(problem, base, twin):
    """Return the standard errors {(effect, parameter): error} that a twin's parameters must exceed to be certain.

    They are the cautious ones of the captures that were fitted; there are none where the twin gains so clearly over its base, on
    captures that no fit saw, that this says how certain it is: three standard errors of the gain where stations agree about it;
    what a single station sees must be much, and most of what is left.
    """
    gains = gains_by_station(problem, base.losses, twin.losses)
    much = max(CLEAR_GAIN, MOST * sum(base.excess.values()))
    return {} if gains.sum() > min(CERTAIN * error_of_sum(gains), much) else twin.cautious_errors


def is_significant(effect, values, errors):
    """Return whether some parameter is farther from its null than is worth naming and than three standard errors.

    ``errors`` {(effect, parameter): standard error}; what was not fitted has none. One that only says how another acts tells
    nothing. Of many waves, which stand in for one another, none need be certain by itself: together they must be worth naming,
    and what they gain on captures that no fit saw says how certain they are.
    """
    acting = {k: p for k, p in library.parameters_of(effect).items() if not p.auxiliary}
    if len(acting) > MAX_PARAMETERS:
        return math.hypot(*((values[k] - p.null) / p.matters for k, p in acting.items())) > 1
    least = {k: max(p.matters, CERTAIN * errors.get((effect, k), 0.0)) for k, p in acting.items()}
    return any(abs(values[k] - p.null) > least[k] for k, p in acting.items())


def is_as_good(twin, other):
    """Return whether a twin's loss on the held-out captures is less than MIN_GAIN above that of another."""
    return sum(twin.losses.values()) < sum(other.losses.values()) + MIN_GAIN
