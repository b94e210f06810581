"""What photographs of a board cannot tell, and which further ones would: from the information that their points hold.

Nothing is fitted: maps of points are exact, so that information is known for photographs that nobody has taken yet. Poses are
free in all of them.
"""

from dataclasses import replace

import numpy as np

from effects import library
from gap.derivatives import POSE_STEP, flat
from gap.parameters import fitted_parameters, get_parameter, priors_of, small_step, spec, with_parameters
from gap.search import MIN_GAIN
from gap.select_effects import is_flexible
from rig.geometry import N_POSE, make_pose, perturb_pose, transform
from rig.words import plain

CLEAR = 9.0  # information times a squared amount from which that amount is seen: three standard errors
FURTHER = 4  # photographs that an instruction stands for
ROLL = make_pose([0.0, 0.0, np.pi / 2], [0.0, 0.0, 0.0])
ASIDE = np.deg2rad(45.0)
FRONTAL = np.diag([1.0, -1.0, -1.0])
CORNER = 0.3  # of the frame's width and height, from its middle


def cannot_tell(search, twin, names):
    """Return (hidden, alike, needs) of a fitted Twin of a board's photographs and the effects that compete.

    hidden  [effect]: of those that the twin has not, what would stay unseen at the amount that is worth naming
    alike   {effect of the twin: [others]} that would do as well in its place: MIN_GAIN of loss does not lie between them
    needs   [{"effect", "text"}]: of hidden ones and of the others of ``alike``, what further photographs would show them
    """
    rigid = [n for n in names if not is_flexible(n)]
    told = Told(search, twin, [n for n in rigid if n not in twin.names])
    hidden = [n for n in told.others if told.seen(n) < CLEAR]
    named = [n for n in twin.names if n in rigid and not search.is_fixed(n)]
    alike = {n: [o for o in told.others if told.apart(n, o) < MIN_GAIN] for n in named}
    alike = {n: others for n, others in alike.items() if others}
    needs = [told.need(n, "", CLEAR, lambda more, n=n: told.seen(n, more)) for n in hidden]
    for n, others in alike.items():
        needs += [
            told.need(o, f" from {plain(n)}", MIN_GAIN, lambda more, n=n, o=o: told.apart(n, o, more)) for o in others
        ]
    return hidden, alike, [need for need in needs if need]


