"""What goes from many effects fitted at once: what is worth nothing, patches that close little, and what others make up for."""

from dataclasses import replace
from itertools import permutations

import numpy as np

from effects import library
from gap.bounds import CLEAR_GAIN, LITTLE, MIN_GAIN, MOST
from gap.fit.parameters import get_parameter, spec
from gap.fit.residuals import GROUPS
from gap.select.exchange import FIRST_ITERATIONS, has_forms, loss_of, short_fit, standing
from gap.select.naming import is_as_good, is_significant
from gap.select.search import SCALE_FROM_NEAR, SCALE_FROM_START
from gap.select.standing import is_at_floor, is_enough


def pruned(search, base, twin, end):
    """Return (Twin, its Descent) without what it does not need: the weakest first, all others refitted shortly.

    Of what undoes one another neither can go alone: both are taken out together in the end. Behind a codec curves begin anew.
    """
    added = sorted(added_to(twin, base), key=lambda n: (end.evidence.get(n, np.inf), n))
    added = [n for n in added if not (search.is_fixed(n) or search.problem.shows(n))]
    for name in added:
        if _is_clearly_needed(search, end, name):
            continue
        rest = descent_without(search, end, [name])
        if _is_clear(end, name) and _is_clearly_more(rest.loss, end):
            # What others make up for to second order old derivatives need not show
            rest = _with_curves_anew(search, end, name)
        if rest:
            twin, end = _or_what_is_left(search, base, twin, end, rest)
    for pair in permutations(added, 2):
        if _undoes(*pair) and set(pair) <= set(twin.names):
            twin, end = _or_what_is_left(search, base, twin, end, descent_without(search, end, pair))
    return twin, end


def _or_what_is_left(search, base, twin, end, rest):
    """Return (Twin, its Descent) as given, or those of a Descent ``rest`` of less effects, fitted on, where that is as good."""
    rest = short_fit(search, rest.state.effects, rest.state.poses, SCALE_FROM_NEAR, FIRST_ITERATIONS)
    without = standing(search, base, rest)
    if is_as_good(without, twin) or (_is_rough(search, twin) and _leaves_as_little(without, twin)):
        return without, rest
    return twin, end


def _with_curves_anew(search, end, name):
    """Return the Descent without an effect in which curves of its kind begin at nothing, codecs last; None where it has none.

    A curve that was fitted beside another effect stays where the codec's steps hold it, though it could stand for that as well.
    """
    rest = [e for e in end.state.effects if e[0] != name]
    alike = [n for n, _ in rest if _is_curve(n) and library.affects(n) == library.affects(name)]
    curves = [n for n in alike if not search.is_fixed(n)]
    if not curves:
        return None
    effects = [(n, _flat(n, p) if n in curves else p) for n, p in rest]
    rough = [n for n, _ in rest if search.problem.shows(n)]
    return short_fit(search, effects, end.state.poses, SCALE_FROM_START, FIRST_ITERATIONS, rough=rough)


def _flat(name, parameters):
    """Return an effect's parameters at their nulls, but for whole numbers, such as a curve's place in the camera."""
    return library.nulls_of(name) | {k: parameters[k] for k in library.discrete_parameters(name)}


def _is_curve(name):
    """Return whether an effect has many forms and begins at nothing."""
    return has_forms(name) and library.begins_at_nothing(name)


def _undoes(name, other):
    """Return whether an effect sharpens, and another smooths: together neither shows much."""
    return library.undoes(name, other) or (library.sharpens(name) and library.smooths_noise(other))


def _is_clearly_needed(search, end, name):
    """Return whether the second order alone says that an effect of a Descent is needed: a codec's steps make much of an image."""
    return _is_clear(end, name) and (library.is_pure_geometry(name) or not _is_rough(search, end.state))


def _is_rough(search, twin):
    """Return whether a twin has what the captures show by themselves, a codec: its steps make losses discontinuous."""
    return any(search.problem.shows(name) for name, _ in twin.effects)


def _leaves_as_little(twin, other):
    """Return whether a twin leaves no more above the floors of another than that does."""
    return sum(replace(twin, floors=other.floors).excess.values()) < sum(other.excess.values()) + MIN_GAIN


