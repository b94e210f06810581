"""What photographs of a board cannot tell, and which further ones would: from the information that they hold.

But for other effects in a name's place nothing is fitted: a twin says what photographs would show that nobody has taken yet. What
each photograph has for itself, a pose (OfPoints) or a light (gap.signatures.needs_of_cells), is free in all of them.
"""

from copy import copy
from dataclasses import replace

import numpy as np

from effects import library
from gap.boards.instructions import FURTHER, MORE, PLACES, TURNS
from gap.bounds import CERTAIN, MIN_GAIN
from gap.fit.derivatives import differences, flat, steps_from
from gap.fit.parameters import fitted_parameters, get_parameter, priors_of, small_step, spec, with_parameters
from gap.fit.split import thinned
from gap.select.exchange import as_good_instead
from gap.select.naming import is_flexible
from rig.geometry import N_POSE, perturb_pose
from rig.words import plain

MIN_INFORMATION = CERTAIN**2  # times a squared amount from which that amount is seen: three standard errors


def cannot_tell(search, twin, names):
    """Return (hidden, alike, needs) of a fitted Twin of a board's points and the effects that compete.

    hidden  [effect]: of those that the twin has not, what would stay unseen at the amount that is worth naming
    alike   {effect of the twin: [others]} that would do as well in its place: MIN_GAIN of loss does not lie between them, to
            first order, or, of a MAX_GROUP at most, when they are fitted there: what is left open may hide what tells them apart
    needs   [{"effect", "text"}]: of hidden ones and of the others of ``alike``, what further photographs would show them
    """
    told = Told(search, twin, names)
    hidden = told.hidden()
    named = [n for n in twin.names if n in names and not is_flexible(n) and not search.is_fixed(n)]
    apart = {n: {o: told.apart(n, o) for o in told.others} for n in named}
    alike = {n: [o for o in told.others if apart[n][o] < MIN_GAIN] for n in named}
    as_good = {n: as_good_instead(search, twin, n, _starts(told.others, alike[n])) for n in named}
    alike = {n: others for n in named if (others := [*alike[n], *as_good[n]])}
    told = told.of_fewer({*hidden, *(o for others in alike.values() for o in others)})
    needs = told.needs(hidden)
    for n, others in alike.items():
        for o in others:
            enough = MIN_GAIN + (apart[n][o] if o in as_good[n] else 0.0)  # what is there has not told
            needs.append(told.need(o, f" from {plain(n)}", enough, lambda more, n=n, o=o: told.apart(n, o, more)))
    return hidden, alike, [need for need in needs if need]


def _starts(names, known):
    """Return [(effect, its first start)] of some effects but for known ones."""
    return [(n, library.nulls_of(n) | library.starts_of(n)[0]) for n in names if n not in known]


class OfPoints:
    """What a board's points tell in photographs [(Capture, pose)] of a search: maps of points are exact, poses are free."""

    instructions = (*TURNS, *PLACES, MORE)  # points are where they are in any light
    each, tries = 1.0, 1  # times that each photograph counts, further ones that must do by themselves

    def __init__(self, search, twin):
        self.problem = search.problem
        of_search = sorted({*search.train, *search.test})
        self.photographs = [(self.problem.captures[i], twin.poses[i]) for i in of_search]

    def derivatives(self, effects, free, photograph):
        """Return d points by the free parameters (n, k) and by the pose (n, 6 or more), over the noise, of points shown;
        priors' rows last.
        """
        capture, pose = photograph

        def pixels(effects, delta):
            return flat(self.problem.corners_of(capture, effects, delta))

        def slope(high, low, h):
            return ((high - low) / (2 * h * self.problem.noise_px))[seen].ravel()

        here = pixels(effects, pose)
        view = capture.view
        seen = (np.isfinite(here) & (here > 0) & (here < [view.width - 1, view.height - 1])).all(1)
        if capture.observation is not None:
            seen &= capture.observation.measured
        J = []
        for f in free:
            h, value = small_step(f), get_parameter(effects, f)
            J.append(slope(*(pixels(with_parameters(effects, [f], [value + s * h]), pose) for s in (1, -1)), h))
        by_pose = differences([pixels(effects, moved) for moved in steps_from(pose, self.problem.moving_numbers)])
        Jp = (by_pose[seen] / self.problem.noise_px).reshape(-1, len(pose))
        J = np.stack(J, axis=1) if J else np.zeros((len(Jp), 0))
        return np.vstack([J, np.zeros((len(pose), len(free)))]), np.vstack([Jp, np.diag(1 / self.problem.sigma_pose)])

    def further(self, instruction, _):
        """Return (photographs that nobody has taken, how many times each counts), like some of those that there are but for what
        an Instruction says.
        """
        chosen = thinned(self.photographs, FURTHER)
        views = [replace(c.view, T_cam_world=perturb_pose(c.view.T_cam_world, pose[:N_POSE])) for c, pose in chosen]
        views = instruction.views(views, self.problem.points.mean(axis=0))
        taken = [
            (replace(capture, view=view, observation=None), np.zeros(len(pose)))
            for view, (capture, pose) in zip(views, chosen, strict=True)
        ]
        return taken, self.each


