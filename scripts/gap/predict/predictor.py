"""What a twin shows in a capture, measured as the real image was, and how that changes with each parameter.

A prediction depends on its arguments alone; what is kept of earlier ones only saves time.
"""

import threading
from collections import OrderedDict
from dataclasses import dataclass, replace
from functools import cached_property, partial

import numpy as np

from effects import library, pipeline
from effects.encoding import mean_of_clipped
from gap.measure.capture import (
    colour_in,
    colour_of,
    colour_responses_of,
    grey_of,
    measure_noise,
    measure_one,
    measure_regions,
    plate_cores,
    responses_of,
    states_at,
    window_classes,
)
from gap.measure.response import respond
from gap.observables import N_COLOUR, N_FEATURES, corners_in, shifted, states_of
from gap.pixels.windows import make_atlas
from gap.predict.synthesis import ground_seen_at, shade, window_coverages
from job import seed_of

KEPT = 4000  # predictions, some 20 kB each
SCENES_KEPT = 7  # windows with all steps of their image formation: those of a fit and one more
SCENE_BYTES = 64e6  # of one: a larger one, of more effects or of plates that fill a large frame, counts as several
DRAWN_KEPT = 24  # channels of windows, some 5 MB each: those of the captures of a fit at one pose and one more
MAX_OFF_PX = 400.0  # beyond the frame: what lies farther off is not looked at
CLEAR_PX = 14  # of ground that is taken for ground, about a plate


@dataclass(frozen=True)
class Prediction:
    """What the twin shows in one capture; arrays as in gap.measure.capture.Observation."""

    features: np.ndarray
    measured: np.ndarray
    colour: np.ndarray
    field: np.ndarray
    noise: np.ndarray | None


class NormalNumbers:
    """Standard normal numbers that belong to a frame's pixels and to a step of its image formation, wherever windows lie.

    ``drawn`` (a Kept) keeps those of whole frames, ``here`` those of the windows.
    """

    def __init__(self, seed, frame, windows, drawn, here, name=""):
        self.seed, self.frame, self.windows, self.drawn, self.here, self.name = seed, frame, windows, drawn, here, name

    def of(self, name):
        """Return the source of one step."""
        return NormalNumbers(self.seed, self.frame, self.windows, self.drawn, self.here, name)

    def standard_normal(self, shape, dtype=np.float32):
        """Return the numbers (rows, columns, C) of the windows' pixels; they are not to be written to."""
        key = self.seed, self.name
        if key not in self.here:
            width, height = self.frame
            drawn = self.drawn.of(key, self._of_frame)
            x, y = (np.rint(at).astype(np.int32) for at in (self.windows.x, self.windows.y))
            self.here[key] = drawn[np.clip(y, 0, height - 1), np.clip(x, 0, width - 1)]
        return self.here[key][..., : shape[2]]

    def _of_frame(self):
        """Return the numbers (H, W, 3) of a whole frame."""
        width, height = self.frame
        rng = np.random.default_rng([self.seed, seed_of(self.name)])
        return rng.standard_normal((height, width, 3), dtype=np.float32)


class Kept(OrderedDict):
    """The last results of a function of a key, that weigh at most ``most`` together, each 1 if ``weight_of`` says nothing else.

    The very last one is kept whatever it weighs.
    """

    def __init__(self, most, weight_of=lambda _: 1.0):
        super().__init__()
        self.most, self.weight_of, self.weights, self.lock = most, weight_of, {}, threading.Lock()

    def of(self, key, make):
        """Return what is kept under a key, made where it is not."""
        with self.lock:
            if key in self:
                self.move_to_end(key)
                return self[key]
        made = make()
        with self.lock:
            self[key], self.weights[key] = made, self.weight_of(made)
            while len(self) > 1 and sum(self.weights.values()) > self.most:
                oldest, _ = self.popitem(last=False)
                del self.weights[oldest]
        return made


