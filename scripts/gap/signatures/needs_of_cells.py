"""What a board's cells cannot tell of the camera, and which further photographs would: the signatures of twins say (needs.py).

Signs are looked at in the light that each photograph's own white and black show: that is free in all of them.
"""

from dataclasses import replace

import numpy as np

from gap.boards.instructions import EXPOSURES, FURTHER, MORE, PLACES
from gap.boards.needs import MIN_INFORMATION, Told
from gap.bounds import MIN_GAIN
from gap.fit.parameters import get_parameter, image_step, with_parameters
from gap.fit.split import thinned
from gap.select.exchange import as_good_instead
from gap.signatures.signature import MIN_PATCHES
from gap.signatures.signature_case import NumbersOf
from rig.light import LIGHT, exposed
from rig.words import plain

LOOKED_AT = 2  # photographs that stand for all of them, in as few patches as tell something: each costs a second or two
# Times as much as one that there is, that a further photograph tells: what needs more is not tried for
MAX_TIMES_TOLD = 20.0
# What signs follow of a photograph's light: slopes are taken out of them
OF_LIGHT = ("gain", "red", "blue", "stray", "stray_red", "stray_blue")
LIGHT_STEP = 0.02  # for a derivative: levels are whole numbers
SIGMA_LIGHT = 1.0  # of a photograph's own gains (logarithms) and stray light (white is 1), which nobody declares


def cells_cannot_tell(search, twin, steps=()):
    """Return (hidden, alike, needs), as needs.cannot_tell, of a fitted Twin of a signature_case.SignatureCase, what
    competes in its Search, and the outcome.Steps to it.

    First order tells signs of small amounts alone: what a step is ``confused_with`` is fitted in its place.
    """
    told = Told(search, twin, search.candidates, OfCells)
    hidden = told.hidden()
    times = 1 + MAX_TIMES_TOLD * FURTHER / told.look.number
    likely = [n for n in hidden if times * told.seen(n) >= MIN_INFORMATION]
    needs, alike = told.of_fewer(likely).needs(likely), {}
    for step in steps:
        rivals = as_good_instead(search, twin, step.effect, step.rivals)
        alike |= {step.effect: list(rivals)} if rivals else {}
        needs += [Between(search, rival, twin).need_of(n, step.effect) for n, rival in rivals.items()]
    return hidden, alike, [need for need in needs if need]


class Between(Told):
    """The information that photographs hold on the way from a rival Twin, which has another effect in the place of one, to a
    Twin: what the rival's own parameters make up for is out.
    """

    def __init__(self, search, rival, twin):
        self.there = twin.effects
        self.left_out = sum(rival.losses.values()) - sum(twin.losses.values())
        super().__init__(search, rival, [], OfCells)
        self.precision = np.append(self.precision, 0.0)

    def _derivatives(self, photograph):
        J, Jp = super()._derivatives(photograph)
        way = np.nan_to_num(self.look.shown(self.there, photograph) - self.look.shown(self.effects, photograph))
        return np.column_stack([J, np.pad(way, (0, len(J) - len(way)))]), Jp

    def loss(self, more=None):
        """Return the loss between both in left-out photographs, as many times as there is as ``more`` would tell."""
        last, own = [len(self.free)], list(range(len(self.free)))
        then, now = (self._left(last, own, brought).item() for brought in (more, None))
        return self.left_out * then / now if now > 0 else 0.0

    def need_of(self, other, name):
        """Return the ``need`` that tells the rival's effect from that of the Twin."""
        return self.need(other, f" from {plain(name)}", MIN_GAIN, self.loss)


class OfCells:
    """What a board's cells tell in photographs, TwinPhotographs of a search: what a change that ``matters`` does to their signs.

    A further photograph counts as so many, and another must do as well: what only one would tell is its own chance.
    """

    instructions, tries = (*PLACES, *EXPOSURES, MORE), 2  # how a camera is turned blurs and dims nothing

    def __init__(self, search, twin):
        self.problem = search.problem
        self.counted, self.floor = search.problem.floors
        every = [search.problem.twins[i] for i in sorted({*search.train, *search.test})]
        self.photographs = [p.fewer(MIN_PATCHES) for p in thinned(every, LOOKED_AT)]
        self.number, self.each = len(every), len(every) / len(self.photographs)

    def shown(self, effects, photograph):
        """Return the counted signs (n,) that a photograph shows of effects, in floors."""
        return photograph.signature(effects, NumbersOf(photograph.view.capture))[self.counted] / self.floor

    def derivatives(self, effects, free, photograph):
        """Return d signs by the free parameters (n, k) and by the photograph's own light (n, q), in floors; the last q rows are
        the light's prior.
        """

        here = self.shown(effects, photograph)
        J, Jp = np.zeros((len(here), 0)), np.zeros((len(here), 0))
        for f in free:
            value = get_parameter(effects, f)
            h = image_step(f, value)
            J = np.column_stack([J, (self.shown(with_parameters(effects, [f], [value + h]), photograph) - here) / h])
        for k in (LIGHT.index(name) for name in OF_LIGHT if photograph.in_colour or name in ("gain", "stray")):
            lit = replace(photograph, light=photograph.light + LIGHT_STEP * (np.arange(len(LIGHT)) == k))
            Jp = np.column_stack([Jp, (self.shown(effects, lit) - here) / LIGHT_STEP])
        q = Jp.shape[1]
        prior = np.eye(q) / SIGMA_LIGHT
        return np.vstack([np.nan_to_num(J), np.zeros((q, len(free)))]), np.vstack([np.nan_to_num(Jp), prior])

    def further(self, instruction, k):
        """Return ([TwinPhotograph that nobody has taken], how many times it counts), like one of those that there are but for
        what an Instruction says; none that shows too little of the board. Where patches are larger they are fewer.
        """
        views = instruction.views([p.view for p in self.photographs], self.problem.board.corners.mean(axis=(0, 1)))
        like = self.photographs[k]
        taken = self.problem.retaken(like, views[k], exposed(like.light, instruction.exposure))
        if taken is None:
            return [], FURTHER
        larger = np.prod(taken.atlas.shape) / np.prod(like.atlas.shape)
        return [taken.fewer(max(MIN_PATCHES, int(len(taken.plates) / larger)))], FURTHER
