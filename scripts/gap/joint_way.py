"""Many effects at once: what is proposed together is fitted jointly, round by round, until the gap is closed.

Rounds are short fits that propose; names and their values come from the full fit of all that was found, and from taking each
out of it.
"""

from dataclasses import replace

import numpy as np

from effects import library
from gap.bounds import CLEAR_GAIN, CLOSED, LITTLE, MANY, MIN_GAIN, MOST
from gap.exchange import (
    FURTHER_ITERATIONS,
    exchanged,
    from_best_starts,
    has_forms,
    loss_of,
    or_leader_alone,
    short_fit,
    with_best_starts,
)
from gap.geometry_first import told_beside_the_rest, told_by_corners
from gap.linear_model import (
    MIN_SHARE_PROPOSED,
    exchanges,
    linear_model,
    missing_noise,
    proposed,
    selected,
)
from gap.outcome import Selection, outcome_of, steps_to, told_apart, without_unneeded
from gap.parameters import get_parameter, spec
from gap.residuals import GROUPS
from gap.search import (
    SCALE_FROM_NEAR,
    SCALE_FROM_START,
    Search,
    is_as_good,
    is_significant,
)
from gap.solver import State
from gap.standing import is_at_floor, is_enough
from gap.twin import rank
from gap.undoing import undoing

MAX_ROUNDS = 6
MIN_PLATES = 12  # of a capture, of which rounds leave out half
FIRST_ITERATIONS = 9  # of a round's fit


def all_at_once(selection, base, twin, names, before, taken=()):
    """Return the Outcome of many effects added together; None where few of ``names`` are proposed for a twin, or none stays.

    What is proposed is fitted jointly, round by round, and what is then not needed is taken out, of what led from ``base`` to
    the twin, the Steps ``taken``, as well. ``before`` is the first excess.
    """
    problem = selection.search.problem
    is_little_left = is_at_floor(twin) or sum(twin.excess.values()) < MANY * MIN_GAIN
    if problem.is_board or is_little_left or frozenset(twin.names) in selection.ended:
        return None
    outcome = _together(selection, base, twin, names, before, taken, first_proposal)
    shown = any(problem.shows(n) for n in names if n not in twin.names)
    if not shown or selection.is_spent() or (outcome and outcome.verdict == "explained"):
        return outcome
    other = _together(selection, base, twin, names, before, taken, proposal_without_codec)
    return other if other and other.verdict == "explained" else outcome


def _together(selection, base, twin, names, before, taken, propose):
    """Return the Outcome of ``all_at_once`` from a first proposal by the function ``propose``."""
    search = selection.search
    found, order, alike = _in_rounds(selection, base, twin, names, propose)
    if set(found.names) == set(twin.names):
        return None
    found = search.fitted(found.effects, found.poses)
    idle = [n for n in _added(found, base) if _is_idle(search, found.effects, n, found.evidence)]
    if idle:
        found = search.fitted([e for e in found.effects if e[0] not in idle], found.poses)
    found, _ = without_unneeded(search, found, base.names, [])
    found = _without_patches(search, found, base)
    selection.ended.add(frozenset(found.names))
    steps = steps_to(search, base, found, [*(s.effect for s in taken), *order])
    known = {s.effect: s for s in taken}
    steps = [told_apart(step, known.get(step.effect), alike.get(step.effect, []), found) for step in steps]
    left = [search.null_candidate(found, n) for n in names if n not in found.names]
    return outcome_of(search.problem, steps, rank(left), found, before)


def _in_rounds(selection, base, twin, names, propose):
    """Return ``_found`` of rounds in half of the plates; what these keep goes with them, before all are fitted.

    The twin itself where too little is proposed, or what was begun before.
    """
    search = selection.search
    few, found = _with_fewer_plates(search), (twin, [], {})
    first, poses, asked = propose(few, twin, names)
    begun = frozenset(twin.names), frozenset(first.names)
    if len(first.effects) - len(first.along) >= MANY and begun not in selection.begun:
        selection.begun.add(begun)
        ahead = Selection(few, selection.budget - search.cost, {}, _told_by(selection, few))
        found = _found(ahead, _seen(few, base), replace(_seen(few, twin), poses=poses), asked, first)
    search.solver.cost += few.cost
    return found