def _is_clear(end, name):
    """Return whether taking an effect of a Descent out costs, to second order, what no refit makes up for."""
    return end.evidence.get(name, np.inf) > CLEAR_GAIN


def _is_clearly_more(loss, end):
    """Return whether a loss is more than that of a Descent by what no refit makes up for."""
    return loss > end.loss + CLEAR_GAIN


def patches_of(search, twin, end, added):
    """Return those of the effects ``added`` in a round that are patches: of one alone, what the round closes tells more."""
    return [n for n in added if _is_patch(search, twin, end, n)] if len(added) > 1 else []


def _is_patch(search, twin, end, name):
    """Return whether an effect of a Descent brings, to second order, too little of a gap that its Twin leaves open.

    Beside all that is left, and beside what is left of the group of observables that it changes most.
    """
    if search.problem.shows(name):
        return False
    mine = [k for k, (effect, _) in enumerate(end.free) if effect == name]
    away = np.array([get_parameter(end.state.effects, end.free[k]) - spec(end.free[k]).null for k in mine])
    changes = dict.fromkeys(GROUPS, 0.0)
    for i, groups in end.groups.items():
        change, at = end.derivatives[i][0][:, mine] @ away, 0
        for group in GROUPS:
            if group in groups:
                changes[group] += float((change[at : at + groups[group].size] ** 2).sum())
                at += groups[group].size
    brought = end.evidence.get(name, np.inf) * len(search.test) / len(end.groups)
    of_group = _odds(MOST) * twin.excess.get(max(changes, key=changes.get), 0.0)
    return brought < min(of_group, _odds(LITTLE) * sum(twin.excess.values()))


def _odds(share):
    """Return what a share of a whole is of the rest of it."""
    return share / (1 - share)


def without_patches(search, twin, base):
    """Return the Twin, refitted, without effects that close little of a gap that stays open: patches on a wrong form."""
    for name in sorted(added_to(twin, base), key=lambda n: (twin.evidence.get(n, np.inf), n)):
        clear = _odds(MOST) * sum(twin.excess.values())
        if is_at_floor(twin) or twin.evidence.get(name, np.inf) > clear:
            break
        rest = search.fitted([e for e in twin.effects if e[0] != name], twin.poses)
        if not closes_enough(rest, twin):
            twin = rest
    return twin


def closes_enough(before, after, share=LITTLE):
    """Return whether a twin closes a share of what another leaves open, or most of a group of observables; in its floors."""
    if sum(after.losses.values()) > sum(before.losses.values()):
        return False  # its floors may be higher: what its own captures differ by
    before = replace(before, floors=after.floors)
    gains = {group: before.excess[group] - left for group, left in after.excess.items()}
    return is_enough(gains, sum(gains.values()), MIN_GAIN, before.excess, share)


def is_idle(search, effects, name, evidence):
    """Return whether an effect is worth nothing to second order; what the captures show by themselves is not asked."""
    if search.problem.shows(name) or search.is_fixed(name):
        return False
    return evidence.get(name, 0.0) < MIN_GAIN or not is_significant(name, dict(effects)[name], {})


def descent_without(search, end, names):
    """Return the Descent without some effects, the others following with its derivatives."""
    rest = [e for e in end.state.effects if e[0] not in names]
    return search.solver.followed(end, rest, search.free(rest))


def refitted_without(search, end, names):
    """Return the ``descent_without`` some effects; all others fitted shortly from where they were where that leaves less, as old
    derivatives lead them astray.
    """
    rest = descent_without(search, end, names)
    if not _is_clearly_more(rest.loss - sum(end.evidence.get(n, 0.0) for n in names), end):
        return rest
    effects = [e for e in end.state.effects if e[0] not in names]
    again = short_fit(search, effects, end.state.poses, SCALE_FROM_START, FIRST_ITERATIONS)
    return min(rest, again, key=loss_of)


def added_to(twin, base):
    """Return the names of a twin's effects that a base has not."""
    return [n for n in twin.names if n not in base.names]
