"""Twins as values, and the ways from one to the next: fit, predict what an effect would gain, try it, adopt it, take it out.

Losses are sums of the robust loss over whitened residuals (gap.fit.residuals); gaps are in units of the floor.
"""

from dataclasses import replace

import numpy as np

from effects import library, pipeline
from gap.bounds import (
    CLEAR_GAIN,
    LITTLE,
    MAX_FLOOR,
    MAX_PARAMETERS,
    MIN_STATION_LOSS,
    TWICE,
)
from gap.fit.evidence import first_order_gains, start_step
from gap.fit.normal_equations import gains_of_step, normal_equations
from gap.fit.parameters import fitted_parameters, in_place, is_geometric, spec
from gap.fit.residuals import GROUPS, NU, flatten, lost_plates, rho, robust_scale_of, total
from gap.fit.score import error_of_sum, gains_by_station, group_gaps, group_losses, shared_gain
from gap.fit.split import probes, split_by_station, thinned, usable
from gap.problem import may_have
from gap.select.discrete import Discrete
from gap.select.kept import kept
from gap.select.naming import errors_to_exceed, is_as_good, is_significant
from gap.select.twin import Candidate, Twin

SCALE_FROM_AFAR, SCALE_FROM_NEAR = 16.0, 2.0  # robust scale at which a fit of corners begins
SCALE_FROM_START = 8.0  # the same from an effect's start, that of images too
MAX_MIMICS, ALIKE_MIMICS = 2, 2  # effects that bring as much together (three do by chance), sets of as many
ITERATIONS_OF_STARTS = 2  # in a few captures, to choose a start
ITERATIONS_OF_RIVALS = 4  # there, to see whether a rival is one
MAX_STARTS = 2  # that are fitted, those of the largest predicted gain, and as many that are nearest


