"""Observables of one image, real or twin, by the same code: plates, colour, flats, noise."""

from dataclasses import dataclass

import cv2
import numpy as np
from numba import njit

from gap.flats import NOISE_FEATURES, field_levels, flat_classes, noise_features
from gap.patch import FEATURES, N_FEATURES, N_STATE, _expand, _solve, measure_plate
from gap.patch import RIM as RIM_STATE
from gap.synthesis import black_rectangles

COLOUR_FEATURES = (
    "red_white", "red_black", "red_ground", "red_dx", "red_dy",
    "blue_white", "blue_black", "blue_ground", "blue_dx", "blue_dy",
)  # fmt: skip
N_COLOUR = len(COLOUR_FEATURES)
SMALLEST_SIDE_PX = 7.0  # of the code: a module is then one pixel
# Prior precision of the coefficients, in grey levels of noise: corners and levels free, the rest held to sense
RIDGE = np.array([1e-4] * 8 + [1e-4] * 5 + [1e-2] * 5 + [1e-4])
COARSE_TO_FINE = np.array([4, 1, 0])
FINE = np.array([0])
FARTHEST_PX = 25.0
FARTHEST_FOLLOWED_PX = 80.0
FEWEST_TO_FOLLOW = 4  # plates
REPEATS, CHANCE = 2, 2.0  # measurements with noise added; the mean square that they reach once in a hundred times
MOST_AMPLIFIED = 4.0  # noise of a plate that is used
WHITE, BLACK, RIM = (FEATURES.index(name) for name in ("white", "black", "rim"))
LEAST_CONTRAST = 0.2  # of the nominal: to the noise of a black or saturated image a small faint plate fits
WORST_MISFIT = 0.15  # of the contrast: a fit to something else than the plate leaves more, any effect less


def grey_of(image):
    """Return the mean (H, W) float32 over the channels of an image (H, W, C)."""
    image = np.ascontiguousarray(image, np.float32)
    if image.shape[2] == 1:
        return image[..., 0]
    return cv2.transform(image, np.full((1, image.shape[2]), 1 / image.shape[2], np.float32))


@dataclass
class Codes:
    """The nominal plates as the fit needs them: arrays over plates."""

    half_code: np.ndarray
    half_plate: np.ndarray
    rectangles: list
    first: np.ndarray
    all_rectangles: np.ndarray
    levels: np.ndarray
    lut: np.ndarray

    @property
    def contrast_dn(self):
        """Grey levels from nominal black to nominal white."""
        white, black = np.interp(self.levels[:2], np.linspace(0, 1, len(self.lut)), self.lut)
        return white - black

    @classmethod
    def of(cls, plates, levels, lut):
        """Build from marker plates (a code with one white ring round it), linear levels (3,) and the encoding's table."""
        half_code = np.array([p.x_m[-2] for p in plates])
        half_plate = np.array([p.x_m[-1] for p in plates])
        rectangles = [black_rectangles(p) for p in plates]
        first = np.concatenate([[0], np.cumsum([len(r) for r in rectangles])])
        return cls(
            half_code,
            half_plate,
            rectangles,
            first,
            np.concatenate(rectangles),
            np.asarray(levels, float),
            lut,
        )


@dataclass
class Observation:
    """What was measured in one image.

    features (p, 19) of gap.patch.FEATURES, corners first, in pixels; information (p, 19, 19) per unit noise
    variance; measured (p,) bool; colour (p, 10); classes (H, W); field, field_n; noise, noise_se.
    """

    features: np.ndarray
    information: np.ndarray
    measured: np.ndarray
    misfit: np.ndarray
    colour: np.ndarray
    classes: np.ndarray
    field: np.ndarray
    field_n: np.ndarray
    noise: np.ndarray
    noise_se: np.ndarray

    @property
    def corners(self):
        """Corners of the codes (p, 4, 2), pixels."""
        return self.features[:, :8].reshape(-1, 4, 2)

    @property
    def has_noise_by_channel(self):
        """Whether red and blue differ by noise of their own: the mean over channels then has less."""
        return self.noise[NOISE_FEATURES.index("noise_colour")] > np.log(0.5)


@njit(cache=True)
def _colour(red, blue, corners, half_code, half_plate, rectangles, levels, lut):
    """Return the ten colour features of a plate: differences to the mean image, by regression about its corners."""
    h, w = red.shape
    x0, y0 = int(corners[:, 0].min()) - 8, int(corners[:, 1].min()) - 8
    x1, y1 = int(corners[:, 0].max()) + 9, int(corners[:, 1].max()) + 9
    x0, y0, x1, y1 = max(x0, 0), max(y0, 0), min(x1, w), min(y1, h)
    out = np.zeros(10)
    if x1 - x0 < 8 or y1 - y0 < 8:
        return out
    B, _ = _expand(
        red[y0:y1, x0:x1].astype(np.float64),
        corners,
        half_code,
        half_plate,
        rectangles,
        levels,
        np.zeros(5),
        lut,
        x0,
        y0,
        0,
    )
    S = np.empty((5, *B.shape[1:]))
    S[:3] = B[8:11]
    S[3] = B[0] + B[2] + B[4] + B[6]
    S[4] = B[1] + B[3] + B[5] + B[7]
    ridge = np.full(5, 1e-3)
    for i in range(2):
        image = red if i == 0 else blue
        inner = image[y0 + 1 : y1 - 1, x0 + 1 : x1 - 1].astype(np.float64)
        coefficients, _, _, _ = _solve(S, inner, ridge)
        out[5 * i : 5 * i + 5] = coefficients
    return out