class Told:
    """The information that photographs hold on the effects of a twin and on ``others``, those of ``names`` that it has not, each
    at its null.

    ``look`` says what is looked at in photographs: OfPoints, needs_of_cells.OfCells.
    """

    def __init__(self, search, twin, names, look=OfPoints):
        self.look, self.map = look(search, twin), search.solver.map
        self.others = [n for n in names if n not in twin.names and not is_flexible(n)]
        self.effects = [*twin.effects, *((n, library.nulls_of(n)) for n in self.others)]
        own = set(search.free(twin.effects))
        acting = [f for f in fitted_parameters(self.effects) if f[0] not in self.others or not spec(f).auxiliary]
        self.free = [f for f in acting if f in own or f[0] in self.others]
        self.precision = priors_of(self.free)[1]
        self.variance = max(twin.gap, 1.0) ** 2  # of residuals: what is open hides effects as noise does
        self.taken = sum(self.map(lambda one: self._information([one], self.look.each), self.look.photographs))
        self._brought = {}

    def of_fewer(self, others):
        """Return the Told of fewer others: what further photographs show of the rest need not be known."""
        fewer = copy(self)
        kept = [k for k, (n, _) in enumerate(self.free) if n not in self.others or n in others]
        fewer.others, fewer._brought = [n for n in self.others if n in others], {}
        fewer.effects = [e for e in self.effects if e[0] not in self.others or e[0] in others]
        fewer.free, fewer.taken = [self.free[k] for k in kept], self.taken[np.ix_(kept, kept)]
        fewer.precision = self.precision[kept]
        return fewer

    def _derivatives(self, photograph):
        """Return what a photograph shows of the free parameters (n, k), and what it has for itself (n, q)."""
        return self.look.derivatives(self.effects, self.free, photograph)

    def _information(self, photographs, each):
        """Return the information (k, k) of the free parameters in photographs, of which each counts so many times; what each has
        for itself is eliminated.
        """
        H = 0.0
        for one in photographs:
            J, Jp = self._derivatives(one)
            left = J - Jp @ np.linalg.lstsq(Jp, J, rcond=None)[0]
            H = H + each * left.T @ left / self.variance
        return H

    def _columns(self, name):
        return [k for k, (effect, _) in enumerate(self.free) if effect == name]

    def _of_twin(self):
        return [k for k, (effect, _) in enumerate(self.free) if effect not in self.others]

    def _left(self, mine, beside, more):
        """Return the information (m, m) of some parameters that others, ``beside``, leave; ``more`` is of further photographs."""
        H = np.diag(self.precision) + self.taken + (0.0 if more is None else more)
        own, between = H[np.ix_(mine, mine)], H[np.ix_(mine, beside)]
        return own - between @ np.linalg.pinv(H[np.ix_(beside, beside)], hermitian=True) @ between.T

    def seen(self, name, more=None):
        """Return how clearly an effect that the twin has not would be seen: what is worth naming over its error, squared."""
        mine = self._columns(name)
        worth = np.array([spec(self.free[k]).matters for k in mine])
        return float((np.diag(self._left(mine, self._of_twin(), more)) * worth**2).max(initial=0.0))

    def apart(self, name, other, more=None):
        """Return the loss, to first order, between an effect of the twin and another in its place."""
        mine = self._columns(name)
        away = np.array([get_parameter(self.effects, self.free[k]) - spec(self.free[k]).null for k in mine])
        beside = [k for k in self._of_twin() if k not in mine] + self._columns(other)
        return float(away @ self._left(mine, beside, more) @ away)

    def hidden(self):
        """Return those of the others that would stay unseen at the amount that is worth naming."""
        return [n for n in self.others if self.seen(n) < MIN_INFORMATION]

    def needs(self, hidden):
        """Return what further photographs would show ``hidden`` effects, one by one as ``need``."""
        if hidden:
            list(self.map(lambda instruction: self._brought_by(instruction, 0), self.look.instructions))
        return [self.need(n, "", MIN_INFORMATION, lambda more, n=n: self.seen(n, more)) for n in hidden]

    def need(self, name, from_what, enough, told):
        """Return the first instruction with which ``told`` (information) reaches ``enough`` in every try, None without one."""
        for instruction in self.look.instructions:
            if all(told(self._brought_by(instruction, k)) >= enough for k in range(self.look.tries)):
                return {"effect": name, "text": f"to tell {plain(name)}{from_what}: {instruction.words}"}
        return None

    def _brought_by(self, instruction, k):
        """Return the information (k, k) that the photographs of an Instruction add, in a try of several."""
        if instruction is MORE:
            return self.taken
        if (instruction, k) not in self._brought:
            self._brought[instruction, k] = self._information(*self.look.further(instruction, k))
        return self._brought[instruction, k]