class Told:
    """The information that photographs hold on the effects of a twin and on ``others``, each at its null."""

    def __init__(self, search, twin, others):
        self.problem, self.twin, self.others = search.problem, twin, others
        self.effects = [*twin.effects, *((n, library.nulls_of(n)) for n in others)]
        own = set(search.free(twin.effects))
        self.free = [f for f in fitted_parameters(self.effects) if f in own or f[0] in others]
        self.captures = [
            (capture, twin.poses[i])
            for i, capture in enumerate(self.problem.captures)
            if i in {*search.train, *search.test}
        ]
        self.variance = max(twin.gap, 1.0) ** 2  # of residuals: what is open hides effects as noise does
        self.now = np.diag(priors_of(self.free)[1]) + self._information(self.captures)
        self._with_more = {}

    def _information(self, captures):
        """Return the information (k, k) of the free parameters in captures [(Capture, pose)], their poses eliminated."""
        H = np.zeros((len(self.free), len(self.free)))
        for capture, pose in captures:
            J, Jp = self._derivatives(capture, pose)
            back = np.linalg.lstsq(Jp, J, rcond=None)[0]
            left = (J - Jp @ back) / self.problem.noise_px
            H += left.T @ left / self.variance
        return H

    def _derivatives(self, capture, pose):
        """Return d pixels by the free parameters (n, k) and by the pose (n, 6) of the points that a capture shows."""

        def pixels(effects, delta):
            return flat(self.problem.corners_of(capture, effects, delta))

        def slope(high, low, h):
            return ((high - low) / (2 * h))[seen].ravel()

        here = pixels(self.effects, pose)
        view = capture.view
        seen = (np.isfinite(here) & (here > 0) & (here < [view.width - 1, view.height - 1])).all(1)
        if capture.observation is not None:
            seen &= capture.observation.measured
        J, Jp = [], []
        for f in self.free:
            h, value = small_step(f), get_parameter(self.effects, f)
            J.append(slope(*(pixels(with_parameters(self.effects, [f], [value + s * h]), pose) for s in (1, -1)), h))
        for step in np.diag(POSE_STEP):
            Jp.append(slope(pixels(self.effects, pose + step), pixels(self.effects, pose - step), step.max()))
        return np.stack(J, axis=1), np.stack(Jp, axis=1)

    def _columns(self, name):
        return [k for k, (effect, _) in enumerate(self.free) if effect == name]

    def _of_twin(self):
        return [k for k, (effect, _) in enumerate(self.free) if effect not in self.others]

    def _left(self, mine, beside, more):
        """Return the information (m, m) of some parameters that others, ``beside``, leave; ``more`` is of further photographs."""
        H = self.now if more is None else self.now + more
        own, between = H[np.ix_(mine, mine)], H[np.ix_(mine, beside)]
        return own - between @ np.linalg.pinv(H[np.ix_(beside, beside)], hermitian=True) @ between.T

    def seen(self, name, more=None):
        """Return how clearly an effect that the twin has not would be seen: what is worth naming over its error, squared."""
        mine = [k for k in self._columns(name) if not spec(self.free[k]).auxiliary]
        worth = np.array([spec(self.free[k]).matters for k in mine])
        return float((np.diag(self._left(mine, self._of_twin(), more)) * worth**2).max(initial=0.0))

    def apart(self, name, other, more=None):
        """Return the loss, to first order, between an effect of the twin and another in its place."""
        mine = self._columns(name)
        away = np.array([get_parameter(self.effects, self.free[k]) - spec(self.free[k]).null for k in mine])
        beside = [k for k in self._of_twin() if k not in mine] + self._columns(other)
        return float(away @ self._left(mine, beside, more) @ away)

    def need(self, name, from_what, enough, told):
        """Return the first instruction with whose photographs ``told`` (information) reaches ``enough``; None where none does."""
        for text, poses in INSTRUCTIONS:
            if text not in self._with_more:
                self._with_more[text] = self._information(self._further(poses) if poses else self.captures)
            if told(self._with_more[text]) >= enough:
                return {"effect": name, "text": f"to tell {plain(name)}{from_what}: {text}"}
        return None

    def _further(self, poses):
        """Return captures [(Capture, pose)] that nobody has taken, like some of those that there are but for their poses."""
        chosen = [self.captures[k] for k in np.linspace(0, len(self.captures) - 1, FURTHER).round().astype(int)]
        middle = self.problem.points.mean(axis=0)
        taken = [perturb_pose(c.view.T_cam_world, pose[:N_POSE]) for c, pose in chosen]
        depth_m = float(np.median([transform(T, middle)[2] for T in taken]))
        further = []
        for k, ((capture, pose), T) in enumerate(zip(chosen, taken, strict=True)):
            view = replace(capture.view, T_cam_world=poses(T, k, middle, depth_m, capture.view))
            further.append((replace(capture, view=view, observation=None), np.zeros(len(pose))))
        return further


def _rolled(T, k, middle, depth_m, view):
    return ROLL @ T


def _looking(R, middle, at_cam):
    """Return T_cam_world with a rotation that has the board's middle at a place in the camera's frame."""
    T = np.eye(4)
    T[:3, :3], T[:3, 3] = R, at_cam - R @ middle
    return T


def _aslant(T, k, middle, depth_m, view):
    axis = [[1.0, 0, 0], [0, 1.0, 0], [-1.0, 0, 0], [0, -1.0, 0]][k % 4]
    R = make_pose(ASIDE * np.array(axis), np.zeros(3))[:3, :3] @ FRONTAL
    return _looking(R, middle, np.array([0.0, 0.0, depth_m]))


def _in_a_corner(T, k, middle, depth_m, view):
    to = CORNER * np.array([[-1, -1], [1, -1], [1, 1], [-1, 1]][k % 4]) * [view.width, view.height]
    ray = [
        (view.width / 2 + to[0] - view.K[0, 2]) / view.K[0, 0],
        (view.height / 2 + to[1] - view.K[1, 2]) / view.K[1, 1],
    ]
    return _looking(T[:3, :3], middle, depth_m * np.array([*ray, 1.0]))


def _at(share):
    def moved(T, k, middle, depth_m, view):
        return _looking(T[:3, :3], middle, share * transform(T, middle))

    return moved


INSTRUCTIONS = (  # (words, pose of a further photograph; None: as many more of the same); what is asked for first is easiest
    ("roll the camera by 90 degrees for some photographs", _rolled),
    ("hold the board at 45 degrees to the camera, turned to each side", _aslant),
    ("bring the board into each corner of the image", _in_a_corner),
    ("halve the distance in some photographs", _at(0.5)),
    ("double the distance in some photographs", _at(2.0)),
    ("take twice as many photographs", None),
)