def code_sides_px(corners):
    """Return the shortest side of each code (p,), pixels, corners (p, 4, 2)."""
    return np.linalg.norm(corners - np.roll(corners, -1, axis=1), axis=-1).min(1)


def wholly_inside(corners, width, height, border=6.0):
    """Return a mask (p,) of codes whose plates lie inside the frame with a border of white round them."""
    centre = corners.mean(1, keepdims=True)
    plate = centre + (corners - centre) * 1.45
    finite = np.isfinite(plate).all((1, 2))
    plate = np.nan_to_num(plate, nan=-1e9)
    return (
        finite
        & (plate[..., 0].min(1) > border)
        & (plate[..., 0].max(1) < width - 1 - border)
        & (plate[..., 1].min(1) > border)
        & (plate[..., 1].max(1) < height - 1 - border)
    )


def follow_neighbours(points, starts, corners, measured):
    """Return points (p, 4, 2) moved as the measured corners (p, 4, 2) were from their starts (p, 4, 2).

    The move is a smooth one, quadratic in the image and fitted robustly.
    """
    if measured.sum() < FEWEST_TO_FOLLOW:
        return points
    moved = corners[measured].reshape(-1, 2) - starts[measured].reshape(-1, 2)
    scale = np.nanmax(np.abs(starts[measured]))

    def powers(xy):
        x, y = (xy / scale).T
        columns = [np.ones_like(x), x, y]
        if measured.sum() >= 8:
            columns += [x * x, x * y, y * y]
        return np.stack(columns, axis=1)

    A = powers(starts[measured].reshape(-1, 2))
    weight = np.ones(len(A))
    for _ in range(10):
        solution = np.linalg.lstsq(A * weight[:, None], moved * weight[:, None], rcond=None)[0]
        weight = 1 / np.sqrt(1 + ((moved - A @ solution) ** 2).sum(1))
    shift = (powers(points.reshape(-1, 2)) @ solution).reshape(points.shape)
    return points + np.clip(shift, -FARTHEST_FOLLOWED_PX, FARTHEST_FOLLOWED_PX)


def agreeing(starts, corners, measured):
    """Return which of the measured plates (p,) lie, to within their code's side, where the others' move from their starts
    puts them: what is farther off is another plate.
    """
    if measured.sum() < FEWEST_TO_FOLLOW:
        return measured
    expected = follow_neighbours(starts, starts, corners, measured)
    off = np.abs(corners.mean(1) - expected.mean(1)).max(-1)
    return measured & ~(off > code_sides_px(expected))


def states_at(corners, codes, rims=0.0):
    """Return states (p, 14) from which plates are measured: corners (p, 4, 2), nominal levels, ``rims`` (p,) how far plates
    reach beyond the nominal ones, metres.
    """
    states = np.zeros((len(corners), N_STATE))
    states[:, :8] = corners.reshape(-1, 8)
    sides = np.linalg.norm(corners - np.roll(corners, -1, axis=1), axis=-1).mean(1)
    states[:, RIM_STATE] = rims * np.nan_to_num(sides) / (2 * codes.half_code)
    return states


def states_of(features):
    """Return the states (p, 14) of measured features (p, 19)."""
    return features[:, [*range(RIM_STATE), RIM]]


def measure_plates(grey, states, wanted, codes, radii):
    """Measure the wanted plates (p,) of a grey image (H, W) from states (p, 14) near them.

    Return features (p, 19), information (p, 19, 19), measured (p,), misfit variance (p,).
    """
    n = len(states)
    features = np.full((n, N_FEATURES), np.nan)
    information = np.zeros((n, N_FEATURES, N_FEATURES))
    measured = np.zeros(n, bool)
    misfit = np.full(n, np.nan)
    grey = np.ascontiguousarray(grey, np.float32)
    nominal = codes.contrast_dn
    for i in np.flatnonzero(wanted):
        f, info, _, variance, _, ok = measure_plate(
            grey, np.ascontiguousarray(states[i]), codes.half_code[i], codes.half_plate[i], codes.rectangles[i],
            codes.levels, codes.lut, RIDGE, radii, FARTHEST_PX,
        )  # fmt: skip
        contrast = nominal + f[WHITE] - f[BLACK]
        if ok and contrast > LEAST_CONTRAST * nominal and np.sqrt(variance) < WORST_MISFIT * contrast:
            features[i], information[i], measured[i], misfit[i] = f, info, True, variance
    return features, information, measured, misfit


