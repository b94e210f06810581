"""What a twin may lack that undoes one another, as a blur and the sharpening after it: to first order neither promises much."""

from itertools import product

from effects import library
from gap.exchange import short_fit
from gap.linear_model import Proposal
from gap.search import MAX_STARTS, MIN_GAIN, SCALE_FROM_NEAR


def undoing(search, end, names):
    """Return the Proposal of the spread of light and the filter that sharpens, of some effects, that leave least together beside
    a Descent's others, their own parameters fitted alone from their starts; an empty one where none leave less than there is.
    """
    spreads = [n for n in names if library.affects(n) == "point_spread"]
    best, chosen = end, ()
    for pair in product(spreads, filter(library.sharpens, names)):
        others = [e for e in end.state.effects if e[0] not in pair]
        own = search.free([(n, library.nulls_of(n)) for n in pair])
        for starts in product(*(search.problem.starts_of(n)[:MAX_STARTS] for n in pair)):
            effects = [*others, *zip(pair, starts, strict=True)]
            trial = short_fit(search, effects, end.state.poses, SCALE_FROM_NEAR, moving=own)
            if trial.loss < best.loss - MIN_GAIN:
                best, chosen = trial, pair
    return Proposal([(n, dict(best.state.effects)[n]) for n in chosen], {n: [] for n in chosen})
