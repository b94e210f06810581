"""One camera of a campaign as the fit sees it: nominal scene, observed captures, predictions of the twin."""

from collections import Counter
from dataclasses import dataclass, field, replace

import numpy as np

from effects import library, pipeline
from effects.encoding import srgb_encode
from gap.fit.parameters import spec
from gap.fit.score import floors_of
from gap.fit.solver import Solver
from gap.fit.split import MAX_CAPTURES
from gap.measure.capture import COARSE_TO_FINE, Codes, classify_flats, grey_of, measure_plates, observe, states_at
from gap.measure.finder import Finder
from gap.measure.places import MAX_FOLLOWED_PX, agreeing, follow_neighbours, large_enough
from gap.measure.regions import choose_regions
from gap.observables import STATE_FEATURES, corners_in
from gap.predict.predictor import Kept, Predictor
from gap.predict.synthesis import Prints, coverages, ground_points, is_lit, shade
from rig.geometry import N_POSE, perturb_pose, pixels_by_pose, project
from rig.plates import printed_plates

SCENES_KEPT = 64
GEOMETRY_KEPT_PX = 20_000_000  # 400 MB
NUMBERS_KEPT_BYTES = 400e6  # random numbers of frames, drawn once for each capture and step of image formation
MARGIN_PX = 24  # what blurs and filters see beyond the frame


def encoding_table(encoding, exposure):
    """Return the grey level (0..255) of 4097 radiances from 0 to 1."""
    radiance = np.clip(np.linspace(0, 1, 4097) * exposure, 0, 1)
    return 255 * (srgb_encode(radiance) if encoding == "srgb" else radiance)


def code_corners_world(plate):
    """Return the code's four outer corners (4, 3) in the world: the grid without its outermost ring."""
    (left, right), (low, high) = plate.x_m[[1, -2]], plate.y_m[[1, -2]]
    return plate.to_world(np.array([[left, high], [right, high], [right, low], [left, low]]))


@dataclass
class Capture:
    """One capture: its nominal view, what was measured in the real image, its noise variance (squared levels), and the
    {effect: start} that it shows by itself.
    """

    view: object
    trial: int
    observation: object = None
    noise_variance: float = 1.0
    starts: dict = field(default_factory=dict)


