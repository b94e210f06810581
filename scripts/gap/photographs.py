"""One camera's photographs of a board as a problem: patches of known cells are measured, each capture's light is its own.

What nobody knows of a photograph (exposure, white balance, lamps, stray light; rig.light) is a nuisance of the capture, as
its pose is. First order is free, second order has a prior: free, it would hide a lens's fall-off in a frontal board.
"""

from dataclasses import dataclass

import numpy as np

from effects import library, pipeline
from gap.board import on_board, polynomial_terms
from gap.capture_light import SIGMA_LIGHT, board_map, first_light
from gap.measure.capture import COARSE_TO_FINE, N_GROUND, Codes, grey_of, measure_plates, observe, states_at
from gap.measure.places import large_enough
from gap.measure.plate import FEATURES
from gap.problem import Case, encoding_table
from gap.residuals import LOST_PLATE, RHO_NOISE, rho
from gap.score import MIN_FLOOR
from rig.geometry import N_POSE
from rig.light import LIGHT, BoardPlace, lit

WORST_MISFIT = 0.35  # of the contrast, that a fit of a patch may leave: hands shake, paper bends
SMOOTH = ("corners", "levels", "edges", "colour")  # groups whose floor is their roughness
SEEN_FROM_ANYWHERE = ("levels", "edges", "colour")  # a print's faults there are the same in all captures
FEWEST_PATCHES = 10  # of a capture, that show how rough it is
MAX_PATCHES = 12  # of a photograph, that are looked at: more cost time and tell little more
MIN_SHARE_TOLD = 0.15  # of what captures tell of an effect, that their own poses and light must leave
LIKE_LIGHT = "each photograph's own light, exposure and white balance would show the same"
ONLY_REPEATS = "only repeats of a station would tell it from noise"


@dataclass
class PhotographsCase(Case):
    """Photographs of a board whose cells are measured patch by patch; rig.patches.Patch in ``patches``."""

    is_board = True
    patches: list = None
    given: tuple = ()  # effects [(name, parameters)] that tell where points are: found before

    def __post_init__(self):
        self.corners = np.array([patch.corners for patch in self.patches])
        self.place = BoardPlace(self.scene.plates[0])

    def scene_of(self, effects):
        """Return (scene, prints, corners of the patches' codes (p, 4, 3)) of the twin with these effects."""
        scene = pipeline.scene_with_effects(self.scene, effects)
        return scene, self._prints_of(scene), on_board(scene, self.scene, self.corners)

    def rims_of(self, effects):
        """Return how far patches reach beyond the nominal ones (p,): paper has no end."""
        return np.zeros(len(self.patches))

    def places(self):
        """Return (names, centres (p, 3), normals (p, 3)) of the patches, metres."""
        centres = self.corners.mean(axis=1)
        return [patch.name for patch in self.patches], centres, np.tile([0.0, 0.0, 1.0], (len(centres), 1))

    def lit(self, radiance, light, x, y):
        """Return the radiance (rows, columns, 3) under a capture's light, LIGHT (11,), at world x and y (rows, columns)."""
        return lit(radiance, light, *self.place(x, y))

    def start_pose(self, i):
        """Return (17,): the pose of view i, and the light that its patches' white and black show of themselves."""
        return np.concatenate([np.zeros(N_POSE), self._first_light(self.captures[i].observation)])

    def _first_light(self, observation):
        """Return LIGHT (11,) of an observation by the medians of its white and black."""
        seen = observation.measured
        if not seen.any():
            return np.zeros(len(LIGHT))
        white, black = (np.median(observation.features[seen, FEATURES.index(n)]) for n in ("white", "black"))
        of_colour = np.median(observation.colour[seen], axis=0)
        levels = self.codes.nominal_dn[:2] + [white, black]
        shown = np.array([levels + of_colour[:2], levels, levels + of_colour[5:7]])  # red, green, blue x white, black
        shown[1] = 3 * levels - shown[0] - shown[2]  # the mean is what is measured
        radiance = np.interp(shown, self.codes.lut, np.linspace(0, 1, len(self.codes.lut)))
        return first_light(radiance, *self.codes.levels[:2])

    def floors_of(self, groups):
        """Return {group: floor} of captures' residual groups: how far patches lie apart from their neighbours."""
        floors = {}
        for name in SMOOTH:
            seen = {i: (np.flatnonzero(self.captures[i].observation.measured), g[name]) for i, g in groups.items()}
            rough = roughness(self.corners.mean(axis=1)[:, :2], seen, with_cells=name in SEEN_FROM_ANYWHERE)
            if rough is not None:
                floors[name] = max(rough, MIN_FLOOR[name])
        return floors

    def observe_photograph(self, capture, image, starts):
        """Measure a photograph (H, W, C) from where the patches' codes (p, 4, 2) are expected, NaN where they are not."""
        wanted = large_enough(starts, capture.view.width, capture.view.height)

        def no_regions(corners, measured):
            return np.zeros((2 * N_GROUND, 4), int)

        found = observe(image, np.nan_to_num(starts), wanted, self.codes, COARSE_TO_FINE, no_regions)
        capture.observation, capture.noise_variance = found
        capture.starts = library.starts_seen(image)

    def patches_seen(self, image, starts):
        """Return (indices (k,), features (k, 19)) of MAX_PATCHES patches at most, spread over what an image (H, W, C) shows."""
        wanted = np.flatnonzero(large_enough(starts, image.shape[1], image.shape[0]))
        wanted = spread_out(self.corners[wanted].mean(axis=1), wanted, MAX_PATCHES)
        tried = np.isin(np.arange(len(starts)), wanted)
        states = states_at(np.nan_to_num(starts), self.codes)
        features, _, measured, _ = measure_plates(grey_of(image), states, tried, self.codes, COARSE_TO_FINE)
        return np.flatnonzero(measured), features[measured]

    def thin(self):
        """Look at MAX_PATCHES patches of each photograph at most, spread over what it shows of the board."""
        for capture in self.captures:
            seen = np.flatnonzero(capture.observation.measured)
            kept = np.zeros(len(self.patches), bool)
            kept[spread_out(self.corners[seen].mean(axis=1), seen, MAX_PATCHES)] = True
            capture.observation.measured &= kept