def measure_colour(image, corners, measured, codes):
    """Return the colour features (p, 10) of a colour image (H, W, 3), red first; zeros for a grey one (H, W, 1)."""
    out = np.zeros((len(corners), N_COLOUR))
    if image.shape[2] == 1:
        return out
    mean = grey_of(image)
    red = np.ascontiguousarray(image[..., 0] - mean, np.float32)
    blue = np.ascontiguousarray(image[..., 2] - mean, np.float32)
    for i in np.flatnonzero(measured):
        out[i] = _colour(
            red, blue, np.ascontiguousarray(corners[i]), codes.half_code[i], codes.half_plate[i],
            codes.rectangles[i], codes.levels, codes.lut,
        )  # fmt: skip
    return out


def horizon_rows(view):
    """Return the row of the ground's horizon in each column (W,), pixels; far outside where there is none."""
    up = view.T_cam_world[:3, 2]
    rays_x = (np.arange(view.width) - view.K[0, 2]) / view.K[0, 0]
    if abs(up[1]) < 1e-9:
        return np.full(view.width, -1e6)
    rows = view.K[1, 1] * -(up[0] * rays_x + up[2]) / up[1] + view.K[1, 2]
    return np.clip(rows, -1e6, 1e6)


def classify_flats(shape, corners, measured, outlines, view, codes, band=30.0):
    """Return the class of each pixel (H, W); plates that were not measured are left out by their outlines (p, 4, 2)."""
    outlines = outlines[~measured]
    outlines = outlines[np.isfinite(outlines).all((1, 2))]
    boxes = np.concatenate([outlines.min(1) - 14, outlines.max(1) + 14], axis=1) if len(outlines) else np.zeros((0, 4))
    boxes = np.clip(boxes, -1e6, 1e6)
    return flat_classes(
        shape, np.nan_to_num(np.ascontiguousarray(corners)), measured, codes.half_code, codes.half_plate,
        codes.all_rectangles, codes.first, boxes, horizon_rows(view), band,
    )  # fmt: skip


def noise_amplification(grey, features, information, measured, codes):
    """Return how many times as far as their information says noise moves the measured plates (p,), 1 or more; infinite
    where a plate is then lost.

    Where blur is wider than a module, a fit to the sharp code hardly knows where to go: the plates are measured again with
    noise of one grey level added. What chance makes of twice eight corner coordinates is no amplification.
    """
    squares = np.where(measured, 0.0, 1.0)
    for seed in range(REPEATS):
        noise = np.random.default_rng(seed).standard_normal(grey.shape, dtype=np.float32)
        again, _, found, _ = measure_plates(grey + noise, states_of(features), measured, codes, FINE)
        for i in np.flatnonzero(measured):
            moved = again[i, :8] - features[i, :8]
            covariance = np.linalg.inv(information[i])[:8, :8]
            squares[i] += moved @ np.linalg.solve(covariance, moved) / (8 * REPEATS) if found[i] else np.inf
    return np.sqrt(np.where(squares > CHANCE, squares, 1.0))


def observe(image, starts, outlines, wanted, view, codes, radii):
    """Measure one image (H, W, C) of grey levels (0..255, float or uint8; red first).

    starts (p, 4, 2) predicted corners of the codes; outlines (p, 4, 2) predicted outlines of the plates.
    """
    image = image.astype(np.float32)
    grey = grey_of(image)
    features, information, measured, misfit = measure_plates(grey, states_at(starts, codes), wanted, codes, radii)
    amplified = noise_amplification(grey, features, information, measured, codes)
    information = information / np.minimum(amplified, MOST_AMPLIFIED)[:, None, None] ** 2
    corners = features[:, :8].reshape(-1, 4, 2)
    measured = agreeing(starts, corners, measured & (amplified < MOST_AMPLIFIED))
    colour = measure_colour(image, corners, measured, codes)
    classes = classify_flats(grey.shape, corners, measured, outlines, view, codes)
    field, field_n = field_levels(grey.astype(np.float64), classes)
    noise, noise_se = observe_noise(image, classes)
    return Observation(features, information, measured, misfit, colour, classes, field, field_n, noise, noise_se)


def observe_noise(image, classes):
    """Return (values, standard errors) of the noise features of an image (H, W, C) with the given flats."""
    planes = [np.ascontiguousarray(image[..., i], np.float64) for i in range(image.shape[2])]
    if len(planes) == 1:
        return noise_features(planes[0], None, None, classes)
    return noise_features(planes[1], planes[0], planes[2], classes)


def read_rgb(image_bgr):
    """Return (H, W, 3) or (H, W, 1), red first, scaled to 0..255, from an image as cv2.imread gives it."""
    if image_bgr.ndim == 2:
        image = image_bgr[..., None]
    else:
        image = cv2.cvtColor(image_bgr, cv2.COLOR_BGR2RGB)
    return image.astype(np.float32) / (257.0 if image.dtype == np.uint16 else 1.0)
