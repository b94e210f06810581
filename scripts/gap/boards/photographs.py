"""One camera's photographs of a board as a problem: patches of known cells, drawn and measured one by one."""

from dataclasses import dataclass

import numpy as np

from effects import pipeline
from gap.boards.board import on_board
from gap.boards.capture_light import board_map
from gap.measure.capture import COARSE_TO_FINE, Codes, grey_of, measure_plates, states_at
from gap.measure.places import large_enough
from gap.problem import Case, encoding_table
from rig.geometry import N_POSE
from rig.light import BoardPlace, lit

WORST_MISFIT = 0.35  # of the contrast, that a fit of a patch may leave: hands shake, paper bends
MAX_PATCHES = 12  # of a photograph, that are looked at: more cost time and tell little more


@dataclass
class PhotographsCase(Case):
    """Photographs of a board whose cells are measured patch by patch; rig.patches.Patch in ``patches``."""

    patches: list = None

    def __post_init__(self):
        self.corners = np.array([patch.corners for patch in self.patches])
        self.place = BoardPlace(self.scene.plates[0])

    def scene_of(self, effects):
        """Return (scene, corners of the patches' codes (p, 4, 3)) of the twin with these effects."""
        scene = pipeline.scene_with_effects(self.scene, effects)
        return scene, on_board(scene, self.scene, self.corners)

    def lit(self, radiance, light, x, y):
        """Return the radiance (rows, columns, 3) under a capture's light, LIGHT (11,), at world x and y (rows, columns)."""
        return lit(radiance, light, *self.place(x, y))

    def patches_in(self, starts, width, height, most):
        """Return the indices (k,) of so many patches at most, spread over those whose codes (p, 4, 2) a frame shows well."""
        shown = np.flatnonzero(large_enough(starts, width, height))
        return spread_out(self.corners[shown].mean(axis=1), shown, most)

    def patches_seen(self, image, starts):
        """Return (indices (k,), features (k, 19)) of MAX_PATCHES patches at most, spread over what an image (H, W, C) shows."""
        wanted = self.patches_in(starts, image.shape[1], image.shape[0], MAX_PATCHES)
        tried = np.isin(np.arange(len(starts)), wanted)
        states = states_at(np.nan_to_num(starts), self.codes)
        features, _, measured = measure_plates(grey_of(image), states, tried, self.codes, COARSE_TO_FINE)
        return np.flatnonzero(measured), features[measured]


def spread_out(places, names, most):
    """Return at most so many of names (n,), whose places (n, 3) lie far from one another: each next the farthest of all."""
    if len(names) <= most:
        return names
    taken = [int(np.argmin(((places - places.mean(0)) ** 2).sum(1)))]
    while len(taken) < most:
        away = ((places[:, None] - places[taken]) ** 2).sum(2).min(1)
        taken.append(int(np.argmax(away)))
    return names[sorted(taken)]


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
    return PhotographsCase(campaign, camera, scene, codes, captures, np.full(N_POSE, np.inf), patches=patches)