def first_proposal(search, twin, names):
    """Return (Proposal, poses near it) of what corners tell, and of what is proposed beside that; ``names`` for later rounds."""
    effects, poses, names = told_by_corners(search, twin, names)
    moving = [e for e in effects if e[0] not in twin.names]
    near = _seen(search, replace(twin, effects=tuple(effects), poses=poses)) if moving else twin
    return proposed(search, near, names).after(moving), poses, names


def proposal_without_codec(search, twin, names):
    """Return ``first_proposal`` of all but what captures show by themselves, and that before it: in a linear model a codec
    takes what a mosaic or a pattern does.
    """
    shown = [(n, search.problem.starts_of(n)[0]) for n in names if search.problem.shows(n) and n not in twin.names]
    others, poses, left = first_proposal(search, twin, [n for n in names if n not in dict(shown)])
    return others.after(shown), poses, left


def _told_by(selection, few):
    """Return what a Selection's progress is told by while another Search spends of its budget; None where nobody asks."""
    if selection.progress is None:
        return None
    return lambda names, _: selection.progress(names, (selection.search.cost + few.cost) / selection.budget)


def _with_fewer_plates(search):
    """Return the Search for what half of the plates show, in all captures the same: rounds ask what is there, not how much."""
    captures = []
    for capture in search.problem.captures:
        measured = capture.observation.measured.copy()
        if measured.sum() >= MIN_PLATES:
            measured[np.arange(len(measured)) % 4 % 3 > 0] = False
        captures.append(replace(capture, observation=replace(capture.observation, measured=measured)))
    few = replace(search.problem, captures=captures)
    return Search(few, search.candidates, search.fixed, (search.train, search.test), search.threads)


def _seen(search, twin):
    """Return a Twin as the captures of another search see it, in floors of its own, as the verdict's are."""
    effects = list(twin.effects)
    poses, groups = search.solver.score(effects, twin.poses, search.test)
    _, of_train = search.solver.score(effects, poses, search.train)
    return replace(twin, poses=poses, groups=groups, floors=search.floors_at(effects, poses, of_train | groups))


def _found(selection, base, here, names, proposal):
    """Return (Twin of all that several rounds found, the order in which names were proposed, {name: effects [(name, p)] that
    do as well in its place}).
    """
    search, order, dropped, alike = selection.search, [], set(), {}
    at, model, undone, noise_asked = None, None, False, False
    for _ in range(MAX_ROUNDS):
        if dropped.issuperset(proposal.names) and at and not noise_asked:
            noise_asked, proposal = True, missing_noise(search, here, *model)
        if dropped.issuperset(proposal.names) and at and not undone and not _is_nearly_closed(base, here):
            undone, proposal = True, undoing(search, at, names)
        if dropped.issuperset(proposal.names) or selection.is_spent():
            break
        order += [n for n in proposal.names if n not in order]
        if selection.progress:
            selection.progress(", ".join(proposal.names), search.cost / selection.budget)
        beside = replace(here, effects=tuple(e for e in here.effects if e[0] not in proposal.names))
        there, end, as_good, went = _round(search, base, beside, proposal)
        if there is None:
            dropped = set(proposal.names)
            continue
        here, at, alike, dropped = there, end, alike | as_good, went
        model = linear_model(search, here, [n for n in names if n not in here.names])
        if is_at_floor(here):
            break
        least = LITTLE if _is_nearly_closed(base, here) else MIN_SHARE_PROPOSED
        proposal = selected(search, here, *model, least, MOST)
    if at is None:
        return here, order, alike
    told, at = _with_geometry_told_again(search, base, here, at, names)
    told, at = _pruned(search, base, told, at)
    rivals = exchanges(search, here, told.names, *model)
    found, at, as_good = _with_exchanges(search, base, told, at, rivals)
    if set(found.names) != set(told.names):  # another may have stood for a part of what went
        rest = [n for n in names if n not in {*told.names, *found.names}]
        rivals = exchanges(search, found, found.names, *linear_model(search, found, rest))
        found, at, again = _with_exchanges(search, base, found, at, rivals)
        as_good |= again
    return found, order, alike | as_good


def _is_nearly_closed(base, twin):
    """Return whether a twin leaves little of what a base leaves open; in its floors."""
    return sum(twin.excess.values()) < CLOSED * sum(replace(base, floors=twin.floors).excess.values())