class Search:
    """One problem's captures, split, and the library's effects that compete for it; what it returns are values.

    fixed  {(effect, parameter)} whose values the user wrote: never refitted, and their effects are never taken out
    store  of outcomes (gap.select.kept); None: none are kept
    """

    def __init__(self, problem, candidates=None, fixed=(), split=None, threads=1, store=None):
        self.problem, self.store, self.threads = problem, store, threads
        train, test = split or split_by_station(problem)
        self.train = thinned(usable(train, problem), problem.most_captures)
        self.test = thinned(usable(test, problem), problem.most_held_out)
        self.solver = problem.solver(probes(self.train) + probes(self.test), threads)
        candidates = library.available_effects() if candidates is None else candidates
        self.candidates = [n for n in candidates if may_have(problem, n)]
        self.fixed = frozenset(fixed)
        self._of_starts, self._prepared = {}, (None, None, None)

    @property
    def discrete(self):
        """The discrete.Discrete of the search; it is not held, so that what a search keeps goes with it."""
        return Discrete(self.solver, self.train, self.is_given)

    @property
    def cost(self):
        """How many predictions and derivatives by images were made so far."""
        return self.solver.cost

    def why_unusable(self):
        """Return a sentence that says why nothing can be diagnosed, None where it can."""
        if not self.train and not self.test:
            return "no plate of the rig could be measured in any capture (none in view, or black, or saturated)"
        if not self.train or not self.test:
            return "too few stations show plates: nothing could be held out"
        return None

    def free(self, effects):
        """Return [(effect, parameter)] of all that a fit of a list of effects may move: not what the captures show."""
        return [f for f in fitted_parameters(effects) if not self.is_given(f)]

    def is_given(self, parameter):
        """Return whether nothing moves (effect, parameter): the user wrote its value, or captures show a whole number."""
        return parameter in self.fixed or bool(spec(parameter).discrete and self.problem.shows(parameter[0]))

    def is_fixed(self, name):
        """Return whether an effect stays: every twin of the problem has it, or the user wrote some value of it."""
        return name in dict(self.problem.nuisances) or any(effect == name for effect, _ in self.fixed)

    # -- twins --------------------------------------------------------------------------------------------------------

    @kept
    def fitted(self, effects, poses=None, scale=SCALE_FROM_NEAR):
        """Return the Twin of some effects, all that is free fitted to the training captures from the values given.

        ``scale`` is the robust scale at which a fit of corners begins near ``poses``. A fit from afar leaves codecs out first.
        """
        from_afar = poses is None or scale > SCALE_FROM_NEAR
        rough = [n for n, _ in effects if self.problem.shows(n)] if from_afar else []
        end = self.descended(effects, poses, scale, self.train, 20, rough=rough)
        return self.scored(end)

    def descended(self, effects, poses, scale, captures, iterations, moving=None, rough=()):
        """Return the solver.Descent, in some of the fitted captures, of all that is free or of parameters ``moving``.

        Geometry is fitted to all their corners first, from ``poses`` (nominal where None); then all but effects ``rough``.
        """
        free = self.free(effects)
        if poses is None:
            poses = self.problem.start_poses()
            offsets, scale = self.solver.no_offsets(), SCALE_FROM_AFAR
        else:  # near: corners tell more than points once what their fit adds is known
            offsets = self.solver.offsets_of(effects, poses, self.train)
        geometric = [f for f in free if is_geometric(f)]
        effects, poses = self.solver.fit_geometry(effects, geometric, poses, offsets, self.train, scale, iterations=10)
        if rough:
            effects, poses = self.solver.without_rough(effects, rough, moving or free, poses, captures, iterations)
        return self.solver.descend(effects, moving or free, poses, captures, iterations)

    def scored(self, end, floors=None):
        """Return the Twin of a solver.Descent, its held-out poses fitted; its own floors where none are given."""
        end, *errors = self.solver.with_errors(end)
        effects = end.state.effects
        poses, groups = self.solver.score(effects, end.state.poses, self.test)
        if floors is None:
            _, of_train = self.solver.score(effects, poses, self.train)
            floors = self.floors_at(effects, poses, of_train | groups)
        errors, cautious = (dict(zip(end.free, e, strict=True)) for e in errors)
        return Twin(tuple(effects), poses, groups, floors, errors, cautious, end.evidence, end.loss, end.converged)

    def floors_at(self, effects, poses, groups):
        """Return {group: floor}: what trials of a station differ by, or the twin's own captures from what it expects.

        The second is more where noise meets a codec's jumps, or where a pattern repeats that only the real sensor knows;
        it counts where the twin's noise is like the real one, as far as its own captures are alike.
        """
        floors, noise = self.problem.floors_of(groups), group_gaps(groups, {}).get("noise")
        if noise is None:
            return floors
        own = self.solver.each(
            lambda i: self.solver.self_simulation_residuals(i, effects, poses[i]), probes(self.train)
        )
        scatter = group_gaps(own, {})
        if noise > MAX_FLOOR * max(1.0, scatter.get("noise", 0.0)):
            return floors
        return floors | {name: max(floors.get(name, 1.0), sd) for name, sd in scatter.items()}

    @kept
    def adopt(self, candidate):
        """Return the Twin of a candidate with all its effects refitted together.

        No fit moves them far: discrete parameters of the other effects are compared once more beside the new one.
        """
        twin = candidate.twin if candidate.complete else self.fitted(candidate.twin.effects, candidate.twin.poses)
        compared = self.discrete.compared_once_more(list(twin.effects), candidate.effect, twin.poses)
        if compared == twin.effects:
            return twin
        return min(twin, self.fitted(compared, twin.poses), key=lambda t: t.loss)

    @kept
    def fitted_anew(self, twin, effect, before):
        """Return a Twin, or what leaves less: fitted anew from an effect's starts that are likely beside a Twin ``before``.

        A fit ends in a local minimum near its beginning.
        """
        starts = self._likely_starts(before, effect)
        anew = [in_place(twin.effects, effect, (effect, start)) for start in starts if len(starts) > 1]
        return min([twin, *(self.fitted(e, twin.poses, SCALE_FROM_START) for e in anew)], key=lambda t: t.loss)

    def without_unneeded(self, twin, name):
        """Return the Twin without an effect, refitted, where it is as good on the held-out captures; None where it is not.

        What the captures show by themselves is there.
        """
        if self.problem.shows(name):
            return None
        # A free warp makes up for more than a second order tells
        beside_warp = any(len(p) > MAX_PARAMETERS for _, p in twin.effects)
        if twin.evidence.get(name, 0.0) > CLEAR_GAIN and not beside_warp:
            return None
        rest = self.fitted([e for e in twin.effects if e[0] != name], twin.poses)
        return rest if is_as_good(rest, twin) else None

    # -- what an effect would gain --------------------------------------------------------------------------------------

    def predicted_gains(self, twin, names):
        """Return {effect: training loss that it could gain to first order} of some effects that the twin has not."""
        return {name: sum(self.predicted_gain(twin, name).values()) for name in names if name not in twin.names}

    @kept
    def predicted_gain(self, twin, effect):
        """Return the training loss {group: gain} that an effect that the twin has not could gain to first order.

        About its null, the twin's own parameters going along, or towards one of its starts: a prediction for each parameter
        and start. What is predicted to gain next to nothing need not be fitted.
        """
        starts, towards = self.problem.starts_of(effect), []
        if len(starts) > 1 or starts != library.starts_of(effect):
            towards, _ = self._gains_of_starts(twin, effect, starts, self.prepared_for(twin)[0])
        best = max([self._gain_of(twin, [effect])([effect]), *towards], key=np.sum)
        return dict(zip(GROUPS, best * len(self.train) / max(len(probes(self.train)), 1), strict=True))

    def _gain_of(self, twin, names):
        """Return a function of some of the effects ``names``, which the twin has not.

        It returns the loss (groups,) that these could gain together in the probes, about their nulls.
        """
        (indices, groups, nu), beside = self.prepared_for(twin)
        free = [(n, k) for n in names for k in library.fitted_parameters(n) if not spec((n, k)).auxiliary]
        effects = [*twin.effects, *((n, library.nulls_of(n)) for n in names)]
        derivatives = self.solver.derivatives(effects, free, twin.poses, indices, start_step)
        own = self.free(twin.effects)
        alone = {i: (beside[i], Jp) for i, (_, Jp) in derivatives.items()}
        of_twin = first_order_gains(effects, own, alone, groups, nu) if own else 0.0

        def gain(some):
            mine = [k for k, (name, _) in enumerate(free) if name in some]
            together = {i: (np.hstack([Jt[:, mine], beside[i]]), Jp) for i, (Jt, Jp) in derivatives.items()}
            return first_order_gains(effects, [free[k] for k in mine] + own, together, groups, nu) - of_twin

        return gain

    @kept
    def mimics(self, twin, effect, others):
        """Return lists of other effects predicted to gain together what one of a twin's own brings, the fewest first, then best.

        Asked to first order beside what else the twin has, refitted in a few captures; the most helpful is taken first.
        """
        rest = [e for e in twin.effects if e[0] != effect]
        fit = self.solver.approach(rest, self.free(rest), twin.poses, probes(self.train), ITERATIONS_OF_RIVALS)
        without = replace(twin, effects=tuple(fit.state.effects), poses=fit.state.poses)
        enough = (1 - LITTLE) * self._gain_of(without, [effect])([effect]).sum()
        gain_of, best, sets = self._gain_of(without, others), [], []
        for _ in range(min(len(others), MAX_MIMICS)):
            longer = sorted(([*best, n] for n in others if n not in best), key=lambda s: -gain_of(s).sum())
            best, sets = longer[0], sets + longer[:ALIKE_MIMICS]
        return [taken for taken in sets if gain_of(taken).sum() >= enough]

    @kept
    def may_do_as_well(self, twin, effects):
        """Return whether a list of effects leaves no more than TWICE a Twin's loss after a short fit in a few captures."""
        few = probes(self.train)
        end = self.descended(effects, twin.poses, SCALE_FROM_NEAR, few, ITERATIONS_OF_RIVALS)
        return end.loss <= TWICE * total(self.solver.residuals_of(twin.effects, twin.poses, few), NU)

    def prepared_for(self, twin):
        """Return (probes, their derivatives by the twin's parameters), made once for a twin.

        They cost nothing of the budget: a search whose outcomes are kept needs none, and must end alike.
        """
        if self._prepared[0] is not twin:
            cost = self.cost
            probed = self._probed(twin)
            self._prepared = twin, probed, self._beside(twin, probed)
            self.solver.cost = cost
        return self._prepared[1:]

    def _probed(self, twin):
        """Return (indices of the probes, their residual groups, robust nu) of a twin."""
        indices = probes(self.train)
        groups = self.solver.residuals_of(twin.effects, twin.poses, indices)
        return indices, groups, NU * robust_scale_of(groups) ** 2

    def _beside(self, twin, probed):
        """Return the derivatives {i: (n, k)} of the probes by the twin's free parameters."""
        free = self.free(twin.effects)
        if not free:
            return {i: np.zeros((len(flatten(groups)), 0)) for i, groups in probed[1].items()}
        return {i: Jt for i, (Jt, _) in self.solver.derivatives(twin.effects, free, twin.poses, probed[0]).items()}

    def _gains_of_starts(self, twin, effect, starts, probed):
        """Return for each of an effect's starts what going some way there gains (groups,), and the loss of the start itself.

        The first sees a highlight from afar, the second what a start comes near to though the way there is crooked.
        """
        key = pipeline.key_of(twin.effects), twin.poses.tobytes(), effect
        if key not in self._of_starts:
            self._of_starts[key] = self._followed(twin, effect, starts, probed)
        return self._of_starts[key]

    def _followed(self, twin, effect, starts, probed):
        """Return (gains, losses) of ``_gains_of_starts``."""
        indices, groups, nu = probed
        gains, losses = [], []
        for start in starts:
            ways = self.solver.ways(twin.effects, [*twin.effects, (effect, start)], twin.poses, indices)
            H, g, blocks = normal_equations(ways, groups, nu, (np.zeros((1, 1)), np.zeros(1)))
            gains.append(gains_of_step(np.maximum(g, 0) / np.maximum(H[0], 1e-12), ways, groups, blocks, nu))
            losses.append(sum(rho(flatten(groups[i]) - ways[i][0][:, 0], nu).sum() for i in indices))
        return gains, losses

    # -- trying one -----------------------------------------------------------------------------------------------------

    def null_candidate(self, twin, effect):
        """Return the Candidate of an effect without a predicted gain: at its null, with the base's gap."""
        return Candidate(effect, library.nulls_of(effect), twin, False)

    @kept
    def try_effect(self, twin, effect, beside=(), lead=None):
        """Return the Candidate of one effect added to a twin and fitted, parameters ``beside`` it refitted.

        At its null where a Candidate ``lead`` leaves much less open in a few captures.
        """
        free = self.free([(effect, library.nulls_of(effect))])
        start = self.start(twin, effect, free, lead)
        if start is None:
            return self.null_candidate(twin, effect)
        free += beside if self.problem.draws else self.free(twin.effects)  # what costs nothing is always refitted
        end = self.solver.approach(start, free, twin.poses, self.train, 9, SCALE_FROM_START)
        chosen = self.discrete.with_choices(effect, end.state)
        if chosen != end.state.effects:
            other = self.solver.approach(chosen, free, end.state.poses, self.train, 9, SCALE_FROM_START)
            end = min(end, other, key=lambda e: e.loss)
        return self._candidate(twin, effect, self.scored(end, twin.floors))

    @kept
    def try_jointly(self, twin, effect, start, poses):
        """Return the complete Candidate of one effect added to a twin, all fitted together from effects and poses."""
        new = self.fitted(start, poses, SCALE_FROM_START)
        chosen = self.discrete.with_choices(effect, new)
        if chosen != list(new.effects):
            new = min(new, self.fitted(chosen, new.poses), key=lambda t: t.loss)
        return replace(self._candidate(twin, effect, new), complete=True)

    def start(self, twin, effect, free, lead=None):
        """Return the effects from which a fit of one more starts; None where a Candidate ``lead`` leaves much less open."""
        free = free if self.problem.draws else free + self.free(twin.effects)
        starts = [[*twin.effects, (effect, start)] for start in self._likely_starts(twin, effect)]
        if len(starts) == 1 and not lead:
            return starts[0]
        probe, few = probes(self.train), ITERATIONS_OF_RIVALS if lead else ITERATIONS_OF_STARTS
        fits = [self.solver.approach(s, free, twin.poses, probe, few, SCALE_FROM_START) for s in starts]
        best = min(fits, key=lambda f: f.loss)
        if lead:
            leading = total(self.solver.residuals_of(lead.twin.effects, lead.twin.poses, probe), NU)
            return best.state.effects if best.loss <= TWICE * leading else None
        return best.state.effects

    def _likely_starts(self, twin, effect):
        """Return those of an effect's starts that are worth a short fit."""
        starts = self.problem.starts_of(effect)
        if len(starts) <= MAX_STARTS:
            return starts
        discrete = [k for k in library.discrete_parameters(effect) if not spec((effect, k)).is_choice]
        if discrete:
            nulls = library.nulls_of(effect)
            return [self.discrete.best_values(effect, nulls, list(twin.effects), discrete, twin.poses)]
        gains, losses = self._gains_of_starts(twin, effect, starts, self._probed(twin))
        chosen = {*np.argsort(np.sum(gains, axis=1))[-MAX_STARTS:], *np.argsort(losses)[:MAX_STARTS]}
        return [starts[k] for k in sorted(chosen)]

    def _candidate(self, base, effect, twin):
        values = dict(twin.effects)[effect]
        if self._hides_plates(base, twin):
            return Candidate(effect, values, twin, True)
        gains = gains_by_station(self.problem, base.losses, twin.losses)
        before, after = group_losses(base.groups), group_losses(twin.groups)
        by_group = {name: before[name] - after[name] for name in before}
        has_pattern = any(library.needs_repeats(name) for name in base.names)
        shared = shared_gain(self.problem, base, by_group) if has_pattern else 0.0
        return Candidate(
            effect, values, twin, True,
            gain=float(gains.sum()),
            gain_se=error_of_sum(gains),
            certain_gain=float(gains.sum()) - shared,
            stations_gaining=float((gains > -MIN_STATION_LOSS - 0.02 * gains.sum()).mean()) if len(gains) else 0.0,
            is_significant=is_significant(effect, values, errors_to_exceed(self.problem, base, twin)),
            group_gains=by_group,
        )  # fmt: skip

    def _hides_plates(self, base, twin):
        """Return whether a twin shows fewer plates than the base: one that is lost costs less than one that is far off."""
        plates = sum(len(g["corners"]) for g in twin.groups.values())
        return lost_plates(twin.groups) - lost_plates(base.groups) > LITTLE * plates
