"""Photographs of a board as a problem of signatures (gap.signatures): how do they differ from what an ideal camera would show?

In each photograph's own pose and light the known cells are drawn; effects are laid on that, never on the photograph. The search
(search.py) fits, scores and names as it does by plates: a photograph's signs are its residuals, in units of what photographs
differ by among themselves.
"""

from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, field, replace
from functools import cached_property

import numpy as np

from effects import library, pipeline
from effects.encoding import srgb_decode
from gap.bounds import CLOSED, MIN_SHARE_OF_LIGHT
from gap.changes.power import clear_ones
from gap.fit.parameters import get_parameter, image_step, with_parameters
from gap.fit.score import robust_scatter
from gap.fit.solver import Solver
from gap.observables import CORNERS, MIN_SIGN_FLOOR, SIGNS, SIGNS_OF_GROUP, corners_in
from gap.predict.predictor import Kept
from gap.predict.synthesis import ground_seen_at, shade, window_coverages
from gap.signatures.signature import MIN_PATCHES, Photograph
from gap.signatures.signature_changes import can_be_laid_on
from job import seed_of
from rig.light import LIGHT, lit

KEPT = 4000  # signatures
USUAL_PX = 200_000  # of a photograph's windows
NO_IMAGE = np.zeros((0, 0, 1), np.uint8)
BY_GROUP = np.array([SIGNS.index(name) for names in SIGNS_OF_GROUP.values() for name in names])
# {sign: number of LIGHT that makes up for it}: where nobody declares that number, the sign tells nothing of the camera
TAKEN_BY = {"light": "gain", "black": "stray", "red": "red", "blue": "blue"}
OF_SLOPES = np.array([not name.startswith(("xx", "xy", "yy")) for name in LIGHT])  # a lens's fall-off is no lamp's


@dataclass(frozen=True)
class TwinPhotograph(Photograph):
    """What an ideal camera shows in a photograph's place: ``draw`` returns the windows' radiance (rows, columns, C) by effects
    that are drawn [(name, parameters)], of the print or colours moved apart, in a ``light``, LIGHT (11,); ``own`` effects the
    photograph's file declares.
    """

    reach_px = 8
    draw: object = None
    light: object = None
    in_colour: bool = True
    own: tuple = ()
    drawn: dict = field(default_factory=dict, compare=False, init=False)
    formed: dict = field(default_factory=dict, compare=False, init=False)

    def levels(self, effects=(), rng=None):
        """Return the grey levels (rows, columns, C) of the windows, with effects [(name, parameters)] laid on."""
        # Light spreads when the image is formed
        drawn = [e for e in effects if library.is_drawn(e[0]) and not library.spreads_light(e[0])]
        key = pipeline.key_of(drawn)
        if key not in self.drawn:
            self.drawn.clear()
            self.formed.clear()
            self.drawn[key] = self.draw(self.atlas, drawn, self.light)
        view = replace(self.view, margin=0, windows=self.atlas.windows)
        like, effects = self.formed.get(rng is None), [*effects, *self.own]
        self.formed[rng is None] = formed = pipeline.form(self.drawn[key], view, effects, rng, like)
        return np.clip(np.rint(formed.outcome[0][: self.atlas.shape[0]]), 0, 255)


def twin_photograph(case, view, given, light, plates, features, in_colour, own=()):
    """Return the TwinPhotograph of plates (k,), measured as features (k, 19), of a photograph in its LIGHT (11,).

    view is the photograph's, case the photographs.PhotographsCase of the board; given [(name, parameters)] are effects
    that tell where points land.
    """
    capture = replace(case.captures[0], view=view)
    features = features.copy()
    features[:, CORNERS] = case.corners_of(capture, given, np.zeros(6))[plates].reshape(-1, 8)

    def draw(atlas, drawn, light):
        effects, planes = [*given, *drawn], []
        scene, _ = case.scene_of(effects)
        prints = case.prints_of(scene)
        for channel in (0, 1, 2) if pipeline.is_chromatic(effects) else (1,):
            mapping = pipeline.point_map(view, effects, channel)
            planes.append(shade(scene, view, *window_coverages(prints, view, atlas, mapping), None))
        ground = ground_seen_at(view, None, atlas.windows.x, atlas.windows.y)
        radiance = case.lit(np.stack(planes, axis=-1).astype(np.float32), light, *ground)
        return radiance if in_colour else radiance[..., 1:2]

    return TwinPhotograph(NO_IMAGE, view, case.codes, plates, features, draw, light, in_colour, tuple(own))


