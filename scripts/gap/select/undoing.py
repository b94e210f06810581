"""What a twin may lack that undoes one another, as a blur and the sharpening after it: each one's predicted gain is small."""

from itertools import product

from effects import library
from gap.bounds import MIN_GAIN
from gap.select.exchange import fitted_alone
from gap.select.linear_model import Proposal
from gap.select.search import MAX_STARTS


def undoing(search, end, names):
    """Return the Proposal of the spread of light and the filter that sharpens, of some effects, that leave least together beside
    a Descent's others, their own parameters fitted alone from their starts; an empty one where none leave less than there is.
    """
    pairs = [(spread, after) for spread, after in product(names, names) if library.undoes(after, spread)]
    best, chosen = end, ()
    for pair in pairs:
        others = [e for e in end.state.effects if e[0] not in pair]
        for starts in product(*(search.problem.starts_of(n)[:MAX_STARTS] for n in pair)):
            trial = fitted_alone(search, [*others, *zip(pair, starts, strict=True)], end.state.poses, pair)
            if trial.loss < best.loss - MIN_GAIN:
                best, chosen = trial, pair
    return Proposal([(n, dict(best.state.effects)[n]) for n in chosen], {n: [] for n in chosen})