def _with_exchanges(search, base, twin, end, rivals):
    """Return (Twin, its Descent, {name: effects that do as well in its place}) in which effects gave way to ``rivals`` of theirs,
    {name: others}, where these do better: beside all others another may be the right one.

    As in ``exchanged``, of many forms one has a simple one's place only where it leaves ``LITTLE`` less.
    """
    alike = {}
    for name, others in rivals.items():
        others = [n for n in others if n not in dict(end.state.effects)]
        if name in base.names or not others:
            continue
        other_end, kept, as_good = exchanged(search, end, name, others, FIRST_ITERATIONS)
        other = _standing(search, base, other_end)
        is_simpler = has_forms(name) and not has_forms(kept)
        enough = sum(twin.losses.values()) / (1 - LITTLE if is_simpler else 1.0)
        if kept == name or sum(other.losses.values()) < enough:
            twin, end, alike = other, other_end, alike | {kept: as_good}
    return twin, end, alike


def _with_geometry_told_again(search, base, twin, end, names):
    """Return (Twin, its Descent) in which corners tell beside all the rest what moves points alone, where that does better."""
    effects, poses = told_beside_the_rest(search, twin, [n for n in names if n not in base.names])
    if {n for n, _ in effects} == set(twin.names):
        return twin, end
    other_end = short_fit(search, effects, poses, SCALE_FROM_NEAR, FIRST_ITERATIONS)
    other = _standing(search, base, other_end)
    is_better = sum(other.losses.values()) + MIN_GAIN < sum(twin.losses.values())
    return (other, other_end) if is_better else (twin, end)


def _round(search, base, here, proposal):
    """Return (Twin with what stays of a Proposal, its Descent, {name: effects that do as well in its place}, names that went).

    All None where too little stays, or closes too little.
    """
    end, as_good = _fitted_in(search, here, proposal)
    along = [n for name in proposal.along for n in (name, *proposal.rivals[name]) if n in dict(end.state.effects)]
    if along and all(_is_idle(search, end.state.effects, n, end.evidence) for n in along):
        end, as_good = _fitted_in(search, here, proposal.alone)  # beside it others seemed to be needed
    if set(here.names) == set(base.names):
        end = or_leader_alone(search, here, proposal, end, FIRST_ITERATIONS)
    idle = [n for n, _ in end.state.effects if n not in here.names]
    idle = [n for n in idle if _is_idle(search, end.state.effects, n, end.evidence)]
    if idle:
        end = _without(search, end, idle)
    there = _standing(search, base, end)
    added = _added(there, here)
    if not added and _closes_enough(here, there):  # what was found before was not fitted to its end
        return there, end, as_good, set(idle)
    patches = _patches(search, there, end, added)
    if not set(added) - set(patches):
        return None, None, None, None
    if patches:
        end = _without(search, end, patches)
        there = _standing(search, base, end)
    asked = [n for n in _added(there, here) if not search.problem.shows(n)]
    share = min(LITTLE * len(asked), MOST)
    closes = _closes_enough(here, there, share)
    if not closes and _closes_enough(here, there, share / 2):  # a codec may hold its fit
        rough = [n for n in there.names if search.problem.shows(n)]
        again = short_fit(search, end.state.effects, end.state.poses, SCALE_FROM_NEAR, FIRST_ITERATIONS, rough=rough)
        end = min(end, again, key=loss_of)
        there = _standing(search, base, end)
        closes = _closes_enough(here, there, share)
    return (there, end, as_good, {*idle, *patches}) if closes else (None, None, None, None)


def _pruned(search, base, twin, end):
    """Return (Twin, its Descent) without what it does not need: the weakest first, all others refitted shortly."""
    for name in sorted(_added(twin, base), key=lambda n: (end.evidence.get(n, np.inf), n)):
        if search.is_fixed(name) or search.problem.shows(name) or _is_clearly_needed(search, end, name):
            continue
        rest = _without(search, end, [name])
        if _is_clear(end, name) and _is_clearly_more(rest.loss, end):
            continue  # else others make up for it to second order: old derivatives may not lead there
        rest = short_fit(search, rest.state.effects, rest.state.poses, SCALE_FROM_NEAR, FIRST_ITERATIONS)
        without = _standing(search, base, rest)
        if is_as_good(without, twin) or (_is_rough(search, twin) and _leaves_as_little(without, twin)):
            twin, end = without, rest
    return twin, end