@dataclass
class SeenPatches:
    """Which patches a photograph shows: corners (p, 4, 2), measured (p,)."""

    corners: np.ndarray
    measured: np.ndarray


def is_seen_in_cells(name):
    """Return whether a board's cells tell of an effect: on light that reached the camera, or on where their black is printed."""
    return can_be_laid_on(name) or library.changes_ink(name)


def seen_patches(number, plates, features):
    """Return the SeenPatches of so many patches, of which plates (k,) were measured as features (k, 19)."""
    corners, measured = np.zeros((number, 4, 2)), np.zeros(number, bool)
    corners[plates], measured[plates] = corners_in(features), True
    return SeenPatches(corners, measured)


class NumbersOf:
    """Random numbers of each step of image formation by itself, the same whatever other steps there are."""

    def __init__(self, capture):
        self.capture = capture

    def of(self, name):
        """Return the numbers of the step with a name."""
        return np.random.default_rng(seed_of("laid on", self.capture, name))


@dataclass
class SignatureCase:
    """Photographs of a board whose signatures are compared with those of their twins.

    captures [gap.problem.Capture], ``observation`` a SeenPatches; twins [TwinPhotograph]; signs (captures, signs) of the real
    photographs; free (11,) which numbers of their LIGHT nobody declares; board the photographs.PhotographsCase that twins
    are drawn of, given [(name, parameters)] where points land
    """

    campaign: str
    camera: str
    captures: list
    twins: list
    signs: np.ndarray
    free: np.ndarray
    board: object = None
    given: tuple = ()
    own = nuisances = ()
    most_captures, most_held_out = 4, 10
    draws = is_board = is_of_signs = True
    floor_within = 1.0
    sigma_pose = np.zeros(0)

    def shows(self, effect):
        """Return the start of an effect that captures show by themselves: none."""
        return {}

    def starts_of(self, effect):
        """Return the starts [{parameter: value}] of an effect's fit."""
        return library.starts_of(effect)

    def start_poses(self):
        """Return the nuisances (captures, 0): poses and light are known."""
        return np.zeros((len(self.captures), 0))

    def floors_of(self, groups):
        """Return {group: floor}: residuals are in floors."""
        return {}

    def solver(self, noise_of=(), threads=1):
        """Return the Solver of signatures."""
        return SignatureSolver(self, threads)

    def signature(self, i, effects):
        """Return the signs (len(SIGNS),) of capture i's twin with effects [(name, parameters)]."""
        return self.twins[i].signature(effects, NumbersOf(self.captures[i].view.capture))

    def retaken(self, twin, view, light):
        """Return the TwinPhotograph from another View in another LIGHT (11,), None where it shows fewer than MIN_PATCHES.

        As many patches as a twin has, spread over what is in the frame, are looked at from its own features.
        """
        capture = replace(self.board.captures[0], view=view)
        corners = self.board.corners_of(capture, list(self.given), np.zeros(6))
        plates = self.board.patches_in(corners, view.width, view.height, len(twin.plates))
        if len(plates) < MIN_PATCHES:
            return None
        features = np.tile(np.median(twin.features, axis=0), (len(plates), 1))
        return twin_photograph(self.board, view, self.given, light, plates, features, twin.in_colour, twin.own)

    @property
    def effort(self):
        """How many times as many pixels as usual a photograph's windows have, at least 1: so much longer a signature takes."""
        return max(1.0, float(np.median([np.prod(twin.atlas.shape) for twin in self.twins])) / USUAL_PX)

    @cached_property
    def floors(self):
        """Return (which signs count, as their groups are ordered, their floors): photographs' scatter about their ideal twins, in
        which a twin that is right but for it has a gap of 1.
        """
        off = self.signs - np.array([self.signature(i, []) for i in range(len(self.captures))])
        counted = BY_GROUP[np.isfinite(off).mean(0)[BY_GROUP] >= 1 - CLOSED]
        return counted, np.array([robust_scatter(off[:, k], MIN_SIGN_FLOOR[k]) for k in counted])

    @property
    def taken(self):
        """Return the signs (t,) that each photograph's own light, exposure and white balance make up for."""
        return [sign for sign, number in TAKEN_BY.items() if self.free[LIGHT.index(number)]]

    def is_like_light(self, effect):
        """Return whether gains and stray light that nobody declared do all that an effect does where it is clearly seen."""
        return all(
            _share_of_light(self.twins[0], effect, p, self.free) > MIN_SHARE_OF_LIGHT for p in clear_ones(effect)
        )


