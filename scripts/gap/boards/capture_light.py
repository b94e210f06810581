"""What a board's own white and black tell of the light of a photograph (rig.light), and where in it they are."""

import cv2
import numpy as np
from scipy.optimize import least_squares

from gap.boards.board import polynomial_terms
from gap.fit.split import thinned
from rig.light import LIGHT, BoardPlace, lit
from rig.plates import white_cell_at

UNCURVED = 0.05  # prior of the second order: a lamp's light over a board, in logarithms
DARKEST, BRIGHTEST = 1e-3, 0.995  # of full scale: what is beyond is as good as cut off
FEWEST_POINTS = 6  # of a board, that say where the rest of it is
FEWEST_OF_ORDER = {1: 0, 2: 12, 3: 24}  # {order of a polynomial: points that tell it}
LATTICE = 90  # places along the board's longer side at which it is looked at
# From the nearest edge of a cell: less is blurred; the second where cells are too small for the first
CLEAR_PX = 2.0, 1.0
FEWEST_PLACES = 12  # of white, and of black, that tell a light
MAX_PLACES = 600  # of each, that are asked
ROUNDS_BEHIND = 5  # of a light behind a twin's effects
# How much a place's levels grow with its radiance, both in logarithms, is told where these moved so far, and is in this range
LEAST_MOVED, LONGEST_STEP, ELASTICITY = 0.01, 0.4, (0.25, 20.0)
SCATTER = 0.02  # of radiance, beyond which a place counts less: dirt, fingers, reflections


def first_light(shown, white, black):
    """Return the LIGHT (11,) without slope in which radiances ``shown`` (3 colours, 2) are those of white and black."""
    gain = np.maximum(shown[:, 0] - shown[:, 1], DARKEST) / (white - black)
    stray = shown[:, 1] - gain * black
    light = np.zeros(len(LIGHT))
    light[0] = np.log(gain[1])
    light[6:8] = np.log(gain[[0, 2]] / gain[1])
    light[8:] = stray[1], stray[0] - stray[1], stray[2] - stray[1]
    return light


def light_of(shown, reflectance, X, Y, free):
    """Return the LIGHT (11,) of radiances (n, 3) that places X, Y (n,) of known reflectance (n,) show.

    It is 0 where not ``free`` (11,). Robust least squares; the second order has a prior (UNCURVED).
    Raises ValueError where white or black is seen at too few places.
    """
    white, black = reflectance.max(initial=0.0), reflectance.min(initial=1.0)
    if min((reflectance == r).sum() for r in (white, black)) < FEWEST_PLACES or white == black:
        raise ValueError("too little white or black of the board is seen")
    medians = np.stack([np.median(shown[reflectance == r], axis=0) for r in (white, black)], axis=1)
    if (medians[:, 0] <= medians[:, 1]).any():
        raise ValueError("the board's white is darker than its black")
    kept = np.concatenate([thinned(np.flatnonzero(reflectance == r), MAX_PLACES) for r in (white, black)])
    shown, reflectance, X, Y = shown[kept], reflectance[kept], X[kept], Y[kept]
    light = np.where(free, first_light(medians, white, black), 0.0)

    def residuals(values):
        light[free] = values
        off = _radiated(light, reflectance, X, Y) - shown
        return np.concatenate([off.ravel() / SCATTER, light[3:6] / UNCURVED])

    fit = least_squares(residuals, light[free], loss="cauchy", x_scale=0.1, max_nfev=50)
    light[free] = fit.x
    return light


def _radiated(light, reflectance, X, Y):
    """Return the radiances (n, 3) of places X, Y (n,) of a reflectance (n,) in a LIGHT (11,)."""
    return lit(reflectance[None, :, None], light, X[None], Y[None])[0]


def photograph_light(image, scene, points, pixels, lut, free, twin=None):
    """Return the LIGHT (11,) in which a photograph (H, W, 1 or 3) shows a scene's board; ValueError as ``light_of``.

    points (p, 3) of the board and pixels (p, 2) as found; lut, grey levels of radiances from 0 to 1; free (11,) as there. Of a
    ``twin`` (LIGHT -> grey levels as the photograph's) whose effects change levels as well, the light behind them is sought: what
    the photograph shows less than the twin at a place, the light lacks there.
    """
    plate, radiances = scene.plates[0], np.linspace(0, 1, len(lut))
    levels, white, xy = seen_places(plate, points, pixels, image)
    reflectance, (X, Y) = np.where(white, scene.white, scene.black), BoardPlace(plate)(*xy.T)

    def made(light):
        return np.interp(seen_places(plate, points, pixels, twin(light))[0], lut, radiances)

    def radiated(light):
        return _radiated(light, reflectance, X, Y)

    def fitted(values):
        return light_of(values, reflectance, X, Y, free)

    shown = np.interp(levels, lut, radiances)
    light = fitted(shown)
    return light if twin is None else _light_behind(light, shown, made, radiated, fitted)