@dataclass
class Case:
    """All captures of one camera, with the nominal scene.

    sigma_pose (6 + k,): prior standard deviations of a capture's pose about its nominal one (rad, rad, rad, m, m, m),
    infinite where nothing is known, and of its k ``own`` numbers [(effect, parameter)] about their null: what the campaign
    leaves open. ``nuisances`` are effects [(name, parameters)] that every twin has: fitted, never named nor taken out.
    """

    campaign: str
    camera: str
    scene: object
    codes: Codes
    captures: list
    sigma_pose: np.ndarray
    own: tuple = ()
    nuisances: tuple = ()
    moving_numbers = N_POSE  # of a capture's pose and own numbers: the first, which move its corners
    corner_numbers = 8  # of a plate: x and y of its code's corners, the first of its states and features
    state_features = STATE_FEATURES
    most_captures = most_held_out = MAX_CAPTURES  # that are fitted, that are held out
    draws = True  # images of its captures, which is what takes time
    is_of_signs = False  # few a capture: first order predicts little gain of effects, floors are seldom reached
    is_board = False  # photographs of a calibration board, not of a rig
    floor_within = 1.0  # factor to which the floor is known
    _scenes: dict = field(default_factory=dict)
    _prints: list = field(default_factory=list)
    _geometry: dict = field(default_factory=dict)
    normal_numbers: Kept = field(default_factory=lambda: Kept(NUMBERS_KEPT_BYTES, lambda of_frame: of_frame.nbytes))

    def solver(self, noise_of=(), threads=1):
        """Return what fits twins to the captures; noise is compared in the captures ``noise_of`` alone."""
        return Solver(self, noise_of, threads)

    def shows(self, effect):
        """Return the start {parameter: value} of an effect that most captures show alike, empty where they show none."""
        seen = Counter(tuple(sorted(c.starts[effect].items())) for c in self.captures if effect in c.starts)
        start, number = max(seen.items(), key=lambda s: (s[1], s[0]), default=((), 0))
        return dict(start) if 2 * number > len(self.captures) else {}

    def starts_of(self, effect):
        """Return the starts [{parameter: value}] of an effect's fit: what most captures show alike, or else the effect's own."""
        shown = self.shows(effect)
        return [library.nulls_of(effect) | shown] if shown else library.starts_of(effect)

    def start_poses(self):
        """Return the poses (captures, 6 + k) from which a fit starts: the nominal ones, own numbers at their null."""
        return np.zeros((len(self.captures), len(self.sigma_pose)))

    def floors_of(self, groups):
        """Return {group: floor} of captures' residual groups: how far repeats lie apart."""
        return floors_of(self, groups)

    # -- geometry ---------------------------------------------------------------------------------------------

    def scene_of(self, effects):
        """Return (scene, world corners of the codes (p, 4, 3)) of the twin with these effects."""
        key = pipeline.key_of([(n, p) for n, p in effects if library.effect_named(n).STAGE == "scene"])
        found = self._scenes.get(key)
        if found is None:
            if len(self._scenes) > SCENES_KEPT:
                self._scenes.clear()
            scene = pipeline.scene_with_effects(self.scene, effects)
            corners = np.array([code_corners_world(p) for p in scene.plates])
            found = self._scenes[key] = scene, corners
        return found

    def prints_of(self, scene):
        """Return the Prints of a scene, the same ones while only its light changes."""
        for plates, ink_spread_m, prints in self._prints:
            if plates is scene.plates and ink_spread_m == scene.ink_spread_m:
                return prints
        made = Prints(printed_plates(scene))
        self._prints = self._prints[-SCENES_KEPT:] + [(scene.plates, scene.ink_spread_m, made)]
        return made

    def rims_of(self, effects):
        """Return how far the twin's plates reach beyond the nominal ones (p,), metres, codes brought to one size."""
        plates = self.scene_of(effects)[0].plates
        code, plate = np.array([(p.x_m[-2], p.x_m[-1]) for p in plates]).T
        return plate / code * self.codes.half_code - self.codes.half_plate

    def predictor(self, noise_of=()):
        """Return what predicts the captures; noise is compared in the captures ``noise_of`` alone."""
        return Predictor(self, noise_of)

    def states(self, corners, effects):
        """Return the states (p, 14) from which plates with corners (p, 4, 2) are measured; features 0 to 7 come first."""
        return states_at(corners, self.codes, self.rims_of(effects))

    def view_of(self, capture, effects, delta):
        """Return the capture's view at its nominal pose moved by delta (6,), the twin's mount included."""
        return _moved(self.scene_of(effects)[0], capture.view, delta)

    def corners_of(self, capture, effects, delta, points=None):
        """Return the exact pixels (p, 4, 2) where the twin has the codes' corners (or other points (p, k, 3))."""
        return self.corners_at(capture, effects, [delta], points)[0]

    def corners_at(self, capture, effects, deltas, points=None):
        """Return the pixels [(p, 4, 2)] of ``corners_of`` at several poses [(6,)]."""
        scene, corners = self.scene_of(effects)
        world, is_mapped = corners if points is None else points, pipeline.has_geometry(effects)
        return [_seen_in(_moved(scene, capture.view, delta), world, effects if is_mapped else ()) for delta in deltas]

    def corners_by_pose(self, capture, effects, delta):
        """Return d ``corners_of`` (p, 4, 2, 6) / d pose.

        What moves points turns and stretches the pinhole's moves; that a shutter's slide is larger near by is left out.
        """
        scene, corners = self.scene_of(effects)
        moves = pixels_by_pose(capture.view.K, scene.T_cam_mount, delta[:N_POSE], capture.view.T_cam_world, corners)
        if not pipeline.has_geometry(effects):
            return moves
        view = _moved(scene, capture.view, delta)
        pixels = project(view.K, view.T_cam_world, corners)
        return _of_seen(pixels, lambda xy: pipeline.points_by_points(xy, view, effects), (2, 2)) @ moves

    def corners_by_parameters(self, capture, effects, delta, free, steps):
        """Return the derivatives (p, 4, 2, k) of ``corners_of`` by parameters ``free`` of effects that move points."""
        scene, corners = self.scene_of(effects)
        view = _moved(scene, capture.view, delta)
        pixels = project(view.K, view.T_cam_world, corners)
        return _of_seen(
            pixels, lambda xy: pipeline.points_by_parameters(xy, view, effects, free, steps), (2, len(free))
        )

    # -- images -----------------------------------------------------------------------------------------------

    def seen_with(self, effects, delta):
        """Return the effects with which a capture is seen whose pose and own numbers are delta (6 + k,)."""
        own = {}
        for (name, key), move in zip(self.own, delta[N_POSE:], strict=False):
            p = spec((name, key))
            values = own.setdefault(name, library.nulls_of(name) | dict(dict(effects).get(name, {})))
            values[key] = float(np.clip(p.null + move, p.lower, p.upper))
        return [*(e for e in effects if e[0] not in own), *own.items()] if own else effects

    def radiance_of(self, capture, effects, delta):
        """Return the linear radiance (H + 2m, W + 2m, C) of the twin, exact coverage: points where they land, light spread."""
        effects = self.seen_with(effects, delta)
        view = self.view_of(capture, effects, delta)
        scene, _ = self.scene_of(effects)
        prints = self.prints_of(scene)
        channels = (0, 1, 2) if pipeline.is_chromatic(effects) else (1,)
        spread = pipeline.light_spread(view, effects)
        planes = []
        for channel in channels:
            mapping = pipeline.point_map(view, effects, channel)
            if is_lit(scene):
                maps = pipeline.key_of([(n, p) for n, p in effects if library.places_light(n)])
                key = view.T_cam_world.tobytes(), prints, maps
                geometry = self._geometry_of(key, view, mapping, channel, spread)
            else:
                geometry = coverages(prints, view, mapping, spread)
            planes.append(shade(scene, view, *geometry))
        return np.stack(planes, axis=-1).astype(np.float32)

    def _geometry_of(self, key, view, mapping, channel, spread):
        """Return (plates, black, sky, ground) of a capture's channel, kept while only the light changes."""
        place = view.capture, channel
        if place not in self._geometry and len(self._geometry) >= GEOMETRY_KEPT_PX // (view.width * view.height):
            self._geometry.clear()
        if self._geometry.get(place, (None,))[0] != key:
            covers = [c.astype(np.float32) for c in coverages(key[1], view, mapping, spread)]
            self._geometry[place] = key, (*covers, ground_points(view, mapping))
        return self._geometry[place][1]

    def image_of(self, radiance, capture, effects, delta, rng=None):
        """Return the twin's grey levels (H, W, C): expected where ``rng`` is None, else as a camera gives them."""
        effects = self.seen_with(effects, delta)
        view = self.view_of(capture, effects, delta)
        left = pipeline.left_to_apply(effects)
        if rng is None:
            image = pipeline.expected_levels(radiance, view, left)
        else:
            image = np.clip(np.rint(pipeline.photometric(radiance, view, left, rng)), 0, 255)
        m = view.margin
        return image[m : m + view.height, m : m + view.width]

    def places(self):
        """Return (names, centres (p, 3), normals (p, 3)) of the nominal plates, metres."""
        T = np.array([plate.T_world_plate for plate in self.scene.plates])
        return [plate.name for plate in self.scene.plates], T[:, :3, 3], T[:, :3, 2]

    def finder(self):
        """Return the Finder of the rig's codes."""
        return Finder(self.scene, self.codes, self.captures[0].view.K)

    # -- real images ------------------------------------------------------------------------------------------

    def observe_real(self, capture, image):
        """Measure a real image (H, W, 3) and keep what the fit needs of it.

        Plates are looked for where the nominal pose has them, or, where ArUco finds some, as far off as these are.
        """
        zero = np.zeros(6)
        starts = self.corners_of(capture, [], zero)
        outlines = self.corners_of(capture, [], zero, np.array([p.outline_world() for p in self.scene.plates]))
        found, seen = self.found_corners(image, starts)
        starts, outlines = (
            follow_neighbours(starts, starts, found, seen),
            follow_neighbours(outlines, starts, found, seen),
        )
        starts[seen] = found[seen]
        wanted = large_enough(starts, capture.view.width, capture.view.height)
        grey = grey_of(image)
        first, _, ok = measure_plates(grey, states_at(starts, self.codes), wanted, self.codes, COARSE_TO_FINE)
        measured = corners_in(first), ok
        starts, outlines = (
            follow_neighbours(starts, starts, *measured),
            follow_neighbours(outlines, starts, *measured),
        )
        wanted = large_enough(starts, capture.view.width, capture.view.height)

        def regions_of(corners, measured):
            return choose_regions(classify_flats(grey.shape, corners, measured, outlines, capture.view, self.codes))

        capture.observation, capture.noise_variance = observe(
            image, starts, wanted, self.codes, COARSE_TO_FINE, regions_of
        )
        capture.starts = library.starts_seen(image)

    def found_corners(self, image, starts):
        """Return (corners (p, 4, 2), found (p,)): what ArUco detects of the rig; outliers are left out."""
        corners, found = np.full(starts.shape, np.nan), np.zeros(len(starts), bool)
        for k, quad in self.finder().corners(image).items():
            corners[k] = quad
            found[k] = np.abs(quad - starts[k]).max() < MAX_FOLLOWED_PX
        return corners, agreeing(starts, corners, found)


