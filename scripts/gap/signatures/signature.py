"""Signature of a photograph: what it shows of its camera besides where points lie.

Sharpness, noise, colours, light and traces of a codec, one vector a photograph, measured in windows about the board's patches.
Effects can be laid on it: the photograph then stands for the light that reaches a camera which has them.
"""

from dataclasses import dataclass, replace
from functools import cached_property

import cv2
import numpy as np
from scipy.fft import dctn

from effects import pipeline
from effects.encoding import encode, srgb_decode
from gap.measure.capture import FINE, colour_in, grey_of, measure_one, measure_plates, plate_cores, window_classes
from gap.measure.plate import N_STATE
from gap.measure.regions import BLACK as BLACK_PIXELS
from gap.measure.regions import WHITE as WHITE_PIXELS
from gap.measure.regions import structure
from gap.observables import COLUMN, CORNERS, SIGNS, SIGNS_OF_GROUP, SURFACES, columns, corners_in, shifted, states_of
from gap.pixels.windows import FRAME_COLUMNS, FRAME_ROWS, make_atlas

EDGES = [name for name in SIGNS_OF_GROUP["edges"] if name in COLUMN]
OF_LIGHT = ("light", "black", "light_outwards", "red", "blue")  # what another lamp would change as well
OF_CODEC = ("blocks", "flat_blocks")  # which lie on a grid of pixels, wherever the picture does
BLOCK = 8  # pixels, of the codec of most cameras (ITU-T T.81)
LINEAR = srgb_decode(np.arange(256) / 255).astype(np.float32)  # light of grey levels
SPARE = 0.02  # of squared places, in units of the half diagonal: what a slope needs to be told
SPARE_CURVED = 0.005  # the same of what a plane leaves of them
FINE_COEFFICIENT = 4  # sum of the orders from which a block's coefficients are of fine detail
NEARLY_0_DN = 1.0
MIN_LIGHT = 1e-4  # of linear light
MIN_PIXELS = 100  # of white or black, that tell their noise
NEAR, FAR = 1, 4  # pixels, whose differences are compared to tell how sharp edges are, whatever their profile
MIN_EDGES = 0.1  # of what levels differ by, that is not noise
MIN_PATCHES = 4  # of a photograph, that say something of it
TURNS = ((1, 1), (-1, 1))  # steps (x, y) along the two diagonals


