"""Many effects at once: what is proposed together is fitted jointly, round by round, until the gap is closed.

Rounds are short fits that propose; names and their values come from the full fit of all that was found, and from taking each
out of it.
"""

from dataclasses import replace

import numpy as np

from gap.bounds import CLOSED, LITTLE, MANY, MIN_GAIN, MOST
from gap.fit.solver import State
from gap.select.exchange import (
    FIRST_ITERATIONS,
    FURTHER_ITERATIONS,
    exchanged,
    from_best_starts,
    has_forms,
    loss_of,
    or_leader_alone,
    seen,
    short_fit,
    standing,
    with_best_starts,
)
from gap.select.geometry_first import told_beside_the_rest, told_by_corners
from gap.select.linear_model import (
    MIN_SHARE_PROPOSED,
    exchanges,
    linear_model,
    missing_noise,
    proposed,
    selected,
)
from gap.select.outcome import Selection, outcome_of, steps_to, told_apart, without_unneeded
from gap.select.pruning import (
    added_to,
    closes_enough,
    descent_without,
    is_idle,
    patches_of,
    pruned,
    refitted_without,
    without_patches,
)
from gap.select.search import SCALE_FROM_NEAR, SCALE_FROM_START, Search
from gap.select.standing import is_at_floor
from gap.select.twin import rank
from gap.select.undoing import undoing

MAX_ROUNDS = 8
MIN_PLATES = 12  # of a capture, of which rounds leave out half


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
    idle = [n for n in added_to(found, base) if is_idle(search, found.effects, n, found.evidence)]
    if idle:
        found = search.fitted([e for e in found.effects if e[0] not in idle], found.poses)
    found, _ = without_unneeded(search, found, base.names, [])
    found = without_patches(search, found, base)
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
        found = _found(ahead, seen(few, base), replace(seen(few, twin), poses=poses), asked, first)
    search.solver.cost += few.cost
    return found


def first_proposal(search, twin, names):
    """Return (Proposal, poses near it) of what corners tell, and of what is proposed beside that; ``names`` for later rounds."""
    effects, poses, names = told_by_corners(search, twin, names)
    moving = [e for e in effects if e[0] not in twin.names]
    near = seen(search, replace(twin, effects=tuple(effects), poses=poses)) if moving else twin
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


def _found(selection, base, here, names, proposal):
    """Return (Twin of all that several rounds found, the order in which names were proposed, {name: effects [(name, p)] that
    do as well in its place}).
    """
    search, order, dropped, alike = selection.search, [], set(), {}
    at, model, told, undone, noise_asked = None, None, None, False, False
    for _ in range(MAX_ROUNDS):
        if dropped.issuperset(proposal.names) and at and here is not told:
            told, at = _with_geometry_told_again(search, base, here, at, names)
            if told is not here:  # what was looked for may have made up for it
                here, dropped, model = told, set(), _model_beside(search, told, names)
                proposal = _proposed_beside(search, base, here, model)
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
        model = _model_beside(search, here, names)
        if is_at_floor(here):
            break
        proposal = _proposed_beside(search, base, here, model)
    if at is None:
        return here, order, alike
    if here is not told:
        told, at = _with_geometry_told_again(search, base, here, at, names)
    told, at = pruned(search, base, told, at)
    rivals = exchanges(search, here, told.names, *model)
    found, at, as_good = _with_exchanges(search, base, told, at, rivals)
    if set(found.names) != set(told.names):  # another may have stood for a part of what went
        rest = [n for n in names if n not in told.names]
        rivals = exchanges(search, found, found.names, *_model_beside(search, found, rest))
        found, at, again = _with_exchanges(search, base, found, at, rivals)
        as_good |= again
    return found, order, alike | as_good


def _model_beside(search, twin, names):
    """Return (Ways, LinearModel) of those of ``names`` that a twin has not."""
    return linear_model(search, twin, [n for n in names if n not in twin.names])


def _proposed_beside(search, base, twin, model):
    """Return the next round's Proposal beside a twin, of its ``_model_beside``."""
    least = LITTLE if _is_nearly_closed(base, twin) else MIN_SHARE_PROPOSED
    return selected(search, twin, *model, least, MOST)


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
        other = standing(search, base, other_end)
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
    other = standing(search, base, other_end)
    is_better = sum(other.losses.values()) + MIN_GAIN < sum(twin.losses.values())
    return (other, other_end) if is_better else (twin, end)


def _round(search, base, here, proposal):
    """Return (Twin with what stays of a Proposal, its Descent, {name: effects that do as well in its place}, names that went).

    All None where too little stays, or closes too little.
    """
    end, as_good = _fitted_in(search, here, proposal)
    along = [n for name in proposal.along for n in (name, *proposal.rivals[name]) if n in dict(end.state.effects)]
    if along and all(is_idle(search, end.state.effects, n, end.evidence) for n in along):
        end, as_good = _fitted_in(search, here, proposal.alone)  # beside it others seemed to be needed
    if set(here.names) == set(base.names):
        end = or_leader_alone(search, here, proposal, end, FIRST_ITERATIONS)
    idle = [n for n, _ in end.state.effects if n not in here.names]
    idle = [n for n in idle if is_idle(search, end.state.effects, n, end.evidence)]
    if idle:
        end = descent_without(search, end, idle)
    there = standing(search, base, end)
    added = added_to(there, here)
    if not added and closes_enough(here, there):  # what was found before was not fitted to its end
        return there, end, as_good, set(idle)
    patches = patches_of(search, there, end, added)
    if not set(added) - set(patches):
        return None, None, None, None
    if patches:
        end = refitted_without(search, end, patches)
        there = standing(search, base, end)
    asked = [n for n in added_to(there, here) if not search.problem.shows(n)]
    share = min(LITTLE * len(asked), MOST)
    closes = closes_enough(here, there, share)
    if not closes and closes_enough(here, there, share / 2):  # a codec may hold its fit
        rough = [n for n in there.names if search.problem.shows(n)]
        again = short_fit(search, end.state.effects, end.state.poses, SCALE_FROM_NEAR, FIRST_ITERATIONS, rough=rough)
        end = min(end, again, key=loss_of)
        there = standing(search, base, end)
        closes = closes_enough(here, there, share)
    return (there, end, as_good, {*idle, *patches}) if closes else (None, None, None, None)


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
        if rivals and not is_idle(search, end.state.effects, name, end.evidence):
            end, kept, as_good = exchanged(search, end, name, rivals)
            alike[kept] = as_good
    return end, alike