def _is_clearly_needed(search, end, name):
    """Return whether the second order alone says that an effect of a Descent is needed: a codec's steps make much of an image."""
    return _is_clear(end, name) and (library.is_pure_geometry(name) or not _is_rough(search, end.state))


def _is_clear(end, name):
    """Return whether taking an effect of a Descent out costs, to second order, what no refit makes up for."""
    return end.evidence.get(name, np.inf) > CLEAR_GAIN


def _is_clearly_more(loss, end):
    """Return whether a loss is more than that of a Descent by what no refit makes up for."""
    return loss > end.loss + CLEAR_GAIN


def _is_rough(search, twin):
    """Return whether a twin has what the captures show by themselves, a codec: its steps make losses discontinuous."""
    return any(search.problem.shows(name) for name, _ in twin.effects)


def _leaves_as_little(twin, other):
    """Return whether a twin leaves no more above the floors of another than that does."""
    return sum(replace(twin, floors=other.floors).excess.values()) < sum(other.excess.values()) + MIN_GAIN


def _added(twin, base):
    return [n for n in twin.names if n not in base.names]


def _closes_enough(before, after, share=LITTLE):
    """Return whether a twin closes a share of what another leaves open, or most of a group of observables; in its floors."""
    if sum(after.losses.values()) > sum(before.losses.values()):
        return False  # its floors may be higher: what its own captures differ by
    before = replace(before, floors=after.floors)
    gains = {group: before.excess[group] - left for group, left in after.excess.items()}
    return is_enough(gains, sum(gains.values()), MIN_GAIN, before.excess, share)


def _patches(search, twin, end, added):
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


def _without_patches(search, twin, base):
    """Return the Twin, refitted, without effects that close little of a gap that stays open: patches on a wrong form."""
    for name in sorted(_added(twin, base), key=lambda n: (twin.evidence.get(n, np.inf), n)):
        clear = _odds(MOST) * sum(twin.excess.values())
        if is_at_floor(twin) or twin.evidence.get(name, np.inf) > clear:
            break
        rest = search.fitted([e for e in twin.effects if e[0] != name], twin.poses)
        if not _closes_enough(rest, twin):
            twin = rest
    return twin


def _is_idle(search, effects, name, evidence):
    """Return whether an effect is worth nothing to second order; what the captures show by themselves is not asked."""
    if search.problem.shows(name) or search.is_fixed(name):
        return False
    return evidence.get(name, 0.0) < MIN_GAIN or not is_significant(name, dict(effects)[name], {})


def _fitted_in(search, twin, proposal):
    """Return (Descent of a twin with all effects of a Proposal, {name: [(other, p)] that do as well in its place}).

    Whole values and rivals are compared beside all the others.
    """
    new, rough = search.free(proposal.effects), [n for n in proposal.names if search.problem.shows(n)]
    effects = with_best_starts(search, twin, proposal)
    end = short_fit(search, effects, twin.poses, SCALE_FROM_START, FIRST_ITERATIONS, new, rough)
    effects, poses = from_best_starts(search, end, proposal.names)
    iterations = FURTHER_ITERATIONS if effects == list(end.state.effects) else FIRST_ITERATIONS
    effects = list(search.discrete.compared_once_more(effects, None, poses))
    for name in proposal.names:
        effects = search.discrete.with_choices(name, State(effects, poses))
    if effects != list(end.state.effects) or search.free(twin.effects):
        end = short_fit(search, effects, poses, SCALE_FROM_START, iterations)
    alike = {}
    for name in proposal.names:
        rivals = [n for n in proposal.rivals[name] if n not in dict(end.state.effects)]
        if rivals and not _is_idle(search, end.state.effects, name, end.evidence):
            end, kept, as_good = exchanged(search, end, name, rivals)
            alike[kept] = as_good
    return end, alike


def _without(search, end, names):
    """Return the Descent without some effects, the others following with its derivatives."""
    rest = [e for e in end.state.effects if e[0] not in names]
    return search.solver.followed(end, rest, search.free(rest))


def _standing(search, base, end):
    """Return the Twin of a Descent as far as held-out captures tell it."""
    return _seen(search, replace(base, effects=tuple(end.state.effects), poses=end.state.poses, loss=end.loss))