def without_own(problem, names):
    """Return a Case whose captures have no own numbers of some effects: the twin as configured gives them to all."""
    left = [k for k, (name, _) in enumerate(problem.own) if name not in names]
    sigma_pose = problem.sigma_pose[[*range(N_POSE), *(N_POSE + k for k in left)]]
    return replace(problem, own=tuple(problem.own[k] for k in left), sigma_pose=sigma_pose)


def may_have(problem, name):
    """Return whether an effect can compete: none does that each capture has for itself, nor a board's in a rig's."""
    return name not in dict(problem.own) and (problem.is_board or not library.is_of_boards(name))


def _moved(scene, view, delta):
    return replace(view, T_cam_world=scene.T_cam_mount @ perturb_pose(view.T_cam_world, delta[:N_POSE]))


def _seen_in(view, world, effects):
    """Return the pixels (p, k, 2) of world points (p, k, 3) in a view, where effects that move points have them."""
    pixels = project(view.K, view.T_cam_world, world)
    if not effects:
        return pixels
    return _of_seen(pixels, lambda xy: pipeline.map_points(xy, view, effects), (2,))


def _of_seen(pixels, function, shape):
    """Return what a function of pixels (n, 2) gives for some (p, k, 2), (p, k, *shape): NaN where one is NaN."""
    flat = pixels.reshape(-1, 2)
    ok = np.isfinite(flat).all(1)
    out = np.full((len(flat), *shape), np.nan)
    out[ok] = function(flat[ok])
    return out.reshape(*pixels.shape[:-1], *shape)