@dataclass(frozen=True)
class Photograph:
    """A photograph as its patches show it.

    image (H, W, C) 8 bits, red first; view its effects.base.View; codes of the patches (gap.measure.capture.Codes); plates
    (k,) which of them are looked at; features (k, 19) as gap.measure.plate measures them in it.
    """

    image: np.ndarray
    view: object
    codes: object
    plates: np.ndarray
    features: np.ndarray
    reach_px = 24  # about a patch: what effects see

    def fewer(self, most):
        """Return the photograph as so many of its patches show it."""
        kept = np.linspace(0, len(self.plates) - 1, min(len(self.plates), most)).round().astype(int)
        return replace(self, plates=self.plates[kept], features=self.features[kept])

    @cached_property
    def atlas(self):
        """Where the windows about the patches lie in one small image."""
        return make_atlas(plate_cores(self._corners, self.codes, self.plates), self.reach_px, self._size)

    @property
    def _corners(self):
        """The corners (p, 4, 2) of all codes, 0 of those that are not looked at."""
        corners = np.zeros((len(self.codes.half_code), 4, 2))
        corners[self.plates] = corners_in(self.features)
        return corners

    @property
    def _size(self):
        return self.view.width, self.view.height

    @cached_property
    def _classes(self):
        """Which pixels of the windows are white or black throughout."""
        return window_classes(self.atlas, self.plates, self._corners, self.codes, ())

    @cached_property
    def _small(self):
        """The whole frame's linear light in small, as windows of an image have it below them."""
        small = cv2.resize(LINEAR[self.image], (FRAME_COLUMNS, FRAME_ROWS), interpolation=cv2.INTER_AREA)
        return small.reshape(FRAME_ROWS, FRAME_COLUMNS, -1)

    @cached_property
    def _whole_blocks(self):
        """Which blocks (rows, columns) of the windows' small image lie in a window."""
        inside = np.zeros(self.atlas.shape, bool)
        for k in range(len(self.plates)):
            inside[self.atlas.window(k)] = True
        return inside[::BLOCK, ::BLOCK]

    def levels(self, effects=(), rng=None):
        """Return the grey levels (rows, columns, C) of the windows, with effects [(name, parameters)] laid on."""
        if not effects:
            return self.atlas.gather(self.image).astype(np.float32)
        view = replace(self.view, margin=0, windows=self.atlas.windows, exposure=1.0, noise_dn=0.0)
        linear = self._light_at(view.windows.x, view.windows.y, view, effects)
        linear[self.atlas.windows.frame] = self._small
        formed = pipeline.photometric(linear, view, list(effects), rng)[: self.atlas.shape[0]]
        return np.clip(np.rint(formed), 0, 255)

    def seen_by(self, before, after):
        """Return the photograph as it would be if its lens, effects ``before`` that move points, had been ``after``."""
        corners = pipeline.inverse_points(self.features[:, CORNERS].reshape(-1, 2), self._whole_view, before)
        corners = pipeline.map_points(corners, self._whole_view, after).reshape(-1, 8)
        return self._resampled(*self._sources(before, after), corners)

    def interpolated_as_seen_by(self, before, after):
        """Return the photograph as it is, interpolated between pixels where ``seen_by`` does: that smooths noise alike.

        Of how far ``seen_by`` moves a pixel the distance from an even number is left: a pixel at most, without a jump.
        """
        sources, corners = self._sources(before, after), self.features[:, CORNERS].reshape(-1, 2).copy()
        column, row = (np.rint(np.clip(v, 0, n - 1)).astype(int) for v, n in zip(corners.T, self._size, strict=True))
        there = []
        here = np.indices(self.image.shape[:2], np.float32)[::-1]
        for k, (source, own) in enumerate(zip(sources, here, strict=True)):
            moved = np.abs((source - own + 1) % 2 - 1)
            corners[:, k] -= moved[row, column]
            there.append(own + moved)
        return self._resampled(*there, corners.reshape(-1, 8))

    @property
    def _whole_view(self):
        return replace(self.view, margin=0, windows=None)

    def _sources(self, before, after):
        """Return where in the photograph (x, y float32) each pixel (H, W) comes from that a lens ``after`` would show."""
        ideal = np.stack(pipeline.source_map(self._whole_view, after, 1), axis=-1).reshape(-1, 2)
        there = np.nan_to_num(pipeline.map_points(ideal, self._whole_view, before), nan=-1.0).astype(np.float32)
        return [np.ascontiguousarray(v.reshape(self.image.shape[:2])) for v in there.T]

    def _resampled(self, x, y, corners):
        """Return the photograph with each pixel's light from x, y (H, W) float32, its patches near corners (k, 8)."""
        light = cv2.remap(LINEAR[self.image], x, y, cv2.INTER_CUBIC, borderMode=cv2.BORDER_REPLICATE)
        image = pipeline.to_uint8(encode(light.reshape(self.image.shape), "srgb"))
        features = self.features.copy()
        features[:, CORNERS] = corners
        wanted, states = np.isfinite(corners).all(1), np.zeros((len(self.codes.half_code), N_STATE))
        states[self.plates[wanted]] = states_of(features[wanted])
        tried = np.isin(np.arange(len(states)), self.plates[wanted])
        found, _, measured = measure_plates(grey_of(image), states, tried, self.codes, FINE)
        return replace(self, image=image, plates=np.flatnonzero(measured), features=found[measured])

    def whole(self, effects, rng):
        """Return the photograph (H, W, C), 8 bits, red first, with effects laid on all of it."""
        view = replace(self.view, margin=0, windows=None, exposure=1.0, noise_dn=0.0)
        y, x = np.indices(self.image.shape[:2], np.float32)
        formed = pipeline.photometric(self._light_at(x, y, view, effects), view, list(effects), rng)
        return pipeline.to_uint8(formed)

    def _light_at(self, x, y, view, effects):
        """Return linear light (rows, columns, C) at pixels x, y, colours moved by effects that move them apart."""
        size = np.array(self._size) - 1
        if not (pipeline.is_chromatic(effects) and self.image.shape[2] > 1):
            columns, rows = (np.rint(np.clip(v, 0, most)).astype(int) for v, most in zip((x, y), size, strict=True))
            return LINEAR[self.image[rows, columns]]
        flat, planes = np.stack([x, y], axis=-1).reshape(-1, 2).astype(float), []
        for channel in range(self.image.shape[2]):
            # moves are small: where they come from
            at = 2 * flat - pipeline.map_points(flat, view, list(effects), channel)
            x_from, y_from = (v.reshape(x.shape).astype(np.float32) for v in at.T)
            plane = LINEAR[self.image[..., channel]]
            planes.append(cv2.remap(plane, x_from, y_from, cv2.INTER_CUBIC, borderMode=cv2.BORDER_REPLICATE))
        return np.stack(planes, axis=-1)

    def signature(self, effects=(), rng=None):
        """Return the signs (len(SIGNS),) of the photograph with effects laid on, NaN where it does not show one."""
        levels = self.levels(effects, rng)
        grey = grey_of(levels)
        found = [self._measured(grey, levels, k, i) for k, i in enumerate(self.plates)]
        found = [f for f in found if f is not None]
        signs = dict.fromkeys(SIGNS, np.nan)
        if found:
            features, colours = (np.array(v) for v in zip(*found, strict=True))
            signs |= self._of_edges(features) | self._of_light(features, colours)
        pairs, *_ = structure(grey.astype(np.float64), self._classes)
        signs |= self._of_sharpness(grey, pairs) | self._of_noise(levels, pairs) | self._of_blocks(grey)
        return np.array([signs[name] for name in SIGNS])

    def _measured(self, grey, levels, k, i):
        """Return (features (19,), colours (10,)) of a patch in the windows' levels, None where it is lost."""
        offset, window = self.atlas.offset(k), self.atlas.window(k)
        state = states_of(shifted(self.features[k], -offset))
        features, _, ok = measure_one(np.ascontiguousarray(grey[window]), state, self.codes, i)
        if not ok:
            return None
        return shifted(features, offset), colour_in(levels[window], corners_in(features), self.codes, i)

    @property
    def pose(self):
        """What of the board's pose signs follow (3,): the logarithm of a patch's side in pixels, and how that grows to the right
        and down over half the frame's diagonal, the board's tilt.
        """
        corners = corners_in(self.features)
        sides = np.log(np.linalg.norm(corners - np.roll(corners, -1, axis=1), axis=2).mean(1))
        places = self._places(self.features)
        places -= places.mean(0)
        slopes = np.linalg.solve(places.T @ places + SPARE * len(places) * np.eye(2), places.T @ (sides - sides.mean()))
        return np.array([sides.mean(), *slopes])

    def _places(self, features):
        """Return the places (p, 2) of patches from the frame's middle, in halves of its diagonal."""
        size = np.array(self._size)
        return (corners_in(features).mean(1) - (size - 1) / 2) / np.hypot(*size) * 2

    def _of_edges(self, features):
        values = {name: features[:, COLUMN[name]] for name in EDGES}
        r2 = (self._places(features) ** 2).sum(1)
        out = {name: np.median(v) for name, v in values.items()}
        return out | {"overshoot_outwards": slope(values["overshoot"], r2)}

    def _of_light(self, features, colours):
        of_surfaces = zip(self.codes.nominal_dn, features[:, SURFACES].T, strict=True)
        white, black, _ = (nominal + off for nominal, off in of_surfaces)
        # white's differences from the mean of the three
        of_red, of_blue = (colours[:, COLUMN[name]] for name in ("red_white", "blue_white"))
        red, green, blue = (linear(white + d) for d in (of_red, -of_red - of_blue, of_blue))
        places = self._places(features)
        plane = np.column_stack([np.ones(len(places)), places])
        r2 = (places**2).sum(1)
        flat = [v - plane @ np.linalg.lstsq(plane, v, rcond=None)[0] for v in (np.log(linear(white)), r2)]
        out = {
            "light": np.median(np.log(linear(white))),
            "black": np.median(linear(black) / linear(white)),
            "light_outwards": (flat[0] @ flat[1]) / (flat[1] @ flat[1] + SPARE_CURVED * len(r2)),
            "red": np.median(np.log(red / green)),
            "blue": np.median(np.log(blue / green)),
        }
        for name in ("red", "blue"):
            along = colours[:, columns(f"{name}_dx", f"{name}_dy")] * places
            out[f"{name}_outwards"] = along.sum() / ((places**2).sum() + SPARE * len(places))
        return out

    def _of_sharpness(self, grey, pairs):
        cores = [grey[self.atlas.core(k)].astype(float) for k in range(len(self.plates))]
        noise = self._noise_in(grey, pairs, np.concatenate([c.ravel() for c in cores] or [np.zeros(1)]))
        x, y, down, up = (_fineness(cores, step, noise) for step in ((1, 0), (0, 1), *TURNS))
        return {"fine_x": x, "fine_y": y, "fine_turn": down - up}

    def _noise_in(self, grey, pairs, levels):
        """Return what neighbours among ``levels`` (n,) differ by for noise, squared: it goes from black's to white's by level."""
        flats = pairs[[BLACK_PIXELS, WHITE_PIXELS], :4]
        black, white = flats[:, ::2].sum(1) / np.maximum(flats[:, 1::2].sum(1), 1)
        low, high = (
            np.mean(grey[self._classes == k]) if (self._classes == k).any() else 0.0
            for k in (BLACK_PIXELS, WHITE_PIXELS)
        )
        share = np.mean(np.clip((levels - low) / (high - low), 0, 1)) if high > low else 0.5
        return black + share * (white - black)

    def _of_noise(self, levels, pairs):
        white, black = pairs[WHITE_PIXELS], pairs[BLACK_PIXELS]
        out = {}
        for name, of in (("noise_white", white), ("noise_black", black)):
            n = of[1] + of[3]
            out[name] = _log((of[0] + of[2]) / n / 2) if n >= MIN_PIXELS else np.nan
        both = white + black
        if min(both[[1, 3, 5, 7]]) >= MIN_PIXELS:
            d1x, d1y, d2x, d2y = both[[0, 2, 4, 6]] / both[[1, 3, 5, 7]]
            out["noise_across"] = _log(d1y) - _log(d1x)
            out["noise_coarse"] = _log(d2x + d2y) - _log(d1x + d1y)
            if levels.shape[2] > 1:
                colour = np.ascontiguousarray(levels[..., 0] - levels[..., 2], np.float64)
                of = structure(colour, self._classes)[0][[WHITE_PIXELS, BLACK_PIXELS]].sum(0)
                out["noise_colour"] = _log((of[0] + of[2]) / (of[1] + of[3])) - _log(d1x + d1y)
        return out

    def _of_blocks(self, grey):
        rows, columns = (n // BLOCK for n in grey.shape)
        blocks = grey.reshape(rows, BLOCK, columns, BLOCK).transpose(0, 2, 1, 3)[self._whole_blocks]
        coefficients = dctn(blocks, axes=(1, 2), norm="ortho")
        order = np.add.outer(np.arange(BLOCK), np.arange(BLOCK))
        fine = np.abs(coefficients[:, order >= FINE_COEFFICIENT])
        steps = np.abs(np.diff(grey, axis=1))
        flat = (self._classes[:, 1:] > 0) & (self._classes[:, 1:] == self._classes[:, :-1])
        edge = np.zeros_like(flat)
        edge[:, BLOCK - 1 :: BLOCK] = True
        at, off = steps[flat & edge], steps[flat & ~edge]
        enough = min(len(at), len(off)) >= MIN_PIXELS // 2
        return {
            "flat_blocks": (fine < NEARLY_0_DN).mean() if len(blocks) else np.nan,
            "blocks": _log((at**2).mean()) - _log((off**2).mean()) if enough else np.nan,
        }


def linear(levels):
    """Return linear light of grey levels, never none."""
    return np.maximum(srgb_decode(np.clip(levels, 0, 255) / 255), MIN_LIGHT)


def slope(values, by):
    """Return how values (p,) grow with others (p,), less where these hardly differ."""
    by = by - by.mean()
    return (values - values.mean()) @ by / (by @ by + SPARE * len(by))


def _fineness(cores, step, noise):
    """Return the logarithm of what levels (rows, columns), a list of them, differ by over ``NEAR`` steps (x, y) against ``FAR``
    ones, NaN where all are too small; ``noise`` is what flats differ by, squared.

    It is the less the wider edges are: from 1 / ``FAR`` of sharp ones to its square.
    """
    squares = np.zeros((2, 2))
    farthest = FAR * np.abs(step[::-1])
    for levels in (core for core in cores if (core.shape > farthest).all()):
        rows, columns = levels.shape
        for k, times in enumerate((NEAR, FAR)):
            x, y = abs(step[0]) * times, step[1] * times
            first, second = levels[: rows - y, : columns - x], levels[y:, x:]
            if step[0] < 0:
                first, second = levels[: rows - y, x:], levels[y:, : columns - x]
            squares[k] += ((second - first) ** 2).sum(), first.size
    if not squares[:, 1].all():
        return np.nan
    near, far = (max(square - noise, MIN_EDGES * square) for square in squares[:, 0] / squares[:, 1])
    return _log(near) - _log(far)


def _log(value):
    """Return the logarithm of a variance, of what rounding leaves at least."""
    return float(np.log(max(value, 1e-2)))
