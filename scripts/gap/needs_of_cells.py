"""What a board's cells cannot tell of the camera, and which further photographs would: the signatures of twins say (gap.needs).

Signs are looked at in the light that each photograph's own white and black show: that is free in all of them.
"""

from dataclasses import replace

import numpy as np

from gap.instructions import FURTHER, INSTRUCTIONS
from gap.needs import Told
from gap.parameters import get_parameter, image_step, with_parameters
from gap.signature import MIN_PATCHES
from gap.signature_case import NumbersOf
from gap.split import thinned
from rig.light import LIGHT, exposed

LOOKED_AT, NEW = (
    3,
    2,
)  # photographs that stand for all of them, and any of which for FURTHER new ones: each costs a second
OF_LIGHT = (
    "gain",
    "red",
    "blue",
    "stray",
    "stray_red",
    "stray_blue",
)  # what signs follow: slopes are taken out of them
LIGHT_STEP = 0.02  # for a derivative: levels are whole numbers
SIGMA_LIGHT = 1.0  # of a photograph's own gains (logarithms) and stray light (white is 1), which nobody declares


def cells_cannot_tell(search, twin):
    """Return (hidden, alike, needs), as gap.needs.cannot_tell, of a fitted Twin of a gap.signature_case.SignatureCase and what
    competes in its Search; which names are alike the search itself tried (``confused_with``).
    """
    told = Told(search, twin, search.candidates, OfCells)
    hidden = told.hidden()
    needs = told.of_fewer(hidden).needs(hidden)
    return hidden, {}, [need for need in needs if need]


class OfCells:
    """What a board's cells tell in photographs, TwinPhotographs of a search: what a change that ``matters`` does to their signs.

    A further photograph counts as so many, and another must do as well: what only one would tell is its own chance.
    """

    instructions, tries = INSTRUCTIONS, 2

    def __init__(self, search, twin):
        self.problem = search.problem
        self.counted, self.floor = search.problem.floors
        every = [search.problem.twins[i] for i in sorted({*search.train, *search.test})]
        self.photographs = thinned(every, LOOKED_AT)
        self.each = len(every) / len(self.photographs)

    def derivatives(self, effects, free, photograph):
        """Return d signs by the free parameters (n, k) and by the photograph's own light (n, q), in floors; the last q rows are
        the light's prior.
        """

        def shown(effects, photograph=photograph):
            signs = photograph.signature(effects, NumbersOf(photograph.view.capture))
            return signs[self.counted] / self.floor

        here = shown(effects)
        J, Jp = np.zeros((len(here), 0)), np.zeros((len(here), 0))
        for f in free:
            value = get_parameter(effects, f)
            h = image_step(f, value)
            J = np.column_stack([J, (shown(with_parameters(effects, [f], [value + h])) - here) / h])
        for k in (LIGHT.index(name) for name in OF_LIGHT if photograph.in_colour or name in ("gain", "stray")):
            lit = replace(photograph, light=photograph.light + LIGHT_STEP * (np.arange(len(LIGHT)) == k))
            Jp = np.column_stack([Jp, (shown(effects, lit) - here) / LIGHT_STEP])
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