def spread_out(places, names, most):
    """Return at most so many of names (n,), whose places (n, 3) lie far from one another: each next the farthest of all."""
    if len(names) <= most:
        return names
    taken = [int(np.argmin(((places - places.mean(0)) ** 2).sum(1)))]
    while len(taken) < most:
        away = ((places[:, None] - places[taken]) ** 2).sum(2).min(1)
        taken.append(int(np.argmax(away)))
    return names[sorted(taken)]


def roughness(places, seen, with_cells):
    """Return the robust standard deviation of residuals about a smooth map of each capture, None where too few are seen.

    places (p, 2), metres; seen {capture: (plates (n,), residuals (n, k))}. The map is of second order; what a cell of the board
    shows in all captures alike is taken out as well ``with_cells``: the print's own faults.
    """
    size = np.ptp(places, axis=0).max() / 2
    xy = (places - places.mean(0)) / size
    left, of_cell, freedom = [], [], 0
    for plates, y in seen.values():
        y = np.where((y == LOST_PLATE).all(axis=1, keepdims=True), np.nan, y)
        ok = np.isfinite(y).all(axis=1)
        terms = polynomial_terms(xy[plates[ok]], 2)
        if ok.sum() < FEWEST_PATCHES:
            continue
        left.append(y[ok] - terms @ np.linalg.lstsq(terms, y[ok], rcond=None)[0])
        of_cell.append(plates[ok])
        freedom += ok.sum() - terms.shape[1]
    if not left:
        return None
    left, of_cell = np.concatenate(left), np.concatenate(of_cell)
    if with_cells:
        for cell in np.unique(of_cell):
            left[of_cell == cell] -= np.median(left[of_cell == cell], axis=0)
        freedom -= len(np.unique(of_cell))
    return float(np.sqrt(rho(left).mean() / RHO_NOISE * len(left) / freedom)) if freedom > 0 else None


def expected_corners(points, pixels, patches):
    """Return where patches' codes (p, 4, 2) lie in a photograph by a board's points (n, 3) and pixels (n, 2), NaN if not seen.

    Beyond the outermost points by no more than a patch.
    """
    corners, found = np.array([patch.corners for patch in patches]), board_map(points, pixels)
    if found is None:
        return np.full((len(patches), 4, 2), np.nan)
    to_pixels, low, high = found
    out = to_pixels(corners.reshape(-1, 3)[:, :2]).reshape(corners.shape[0], 4, 2)
    side = max(2 * patch.half_patch for patch in patches)
    near = ((corners[..., :2] >= low - side) & (corners[..., :2] <= high + side)).all((1, 2))
    return np.where(near[:, None, None], out, np.nan)


def competing(search, base, names):
    """Return (names of effects that can compete, {name: why it does not} of the others) beside a base Twin of photographs."""
    moving = {n for n in names if library.is_pure_geometry(n)}
    why = {n: ONLY_REPEATS for n in names if library.needs_repeats(n)}
    shares = search.shares_told(base, [n for n in names if n not in moving | set(why) | set(base.names)])
    why |= {n: LIKE_LIGHT for n, share in shares.items() if share < MIN_SHARE_TOLD}
    return [n for n in shares if n not in why], why


def photographs_case(campaign, camera, scene, captures, patches):
    """Return the PhotographsCase of captures [gap.problem.Capture] whose views have the poses from which fits start.

    scene is that of the nominal board, patches are rig.patches.Patch.
    """
    view = captures[0].view
    codes = Codes.of_squares(
        np.array([p.half_code for p in patches]),
        np.array([p.half_patch for p in patches]),
        [p.black for p in patches],
        [scene.white, scene.black, scene.white],
        encoding_table(view.encoding, view.exposure),
        beyond=10 * max(p.half_patch for p in patches),
        worst_misfit=WORST_MISFIT,
    )
    sigma = np.concatenate([np.full(N_POSE, np.inf), SIGMA_LIGHT])
    return PhotographsCase(campaign, camera, scene, codes, captures, sigma, patches=patches)
