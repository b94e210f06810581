"""Observables of one image, real or twin, by the same code: plates, colour, flats, noise."""

from dataclasses import dataclass
from functools import cached_property

import cv2
import numpy as np

from gap.measure.places import agreeing
from gap.measure.plate import BLACK, N_STATE, WHITE, _draw_model, code_homography, measure_plate, plate_window
from gap.measure.regions import BY_SURFACE, GROUND, N_GROUND, SKY, _classify_plate, flat_classes, noise_features
from gap.measure.response import plate_response
from gap.observables import COLUMN, CORNERS, N_COLOUR, N_FEATURES, RIDGES, STATE_RIM, corners_in, states_of
from gap.pixels.windows import make_atlas
from kernels import njit
from rig.plates import black_rectangles

COLOUR_RIDGE = RIDGES["colour"][: N_COLOUR // 2]  # of red; blue's is the same
WINDOW_PAD_PX, COLOUR_PAD_PX = 5, 8  # that are looked at beyond a plate, beyond a code for its colours
COARSE_TO_FINE = np.array([4, 1, 0])
FINE = np.array([0])
MAX_PX_OFF = 25.0
REPEATS, CHANCE = 2, 2.0  # measurements with noise added; the mean square that they reach once in a hundred times
LARGEST_NOISE_VARIANCE, SMALLEST_NOISE_VARIANCE = 4.0, 0.05  # squared grey levels, by which plates are weighted
MAX_AMPLIFIED = 4.0  # noise of a plate that is used
MIN_CONTRAST = 0.2  # of the nominal: to the noise of a black or saturated image a small faint plate fits
WORST_MISFIT = 0.15  # of the contrast: a fit to something else than the plate leaves more, any effect less


def grey_of(image):
    """Return the mean (H, W) float32 over the channels of an image (H, W, C)."""
    image = np.ascontiguousarray(image, np.float32)
    if image.shape[2] == 1 or not image.size:
        return image[..., 0]
    return cv2.transform(image, np.full((1, image.shape[2]), 1 / image.shape[2], np.float32))


@dataclass
class Codes:
    """The nominal plates as the fit needs them: arrays over plates.

    ``beyond`` are the metres that white goes on beyond what is looked at: a board's patches end on its paper. ``worst_misfit``
    is the largest share of the contrast that a fit may leave.
    """

    half_code: np.ndarray
    half_plate: np.ndarray
    rectangles: list
    first: np.ndarray
    all_rectangles: np.ndarray
    levels: np.ndarray
    lut: np.ndarray
    beyond: float = 0.0
    worst_misfit: float = WORST_MISFIT

    @cached_property
    def nominal_dn(self):
        """The grey levels (3,) of nominal white, black and ground."""
        return np.interp(self.levels, np.linspace(0, 1, len(self.lut)), self.lut)

    @cached_property
    def contrast_dn(self):
        """Grey levels from nominal black to nominal white."""
        white, black, _ = self.nominal_dn
        return white - black

    @classmethod
    def of(cls, plates, levels, lut):
        """Build from marker plates (a code with one white ring round it), linear levels (3,) and the encoding's table."""
        halves = np.array([(p.x_m[-2], p.x_m[-1]) for p in plates])
        return cls.of_squares(*halves.T, [black_rectangles(p) for p in plates], levels, lut)

    @classmethod
    def of_squares(cls, half_code, half_plate, rectangles, levels, lut, beyond=0.0, worst_misfit=WORST_MISFIT):
        """Build from half the sides of codes and plates (p,), their black rectangles [(n, 4)], the rest as ``of``."""
        first = np.concatenate([[0], np.cumsum([len(r) for r in rectangles])])
        every, levels = np.concatenate(rectangles), np.asarray(levels, float)
        return cls(half_code, half_plate, rectangles, first, every, levels, lut, beyond, worst_misfit)


@dataclass
class Observation:
    """What was measured in one image.

    features (p, 19) of gap.observables.FEATURES, corners first, in pixels; information (p, 19, 19) per unit noise
    variance; measured (p,) bool; colour (p, 10); regions (80, 4) of gap.measure.regions.choose_regions; field (80,) their levels,
    field_n their pixels; noise, noise_se.
    """

    features: np.ndarray
    information: np.ndarray
    measured: np.ndarray
    colour: np.ndarray
    regions: np.ndarray
    field: np.ndarray
    field_n: np.ndarray
    noise: np.ndarray
    noise_se: np.ndarray

    @property
    def corners(self):
        """Corners of the codes (p, 4, 2), pixels; of a board its points (p, 1, 2)."""
        return corners_in(self.features)

    @property
    def has_noise_by_channel(self):
        """Whether red and blue differ by noise of their own: the mean over channels then has less."""
        return self.noise[COLUMN["noise_colour"]] > np.log(0.5)


@njit(cache=True, nogil=True)
def colour_response(shape, corners, half_code, half_plate, rectangles, levels, lut):
    """Return (response (5, n), x0, y0, rows, columns): by what a plate's five features of one colour, differences of its
    levels and places to the mean image's, change with each pixel of a window from x0, y0 of an image of ``shape``.
    """
    x0, y0 = int(corners[:, 0].min()) - COLOUR_PAD_PX, int(corners[:, 1].min()) - COLOUR_PAD_PX
    x1, y1 = int(corners[:, 0].max()) + COLOUR_PAD_PX + 1, int(corners[:, 1].max()) + COLOUR_PAD_PX + 1
    x0, y0, x1, y1 = max(x0, 0), max(y0, 0), min(x1, shape[1]), min(y1, shape[0])
    if x1 - x0 < 8 or y1 - y0 < 8:
        return np.zeros((len(COLOUR_RIDGE), 0)), 0, 0, 0, 0
    rows, columns = y1 - y0 - 2, x1 - x0 - 2
    plate, black, _, _, model = _draw_model(
        (y1 - y0, x1 - x0), corners, half_code, half_plate, rectangles, levels, np.zeros(5), lut, x0, y0
    )
    S = np.empty((len(COLOUR_RIDGE), rows * columns))
    for r in range(rows):
        above, row, below, on, ink = model[r], model[r + 1], model[r + 2], plate[r + 1], black[r + 1]
        for c in range(columns):
            k = r * columns + c
            S[0, k], S[1, k], S[2, k] = on[c + 1] - ink[c + 1], ink[c + 1], 1 - on[c + 1]
            S[3, k] = 0.5 * (row[c] - row[c + 2])  # a pixel changes so where the whole plate moves
            S[4, k] = 0.5 * (above[c + 1] - below[c + 1])
    M = S @ S.T
    for k in range(len(S)):
        M[k, k] += COLOUR_RIDGE[k]
    return np.linalg.solve(M, S), x0 + 1, y0 + 1, rows, columns


def states_at(corners, codes, rims=0.0):
    """Return states (p, 14) from which plates are measured: corners (p, 4, 2), nominal levels, ``rims`` (p,) how far plates
    reach beyond the nominal ones, metres.
    """
    states = np.zeros((len(corners), N_STATE))
    states[:, CORNERS] = corners.reshape(-1, 8)
    sides = np.linalg.norm(corners - np.roll(corners, -1, axis=1), axis=-1).mean(1)
    states[:, STATE_RIM] = rims * np.nan_to_num(sides) / (2 * codes.half_code)
    return states


def measure_plates(grey, states, wanted, codes, radii):
    """Measure the wanted plates (p,) of a grey image (H, W) from states (p, 14) near them.

    Return features (p, 19), information (p, 19, 19), measured (p,).
    """
    n = len(states)
    features = np.full((n, N_FEATURES), np.nan)
    information = np.zeros((n, N_FEATURES, N_FEATURES))
    measured = np.zeros(n, bool)
    grey = np.ascontiguousarray(grey, np.float32)
    for i in np.flatnonzero(wanted):
        features[i], information[i], measured[i] = measure_one(grey, states[i], codes, i, radii)
    return features, information, measured


def measure_one(grey, state, codes, i, radii=FINE):
    """Return (features (19,), information (19, 19), whether it was measured) of plate i in a grey image."""
    f, information, _, variance, _, ok = measure_plate(
        grey, np.ascontiguousarray(state), codes.half_code[i], codes.half_plate[i], codes.beyond,
        codes.rectangles[i], codes.levels, codes.lut, radii, MAX_PX_OFF,
    )  # fmt: skip
    contrast = codes.contrast_dn + f[WHITE] - f[BLACK]
    if ok and contrast > MIN_CONTRAST * codes.contrast_dn and np.sqrt(variance) < codes.worst_misfit * contrast:
        return f, information, True
    return np.full(N_FEATURES, np.nan), np.zeros((N_FEATURES, N_FEATURES)), False


def responses_of(grey, features, codes, i):
    """Return what ``gap.measure.plate.plate_response`` says of plate i, measured in a grey image (H, W) as features (19,)."""
    return plate_response(
        grey, states_of(features), codes.half_code[i], codes.half_plate[i], codes.beyond,
        codes.rectangles[i], codes.levels, codes.lut,
    )  # fmt: skip


def colour_responses_of(shape, corners, codes, i):
    """Return what ``colour_response`` says of plate i with corners (4, 2) in an image of a shape."""
    half_code, white = codes.half_code[i], codes.half_plate[i] + codes.beyond
    corners = np.ascontiguousarray(corners)
    return colour_response(shape, corners, half_code, white, codes.rectangles[i], codes.levels, codes.lut)


def colour_of(image, response):
    """Return the ten colour features of a plate in an image (H, W, 3) by its ``colour_response``, red first."""
    by_pixel, x0, y0, rows, columns = response
    window = image[y0 : y0 + rows, x0 : x0 + columns]
    mean = window.mean(axis=2, dtype=np.float32)
    return np.concatenate([by_pixel @ (window[..., k] - mean).ravel().astype(np.float64) for k in (0, 2)])


def colour_in(image, corners, codes, i):
    """Return the ten colour features of plate i with corners (4, 2) in an image (H, W, C), zeros in a grey one."""
    if image.shape[2] == 1:
        return np.zeros(N_COLOUR)
    return colour_of(image, colour_responses_of(image.shape[:2], corners, codes, i))


def measure_colour(image, corners, measured, codes):
    """Return the colour features (p, 10) of a colour image (H, W, 3), red first; zeros for a grey one (H, W, 1)."""
    out = np.zeros((len(corners), N_COLOUR))
    for i in np.flatnonzero(measured):
        out[i] = colour_in(image, corners[i], codes, i)
    return out


def horizon_rows(view):
    """Return the row of the ground's horizon in each column (W,), pixels; far outside where there is none."""
    up = view.T_cam_world[:3, 2]
    rays_x = (np.arange(view.width) - view.K[0, 2]) / view.K[0, 0]
    if abs(up[1]) < 1e-9:
        return np.full(view.width, -1e6)
    rows = view.K[1, 1] * -(up[0] * rays_x + up[2]) / up[1] + view.K[1, 2]
    return np.clip(rows, -1e6, 1e6)


def classify_flats(shape, corners, measured, outlines, view, codes):
    """Return the class of each pixel (H, W); plates that were not measured are left out by their outlines (p, 4, 2)."""
    outlines = outlines[~measured]
    outlines = outlines[np.isfinite(outlines).all((1, 2))]
    boxes = np.concatenate([outlines.min(1) - 14, outlines.max(1) + 14], axis=1) if len(outlines) else np.zeros((0, 4))
    boxes = np.clip(boxes, -1e6, 1e6)
    return flat_classes(
        shape, np.nan_to_num(np.ascontiguousarray(corners)), measured, codes.half_code, codes.half_plate,
        codes.all_rectangles, codes.first, boxes, horizon_rows(view),
    )  # fmt: skip


def plate_cores(corners, codes, plates, rims=0.0):
    """Return (k, 4) int, x0, y0, x1, y1: the pixels from which some plates are measured, corners (p, 4, 2) of the codes,
    ``rims`` (p,) metres that plates reach beyond the nominal ones.
    """
    outlines = codes.half_plate + rims
    return _plate_cores(np.ascontiguousarray(corners), codes.half_code, outlines, np.asarray(plates, np.int64))


@njit(cache=True, nogil=True)
def _plate_cores(corners, half_code, half_plate, plates):
    out = np.empty((len(plates), 4), np.int64)
    for k in range(len(plates)):
        i = plates[k]
        x0, y0, x1, y1 = plate_window(code_homography(corners[i], half_code[i]), half_plate[i], WINDOW_PAD_PX)
        out[k, 0] = min(x0, int(corners[i, :, 0].min()) - COLOUR_PAD_PX - 1)
        out[k, 1] = min(y0, int(corners[i, :, 1].min()) - COLOUR_PAD_PX - 1)
        out[k, 2] = max(x1, int(corners[i, :, 0].max()) + COLOUR_PAD_PX + 2)
        out[k, 3] = max(y1, int(corners[i, :, 1].max()) + COLOUR_PAD_PX + 2)
    return out


def window_classes(atlas, plates, corners, codes, regions):
    """Return the class of each pixel of windows put together (rows, columns), 0 where it is not flat.

    The first windows of the atlas are those of ``plates`` (k,) of the codes, whose corners (p, 4, 2) are frame pixels; those of
    ``regions``, cells of the grid, follow in order; one of -1 is not looked at.
    """
    out = np.zeros(atlas.shape, np.uint8)
    for k, i in enumerate(plates):
        rectangles = codes.rectangles[i]
        place = out[atlas.window(k)]
        shown = np.zeros(place.shape, np.uint8)
        _classify_plate(shown, corners[i] - atlas.offset(k), codes.half_code[i], codes.half_plate[i], rectangles)
        place[:] = shown
    for k, cell in enumerate(regions):
        if cell >= 0:
            out[atlas.core(len(plates) + k)] = GROUND if cell < N_GROUND else SKY
    return out


def measure_regions(image, atlas, plates, regions):
    """Return (levels (80,), their numbers of pixels) of an image (rows, columns) put together as ``window_classes`` says."""
    levels, numbers = np.full(2 * N_GROUND, np.nan), np.zeros(2 * N_GROUND)
    for k, cell in enumerate(regions):
        square = image[atlas.core(len(plates) + k)]
        levels[cell], numbers[cell] = square.mean(dtype=np.float64), square.size
    return levels, numbers


def measure_noise(image, atlas, plates, regions, classes):
    """Return (values, standard errors) of the noise features of an image (rows, columns, C) put together of windows."""
    ground = [atlas.core(len(plates) + k) for k, cell in enumerate(regions) if 0 <= cell < N_GROUND]
    squares = np.array([[c.start, r.start, c.stop, r.stop] for r, c in ground], np.int64).reshape(-1, 4)
    planes = [np.ascontiguousarray(image[..., i], np.float64) for i in range(image.shape[2])]
    red, green, blue = planes if len(planes) > 1 else (None, planes[0], None)
    return noise_features(green, red, blue, classes, squares)


def noise_amplification(grey, features, information, measured, codes):
    """Return how many times as far as their information says noise moves the measured plates (p,), 1 or more; infinite
    where a plate is then lost.

    Where blur is wider than a module, a fit to the sharp code hardly knows where to go: the plates are measured again with
    noise of one grey level added. What chance makes of twice eight corner coordinates is no amplification.
    """
    squares = np.where(measured, 0.0, 1.0)
    for seed in range(REPEATS):
        noise = np.random.default_rng(seed).standard_normal(grey.shape, dtype=np.float32)
        again, _, found = measure_plates(grey + noise, states_of(features), measured, codes, FINE)
        for i in np.flatnonzero(measured):
            moved = again[i, CORNERS] - features[i, CORNERS]
            covariance = np.linalg.inv(information[i])[CORNERS, CORNERS]
            squares[i] += moved @ np.linalg.solve(covariance, moved) / (len(moved) * REPEATS) if found[i] else np.inf
    return np.sqrt(np.where(squares > CHANCE, squares, 1.0))


def observe(image, starts, wanted, codes, radii, regions_of):
    """Measure one image (H, W, C) of grey levels (0..255, float or uint8; red first).

    starts (p, 4, 2) predicted corners of the codes; ``regions_of`` returns the regions (80, 4) of an image of measured plates,
    its arguments corners (p, 4, 2) and measured (p,). Return (Observation, variance of the noise of the mean over channels where
    it is least, squared grey levels).
    """
    image = image.astype(np.float32)
    grey = grey_of(image)
    features, information, measured = measure_plates(grey, states_at(starts, codes), wanted, codes, radii)
    amplified = noise_amplification(grey, features, information, measured, codes)
    information = information / np.minimum(amplified, MAX_AMPLIFIED)[:, None, None] ** 2
    corners = corners_in(features)
    measured = agreeing(starts, corners, measured & (amplified < MAX_AMPLIFIED))
    colour = measure_colour(image, corners, measured, codes)
    regions = regions_of(corners, measured)
    plates, wanted = np.flatnonzero(measured), np.flatnonzero(regions[:, 2])
    cores = np.concatenate([plate_cores(corners, codes, plates), regions[wanted]])
    atlas = make_atlas(cores, 0, grey.shape[::-1])
    seen = atlas.gather(image)
    field, field_n = measure_regions(grey_of(seen), atlas, plates, wanted)
    classes = window_classes(atlas, plates, corners, codes, wanted)
    noise, noise_se = measure_noise(seen, atlas, plates, wanted, classes)
    of_mean, _ = measure_noise(grey_of(seen)[..., None], atlas, plates, wanted, classes)
    quietest = np.exp(np.nanmin(np.append(of_mean[BY_SURFACE], np.log(LARGEST_NOISE_VARIANCE))))
    observation = Observation(features, information, measured, colour, regions, field, field_n, noise, noise_se)
    return observation, float(max(quietest, SMALLEST_NOISE_VARIANCE))


def read_rgb(image_bgr):
    """Return (H, W, 3) or (H, W, 1), red first, scaled to 0..255, from an image as cv2.imread gives it."""
    image = image_bgr[..., None] if image_bgr.ndim == 2 else cv2.cvtColor(image_bgr, cv2.COLOR_BGR2RGB)
    return image.astype(np.float32) / (257.0 if image.dtype == np.uint16 else 1.0)