def _share_of_light(twin, effect, start, free):
    """Return the share (0 to 1) of what an effect does to a twin's linear light that ``free`` LIGHT (11,) makes up for."""
    before, after = (srgb_decode(twin.levels(laid) / 255) for laid in ([], [(effect, start)]))
    nothing = np.zeros(len(LIGHT))
    plain = lit(before, nothing, 0, 0)
    change = (lit(after, nothing, 0, 0) - plain).ravel()
    light = np.reshape([lit(before, one, 0, 0) - plain for one in np.eye(len(LIGHT))[free]], (-1, change.size)).T
    left = change - light @ np.linalg.lstsq(light, change, rcond=None)[0]
    return 1 - (left @ left) / (change @ change) if change.any() else 0.0


class NoPlates:
    """Stands for the whitener of a capture without plates: nothing is shared by them."""

    plates, floor = np.zeros(0, int), np.zeros(1)

    def __init__(self, size):
        self.size = size

    def whitened_features(self, change):
        """Return zeros: no plate's feature changes."""
        return np.zeros((self.size, 1))


class SignatureSolver(Solver):
    """Fits lists of effects to signatures: there is no geometry and no pose to fit, and derivatives are differences."""

    def __init__(self, problem, threads=1):
        self.problem, self.prior = problem, np.zeros(0)
        self.counted, self.floor = problem.floors
        self.told = ~np.isin(np.array(SIGNS)[self.counted], problem.taken)
        self.real = problem.signs[:, self.counted] / self.floor
        names = [SIGNS[k] for k in self.counted]
        self.groups = {group: np.isin(names, members) for group, members in SIGNS_OF_GROUP.items()}
        self.whiteners = [NoPlates(len(self.counted)) for _ in problem.captures]
        self.map = ThreadPoolExecutor(threads).map if threads > 1 else map
        self.cost, self._kept = 0, Kept(KEPT)

    def shown(self, i, effects):
        """Return the counted signs of capture i's twin in floors; the photograph's own light makes some as they are there."""
        key = i, pipeline.key_of(effects)
        signs = self._kept.of(key, lambda: self.problem.signature(i, list(effects)))
        return np.where(self.told, signs[self.counted] / self.floor, self.real[i])

    def residuals(self, i, effects, pose):
        """Return the residual groups of capture i for a list of effects."""
        off = np.nan_to_num(self.real[i] - self.shown(i, effects))
        groups = {group: off[members] for group, members in self.groups.items()}
        return {"corners": np.zeros((0, 2))} | groups | {"pose": np.zeros(0)}

    def residuals_towards(self, i, effects, others, pose):
        """Return the residual groups of capture i where a list of effects becomes others."""
        return self.residuals(i, others, pose)

    def no_offsets(self):
        """Return what geometry needs: nothing."""
        return []

    def offsets_of(self, effects, poses, indices):
        """Return what geometry needs: nothing."""
        return []

    def fit_geometry(self, effects, free, poses, *_, **__):
        """Return (effects, poses) as they are."""
        return effects, poses

    def derivatives(self, effects, free, poses, train, step_of=None):
        """Return {i: (d (twin, in floors) by the free parameters (n, k), nothing (n, 0))}."""
        self.cost += len(train) * (1 + len(free))
        step_of = step_of or image_step

        def of(i):
            here, columns = self.shown(i, effects), []
            for f in free:
                value = get_parameter(effects, f)
                h = step_of(f, value)
                columns.append((self.shown(i, with_parameters(effects, [f], [value + h])) - here) / h)
            J = np.nan_to_num(np.array(columns).reshape(len(free), len(here)).T)
            return J, np.zeros((len(here), 0))

        return self.each(of, train)

    def ways(self, effects, others, poses, indices):
        """Return derivatives by one parameter that goes from a list of effects (0) to others (1)."""
        self.cost += len(indices)

        def way(i):
            here = self.shown(i, effects)
            return np.nan_to_num(self.shown(i, others) - here)[:, None], np.zeros((len(here), 0))

        return self.each(way, indices)

    def score(self, effects, poses, indices):
        """Return (poses, {i: residual groups}) of captures."""
        return poses, self.residuals_of(effects, poses, indices)

    def self_simulation_residuals(self, i, effects, pose):
        """Return the residuals of captures that the twin itself takes: none, as floors hold what they scatter by already."""
        return {}
