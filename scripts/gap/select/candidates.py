"""Candidates of one step: those predicted to gain most, fitted, and those whose gain no prediction of first order sees."""

import numpy as np

from effects import library
from gap.bounds import MAX_PARAMETERS, MIN_GAIN, RIVAL_SHARE
from gap.fit.parameters import in_place
from gap.fit.split import probes
from gap.select.exchange import loss_of, short_fit
from gap.select.naming import MAX_UNDERSTATED, can_be_missing, is_flexible, is_missing_from
from gap.select.search import ITERATIONS_OF_STARTS, MAX_STARTS, SCALE_FROM_START
from gap.select.twin import rank

MAX_TRIED_AGAIN = 4  # candidates that are fitted in later steps; others stay at their null
MAX_TRIED_WHOLLY = 2  # of those that left least after a short fit of everything
MIN_SHARE_OF_BEST = 0.03  # of the largest predicted gain: less is not fitted in this step


def try_best_predicted(search, twin, names, most, beside=(), known=None):
    """Return (candidates of some effects, best first; {effect: predicted gain}).

    Those with the largest are fitted, the others stay at their null. ``known`` are gains that were predicted of an earlier
    twin: what had next to none is asked again only where nothing else is worth its name.
    """
    names, known = [n for n in names if n not in twin.names], known or {}
    least = MIN_SHARE_OF_BEST * max((known.get(n, 0.0) for n in names), default=0.0)
    gains = {n: search.predicted_gain(twin, n) for n in names if known.get(n, np.inf) >= least}
    tried = _fitted_ones(search, twin, gains, most, beside, {})
    if not any(is_missing_from(search, twin, c) for c in tried.values()):
        gains |= {n: search.predicted_gain(twin, n) for n in names if n not in gains}
        tried = _fitted_ones(search, twin, gains, most, beside, tried)
    candidates = rank(tried.get(n) or search.null_candidate(twin, n) for n in names)
    return candidates, known | {n: sum(by_group.values()) for n, by_group in gains.items()}


def _fitted_ones(search, twin, by_group, most, beside, tried):
    """Return {effect: Candidate} of those tried before and of those predicted to gain most, ``by_group`` {effect: {group: gain}}.

    They are fitted in the order of their predicted gains, none predicted to gain far less than it would have to. Once one is
    worth its name, only its rivals are of interest: what else is missing is seen better beside it.
    """
    gains = {n: sum(g.values()) for n, g in by_group.items() if can_be_missing(n, g, twin.excess)}
    tried = dict(tried)
    best_predicted = sorted(gains, key=lambda n: (-gains[n], n))[:most]
    alone = twin.names and not any(gains[n] >= RIVAL_SHARE * gains[best_predicted[0]] for n in best_predicted[1:])
    for name in best_predicted:
        lead = next((c for c in rank(tried.values()) if is_missing_from(search, twin, c)), None)
        least = RIVAL_SHARE if lead and search.problem.draws else MIN_SHARE_OF_BEST
        if name in tried or gains[name] < least * gains[best_predicted[0]]:
            continue
        if alone and name == best_predicted[0] and not is_flexible(name):
            start = search.start(twin, name, search.free([(name, library.nulls_of(name))]))
            tried[name] = search.try_jointly(twin, name, start, twin.poses)  # no rival: no fit of its own first
        else:
            tried[name] = search.try_effect(twin, name, beside, lead)
    return tried


def try_beside_others(search, twin, names, known):
    """Return (candidates of some effects, best first; their predicted gains), beside those of a twin, as ``try_best_predicted``.

    What was adopted may have made up for a part of the largest predicted gain: the twin's few parameters are refitted with each.
    """
    free = search.free(twin.effects)
    beside = free if len(free) <= MAX_PARAMETERS else ()
    return try_best_predicted(search, twin, names, MAX_TRIED_AGAIN, beside, known)


def try_by_short_fits(search, twin, candidates):
    """Return the candidates, best first, of which those that a twin's effects undo, or that undo them, are fitted with everything
    else where they leave least after a short fit from their starts.

    Their predicted gain is zero to first order.
    """
    names = [c.effect for c in candidates if not (c.complete or is_flexible(c.effect))]
    undone = {name: [n for n in twin.names if library.undoes(n, name) or library.undoes(name, n)] for name in names}
    if not any(undone.values()):
        return candidates
    without, ends = short_fit(search, list(twin.effects), twin.poses, SCALE_FROM_START, ITERATIONS_OF_STARTS), {}
    enough = without.loss - MIN_GAIN / MAX_UNDERSTATED * len(probes(search.train)) / len(search.train)
    for name in (n for n in names if undone[n]):
        starts = search.problem.starts_of(name)[:MAX_STARTS]
        effects = [[*beside, (name, start)] for start in starts for beside in _beside(search, twin, undone[name])]
        fits = [short_fit(search, some, twin.poses, SCALE_FROM_START, ITERATIONS_OF_STARTS) for some in effects]
        ends[name] = min(fits, key=loss_of)
    least = sorted((n for n in ends if ends[n].loss < enough), key=lambda n: ends[n].loss)[:MAX_TRIED_WHOLLY]
    tried = [search.try_jointly(twin, n, ends[n].state.effects, ends[n].state.poses) for n in least]
    return rank([*(c for c in candidates if c.effect not in least), *tried])


def _beside(search, twin, undone):
    """Return the lists of effects beside which another begins: a twin's own, and those in which one ``undone`` begins anew."""
    own = list(twin.effects)
    anew = [in_place(own, n, (n, start)) for n in undone for start in search.problem.starts_of(n)[:MAX_STARTS]]
    return [own, *anew]