class Predictor:
    """Predicts all captures of a problem; noise is compared in the captures ``noise_of`` alone."""

    def __init__(self, problem, noise_of=()):
        self.problem = problem
        self.noise_of = frozenset(noise_of)
        self._predictions, self._drawn = Kept(KEPT), Kept(DRAWN_KEPT)
        self._shown = Kept(SCENES_KEPT, lambda shown: max(1.0, shown.size_bytes / SCENE_BYTES))

    def predict(self, i, effects, pose):
        """Return the Prediction of capture i, pose and own numbers (6 + k,), by a twin of effects [(name, parameters)]."""
        key = i, pipeline.key_of(effects), pose.tobytes()
        return self._predictions.of(key, lambda: self.shown(i, effects, pose).prediction)

    def shown(self, i, effects, pose):
        """Return the Shown of capture i."""
        key = i, pipeline.key_of(effects), pose.tobytes()
        capture, with_noise = self.problem.captures[i], i in self.noise_of
        return self._shown.of(key, lambda: Shown(self.problem, capture, effects, pose, with_noise, self._drawn))


class Shown:
    """The windows of one capture as a twin shows them, with all that a derivative needs.

    ``drawn`` keeps coverages for twins that draw alike in the same windows.
    """

    def __init__(self, problem, capture, effects, pose, with_noise, drawn):
        effects = problem.seen_with(effects, pose)
        self.problem, self.capture, self.effects, self.pose = problem, capture, effects, pose
        self.with_noise, self._classes, self._numbers_here, self._drawn = with_noise, None, {}, drawn
        self.codes, self.observation = problem.codes, capture.observation
        self.exact = problem.corners_of(capture, effects, pose)
        self.rims = problem.rims_of(effects)
        self.plates = self._plates()
        self.regions = self._regions()
        cores = plate_cores(self.exact, self.codes, self.plates, self.rims)
        cores = np.concatenate([cores, self.observation.regions[self.regions]])
        reach = pipeline.reach_px(pipeline.left_to_apply(effects))
        self.atlas = make_atlas(cores, reach, (capture.view.width, capture.view.height))
        self.radiance = self._radiance(effects)
        self.expected = self._form(self.radiance, effects, None)
        self.noisy = self._form(self.radiance, effects, self._numbers()) if with_noise else None

    @property
    def size_bytes(self):
        """Bytes of all steps of its image formation."""
        formed = [f for f in (self.expected, self.noisy) if f is not None]
        steps = {id(a): a.nbytes for f in formed for state in f.states for a in state if isinstance(a, np.ndarray)}
        return sum(steps.values())

    # -- image formation ----------------------------------------------------------------------------------------------

    def _plates(self):
        """Return the indices of the plates that are looked at: measured in the real image and near the frame here."""
        view = self.capture.view
        size = np.array([view.width, view.height])
        with np.errstate(invalid="ignore"):
            near = ((self.exact > -MAX_OFF_PX) & (self.exact < size + MAX_OFF_PX)).all((1, 2))
            sides = np.linalg.norm(self.exact - np.roll(self.exact, -1, axis=1), axis=-1)
        measured = self.observation.measured
        return np.flatnonzero(measured & near & (sides.min(1) > 1.0) & (sides.max(1) < MAX_OFF_PX))

    def _regions(self):
        """Return the cells whose regions are looked at."""
        return np.flatnonzero(self.observation.regions[:, 2])

    def _view(self, effects):
        return replace(self.problem.view_of(self.capture, effects, self.pose), margin=0, windows=self.atlas.windows)

    def _radiance(self, effects):
        """Return the linear radiance (rows, columns, C) of the windows."""
        problem = self.problem
        view = self.problem.view_of(self.capture, effects, self.pose)
        scene, _ = problem.scene_of(effects)
        prints = problem.prints_of(scene)
        spread = pipeline.light_spread(view, effects)
        where = view.capture, view.T_cam_world.tobytes(), self.atlas.boxes.tobytes()
        placed = pipeline.key_of([(n, p) for n, p in effects if library.places_light(n)])
        planes = []
        for channel in (0, 1, 2) if pipeline.is_chromatic(effects) else (1,):
            mapping = pipeline.point_map(view, effects, channel)
            draw = partial(self._covers, prints, view, mapping, spread)
            key = *where, channel, prints, placed
            is_kept = effects is self.effects or key in self._drawn  # what a change draws is seen once
            covers, ground = self._drawn.of(key, draw) if is_kept else draw()
            if not ground and (scene.light or scene.highlight):
                ground.append(ground_seen_at(view, mapping, self.atlas.windows.x, self.atlas.windows.y))
            planes.append(shade(scene, view, *covers, ground[0] if ground else None))
        return np.stack(planes, axis=-1).astype(np.float32)

    def _covers(self, prints, view, mapping, spread):
        """Return (coverages of the windows by plates, black and sky, the ground that is seen there: none yet)."""
        covers = window_coverages(prints, view, self.atlas, mapping, spread)
        return [c.astype(np.float32) for c in covers], []

    def _numbers(self, name="fit noise"):
        seed = seed_of(self.problem.campaign, self.problem.camera, self.capture.view.capture, name)
        frame = self.capture.view.width, self.capture.view.height
        return NormalNumbers(seed, frame, self.atlas.windows, self.problem.normal_numbers, self._numbers_here)

    def _form(self, radiance, effects, rng, like=None):
        if rng is not None and self.observation.has_noise_by_channel and radiance.shape[2] == 1:
            radiance = np.repeat(radiance, 3, axis=2)
        return pipeline.form(radiance, self._view(effects), pipeline.left_to_apply(effects), rng, like)

    def _levels(self, formed):
        """Return the expected grey levels (rows, columns, C) of the windows."""
        return mean_of_clipped(*formed.outcome)[: self.atlas.shape[0]]

    # -- what is measured ---------------------------------------------------------------------------------------------

    @cached_property
    def levels(self):
        """The expected grey levels of the windows (rows, columns, C)."""
        return self._levels(self.expected)

    @cached_property
    def prediction(self):
        """The Prediction: of the expected image, its noise of one that was taken."""
        expected = self._measured_in(self.levels)
        if not self.with_noise:
            return expected
        return replace(expected, noise=self._noise(self.noisy, expected.features, expected.measured))

    def taken(self, name):
        """Return the Prediction of an image that the twin takes with random numbers of a name."""
        formed = self._form(self.radiance, self.effects, self._numbers(name))
        image, _ = formed.outcome
        taken = self._measured_in(np.clip(np.rint(image[: self.atlas.shape[0]]), 0, 255))
        expected = self.prediction
        noise = self._noise(formed, expected.features, expected.measured) if self.with_noise else None
        return replace(taken, noise=noise)

    def _measured_in(self, levels):
        """Return the Prediction, without noise, of grey levels (rows, columns, C) of the windows."""
        grey = grey_of(levels)
        features, measured = self._features(grey)
        colour = np.zeros((len(features), N_COLOUR))
        for k, i in self._seen(measured):
            corners = corners_in(features[i]) - self.atlas.offset(k)
            colour[i] = colour_in(levels[self.atlas.window(k)], corners, self.codes, i)
        field, _ = measure_regions(grey, self.atlas, self.plates, self.regions)
        return Prediction(features, measured, colour, field, None)

    def _seen(self, measured):
        """Return [(window, plate)] of the plates that were measured (p,)."""
        return [(k, i) for k, i in enumerate(self.plates) if measured[i]]

    def _features(self, grey):
        """Return (features (p, 19), measured (p,)) of grey levels (rows, columns)."""
        states = states_at(self.exact, self.codes, self.rims)
        features, measured = np.full((len(states), N_FEATURES), np.nan), np.zeros(len(states), bool)
        for k, i in enumerate(self.plates):
            offset, window = self.atlas.offset(k), np.ascontiguousarray(grey[self.atlas.window(k)])
            found, _, measured[i] = measure_one(window, shifted(states[i], -offset), self.codes, i)
            features[i] = shifted(found, offset)
        return features, measured

    @cached_property
    def _noise_regions(self):
        """The cells whose regions are ground or sky here as well: -1 where a plate of the twin's is near."""
        outlines = self.problem.prints_of(self.problem.scene_of(self.effects)[0]).outlines
        outlines = self.problem.corners_of(self.capture, self.effects, self.pose, outlines)
        outlines = outlines[np.isfinite(outlines).all((1, 2))]
        low, high = outlines.min(1) - CLEAR_PX, outlines.max(1) + CLEAR_PX
        squares = self.observation.regions[self.regions]
        meets = (squares[:, None, :2] < high).all(2) & (squares[:, None, 2:] > low).all(2)
        return np.where(meets.any(1), -1, self.regions)

    def _noise(self, formed, features, measured):
        """Return the noise features of an image formed with noise, plates as they were measured."""
        if self._classes is None:
            corners = np.where(measured[:, None, None], corners_in(features), self.exact)
            self._classes = window_classes(self.atlas, self.plates, corners, self.codes, self._noise_regions)
        image = np.clip(np.rint(formed.outcome[0][: self.atlas.shape[0]]), 0, 255)
        return measure_noise(image, self.atlas, self.plates, self._noise_regions, self._classes)[0]

    # -- what changes -------------------------------------------------------------------------------------------------

    def change(self, effects, by_response=True, own=None):
        """Return the Prediction's change (features, colour, field, noise) where the effects become others that differ in what
        an image shows (poses and points stay in the same windows); the capture's own numbers as in ``own`` (6 + k,), or as here.

        Features change to first order in the image (``by_response``: what that takes serves many changes), and noise stays where
        nothing but the light before the sensor changes; or all is measured again, features from where they were.
        """
        effects = self.problem.seen_with(effects, self.pose if own is None else own)
        same = drawn_key(effects) == drawn_key(self.effects)
        return self._changed(self.radiance if same else self._radiance(effects), effects, by_response)

    def _changed(self, radiance, effects, by_response):
        """Return the Prediction's change where the windows' radiance and the effects become others."""
        like = self.expected if radiance is self.radiance else None
        levels = self._levels(self._form(radiance, effects, None, like))
        change = levels - self.levels
        grey, grey_before = grey_of(change), grey_of(self.levels)
        features, colour = np.zeros((len(self.exact), N_FEATURES)), np.zeros((len(self.exact), N_COLOUR))
        for k, i in self._seen(self.prediction.measured):
            window = self.atlas.window(k)
            if by_response:
                features[i] = respond(self._responses[i][0], grey[window], *self._responses[i][1:])
            else:
                features[i] = self._measured_again(k, i, np.ascontiguousarray((grey_before + grey)[window]))
            if change.shape[2] > 1:
                colour[i] = colour_of(change[window], self._colour_responses[i])
        field, _ = measure_regions(grey, self.atlas, self.plates, self.regions)
        noise = None
        if self.with_noise and by_response and noise_key(effects) == noise_key(self.effects):
            noise = np.zeros_like(self.prediction.noise)
        elif self.with_noise:
            like = self.noisy if radiance is self.radiance else None
            formed = self._form(radiance, effects, self._numbers(), like)
            noise = self._noise(formed, self.prediction.features, self.prediction.measured) - self.prediction.noise
        return Prediction(features, self.prediction.measured, colour, field, noise)

    def _measured_again(self, k, i, window):
        """Return by what the features (19,) of plate i differ in another image of its window; zeros where it is lost."""
        before = shifted(self.prediction.features[i], -self.atlas.offset(k))
        features, _, found = measure_one(window, states_of(before), self.codes, i)
        return features - before if found else np.zeros(N_FEATURES)

    @cached_property
    def _responses(self):
        """{plate: gap.measure.plate.plate_response} of the plates that were measured."""
        grey, out = grey_of(self.levels), {}
        for k, i in self._seen(self.prediction.measured):
            features = shifted(self.prediction.features[i], -self.atlas.offset(k))
            out[i] = responses_of(np.ascontiguousarray(grey[self.atlas.window(k)]), features, self.codes, i)
        return out

    @cached_property
    def _colour_responses(self):
        """{plate: gap.measure.capture.colour_response} of the plates that were measured."""
        out = {}
        for k, i in self._seen(self.prediction.measured):
            corners = corners_in(self.prediction.features[i]) - self.atlas.offset(k)
            shape = self.levels[self.atlas.window(k)].shape[:2]
            out[i] = colour_responses_of(shape, corners, self.codes, i)
        return out


def noise_key(effects):
    """Return a key of what makes noise and of what alters it."""
    return pipeline.key_of([(n, p) for n, p in effects if not library.is_before_sensor(n)])


def drawn_key(effects):
    """Return a key of everything that decides the radiance before photometry."""
    return pipeline.key_of([(n, p) for n, p in effects if library.is_drawn(n)])