def _light_behind(light, shown, made, radiated, fitted):
    """Return the LIGHT (11,) for which ``made`` (LIGHT -> radiances (n, 3) behind effects) is nearest to ``shown``, from a light.

    radiated: LIGHT -> radiances (n, 3) before the effects; fitted: such radiances -> LIGHT. By secants of logarithms, place by
    place, as long as they come nearer; where black or white is cut off, nothing is told of how levels grow.
    """
    best, nearest, before, after, elasticity = light, np.inf, None, None, 1.0
    for _ in range(ROUNDS_BEHIND):
        here = made(light)
        if (off := np.abs(here - shown).mean()) >= nearest:
            break
        best, nearest = light, off
        last, before = before, np.log(np.maximum(radiated(light), DARKEST))
        earlier, after = after, np.log(np.clip(here, DARKEST, BRIGHTEST))
        if last is not None:
            inside = (np.minimum(after, earlier) > np.log(DARKEST)) & (np.maximum(after, earlier) < np.log(BRIGHTEST))
            told = inside & (np.abs(before - last) > LEAST_MOVED)
            elasticity = np.clip(
                np.divide(after - earlier, before - last, out=np.ones_like(after), where=told), *ELASTICITY
            )
        try:
            step = (np.log(np.clip(shown, DARKEST, BRIGHTEST)) - after) / elasticity
            light = fitted(np.exp(before + np.clip(step, -LONGEST_STEP, LONGEST_STEP)))
        except ValueError:  # as good as it gets
            break
    return best


def board_map(points, pixels):
    """Return (function of a board's (n, 2) metres -> pixels (n, 2), low, high (2,) of where it holds); None where it is unknown.

    From a board's points (p, 3) and pixels (p, 2), NaN where not seen: a polynomial about a homography follows a lens.
    """
    seen = np.isfinite(pixels).all(1)
    if seen.sum() < FEWEST_POINTS:
        return None
    order = max(k for k, least in FEWEST_OF_ORDER.items() if seen.sum() >= least)
    H, _ = cv2.findHomography(points[seen, :2], pixels[seen])
    if H is None:
        return None

    def mapped(xy):
        return cv2.perspectiveTransform(np.ascontiguousarray(xy[None], float), H)[0]

    flat = mapped(points[seen, :2])
    middle, size = flat.mean(0), max(flat.std(), 1e-9)
    fit = np.linalg.lstsq(polynomial_terms((flat - middle) / size, order), pixels[seen] - flat, rcond=None)[0]

    def to_pixels(xy):
        there = mapped(xy)
        return there + polynomial_terms((there - middle) / size, order) @ fit

    return to_pixels, points[seen, :2].min(0), points[seen, :2].max(0)


def seen_places(plate, points, pixels, image):
    """Return (levels (n, 3), is white (n,), xy (n, 2) metres) of places well inside a board's cells that a photograph shows.

    plate is the nominal board's, points (p, 3) and pixels (p, 2) of it as found, image (H, W, 1 or 3) grey levels. Empty
    where too little of the board is seen.
    """
    found = board_map(points, pixels)
    if found is None:
        return np.zeros((0, 3)), np.zeros(0, bool), np.zeros((0, 2))
    to_pixels, low, high = found
    step = (high - low).max() / LATTICE
    lattice = np.meshgrid(*(np.arange(a + step / 2, b, step) for a, b in zip(low, high, strict=True)))
    xy = np.stack(lattice, axis=-1).reshape(-1, 2)
    here = to_pixels(xy)
    height, width = image.shape[:2]
    ok = ((here >= 1) & (here <= [width - 2, height - 2])).all(1)
    px_m = step / np.maximum(np.abs(to_pixels(xy + step) - here).min(1), 1e-6)  # metres a pixel
    colour = white_cell_at(plate, *xy.T)
    for clear_px in CLEAR_PX:
        inside = ok & _is_even(plate, xy, clear_px * px_m)
        if min((colour[inside] == white).sum() for white in (True, False)) >= FEWEST_PLACES:
            break
    u, v = here[inside].round().astype(int).T
    levels = np.broadcast_to(image[v, u], (len(u), 3))  # grey images have one channel
    return levels, colour[inside], xy[inside]


def _is_even(plate, xy, clear_m):
    """Return whether a board has one colour (n,) within ``clear_m`` (n,) of its points (n, 2), metres."""
    about = [clear_m[:, None] * [dx, dy] for dx in (-1, 0, 1) for dy in (-1, 0, 1)]
    return np.all([white_cell_at(plate, *(xy + step).T) == white_cell_at(plate, *xy.T) for step in about], axis=0)
