"""Which changes a comparison of two sets of captures would have shown: the least amount of each effect that is seen.

Captures that are divided otherwise into two sets differ by chance alone. A change is laid on the second set of some such
divisions, each is compared as the given one is, and the change is seen where most of them show it.
"""

from bisect import bisect_left

from effects import library
from gap.fit.parameters import scaled

TRIED, SEEN = 9, 0.5  # divisions, and the share of them
AMOUNTS = [2.0 ** (k / 2) for k in range(-8, 5)]  # times a clear one, that are tried
CLEAR = 5.0  # times what matters, of an effect that starts at nothing


def clear_ones(effect):
    """Return parameters [{name: value}] with which an effect is clearly seen: its starts, or each parameter moved by itself."""
    if not library.begins_at_nothing(effect):
        return library.starts_of(effect)
    nulls = library.nulls_of(effect)
    acting = {k: p for k, p in library.parameters_of(effect).items() if not (p.auxiliary or p.is_choice)}
    return [nulls | {k: nulls[k] + CLEAR * p.matters} for k, p in acting.items()]


def least_seen(effect, power):
    """Return (times, {parameter: value}): the least amount of an effect that is seen, in times of a clear one; None where none
    of ``AMOUNTS`` is.

    power takes the effect's parameters and returns the share of divisions in which they are seen. Of several clear ones, each
    another form of the effect, that counts which is seen first.
    """
    k, least = len(AMOUNTS), None
    for clear in clear_ones(effect):
        amounts = [scaled(effect, clear, times) for times in AMOUNTS]
        first = bisect_left(amounts, SEEN, hi=k, key=power)
        if first < k:
            k, least = first, (AMOUNTS[first], amounts[first])
    return least
