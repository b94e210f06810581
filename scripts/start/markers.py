"""Which markers photographs show, and whether they lie as on a ChArUco board, as in a grid or as on a known rig.

Ids tell: a board numbers its markers row by row, so that a number of columns gives each id a place; with the right one a
homography takes these places to where the markers are seen.
"""

from collections import Counter
from dataclasses import dataclass

import cv2
import numpy as np

from rig.plates import aruco_dictionary

FAMILIES = {  # the largest dictionary of each family, and those that are its beginning
    **{f"DICT_{n}X{n}_1000": (50, 100, 250, 1000) for n in (4, 5, 6, 7)},
    **dict.fromkeys(
        ("DICT_ARUCO_ORIGINAL", "DICT_ARUCO_MIP_36h12", "DICT_APRILTAG_36h11", "DICT_APRILTAG_36h10",
         "DICT_APRILTAG_25h9", "DICT_APRILTAG_16h5"), (),
    ),
}  # fmt: skip
MAX_COLUMNS = 40
SAMPLES = 10  # photographs in which all dictionaries are looked for
SMALLEST_SHARE = 0.3  # of the most frequent dictionary's markers, for another to be there as well
FITTING_SHARE = 0.7  # of the markers seen must lie where a layout has them
MIN_MARKERS = 4
MIN_AGREEING = 6  # in a photograph: four lie as on any board
SCREENED = 4  # photographs in which layouts compete
NEIGHBOURS = 6
SCREENING, THOROUGH = 60, 300  # tries of RANSAC
CORNERS_INSIDE_PX = 0.15  # of the truth: edges that are encoded by a curve are found too far within the dark
TOLERANCE = 0.3  # of a marker's side


@dataclass(frozen=True)
class Seen:
    """Markers seen once in one photograph: ids (n,) and corners (n, 4, 2), pixels; ``doubled`` are ids seen more often."""

    ids: np.ndarray
    quads: np.ndarray
    doubled: tuple = ()

    def centres(self):
        """Return where the diagonals cross (n, 2): what a homography does with a marker's centre."""
        a, b, c, d = (self.quads[:, k].astype(float) for k in range(4))
        u, v = c - a, d - b
        t = ((b - a)[:, 0] * v[:, 1] - (b - a)[:, 1] * v[:, 0]) / (u[:, 0] * v[:, 1] - u[:, 1] * v[:, 0])
        return a + t[:, None] * u

    def side(self):
        """Return the median side, pixels."""
        return float(np.median(np.linalg.norm(np.roll(self.quads, -1, axis=1) - self.quads, axis=2)))


@dataclass(frozen=True)
class Layout:
    """How well ids lie as on a board: ``kind`` charuco or grid; places are in squares, or from marker to marker.

    inliers  {id: number of photographs in which it lies where it should}
    shown    one bool a photograph: whether enough markers lie there as they should
    share    of all markers seen that lie where they should
    ratio    side of a marker over that of a square, or over the step of the grid
    """

    kind: str
    columns: int
    marker_at_corner: bool
    inliers: dict
    share: float
    ratio: float
    shown: tuple

    def rows(self):
        """Return the number of rows that were seen."""
        photographs = max(self.inliers.values())
        sure = [i for i, n in self.inliers.items() if n > (1 if photographs > 3 else 0)]
        last = int(places_of(self.kind, self.columns, self.marker_at_corner, np.array([max(sure)]))[0, 1])
        return last + 1 + (self.marker_at_corner and last % 2 == 0)


def detect(grey, dictionary):
    """Return the Seen of a grey image, uint8."""
    parameters = cv2.aruco.DetectorParameters()
    parameters.cornerRefinementMethod = cv2.aruco.CORNER_REFINE_SUBPIX
    quads, ids, _ = cv2.aruco.ArucoDetector(aruco_dictionary(dictionary), parameters).detectMarkers(grey)
    if ids is None:
        return Seen(np.zeros(0, int), np.zeros((0, 4, 2)))
    ids, quads = np.ravel(ids), np.array(quads).reshape(-1, 4, 2)
    once = [k for k in range(len(ids)) if (ids == ids[k]).sum() == 1]
    return Seen(ids[once], quads[once], tuple(sorted(set(ids.tolist()) - set(ids[once].tolist()))))


def dictionaries_seen(images):
    """Return {dictionary: [Seen of each image]} of the dictionaries that are there, the most frequent first.

    images  grey, uint8; some of them tell which dictionaries to look for in all
    """
    step = max(1, len(images) // SAMPLES)
    counts = {name: sum(len(detect(i, name).ids) for i in images[::step]) for name in FAMILIES}
    most = max(counts.values())
    there = [n for n, count in counts.items() if count >= max(SMALLEST_SHARE * most, MIN_MARKERS)]
    return {n: [detect(image, n) for image in images] for n in sorted(there, key=lambda n: -counts[n])}


def places_of(kind, columns, marker_at_corner, ids):
    """Return the places (n, 2) of markers' centres, y down from the top left: in squares, or in steps of a grid."""
    if kind == "grid":
        return np.stack([ids % columns, ids // columns], axis=1) + 0.5
    rows = 2 * (int(ids.max(initial=0)) // max(columns, 1) + 2)
    y, x = np.mgrid[:rows, :columns]
    with_marker = (x + y) % 2 == (0 if marker_at_corner else 1)
    return np.stack([x[with_marker], y[with_marker]], axis=1)[ids] + 0.5


def best_layout(seen):
    """Return the Layout that most markers agree with, None where no layout has enough of them.

    seen  list of Seen, one a photograph
    """
    many = [s for s in seen if len(s.ids) >= MIN_AGREEING]
    if not many:
        return None
    choices = [("grid", c, False) for c in range(2, MAX_COLUMNS)]
    choices += [("charuco", c, corner) for c in range(2, MAX_COLUMNS) for corner in (False, True)]
    few = sorted(many, key=lambda s: -len(s.ids))[:SCREENED]
    counts = {choice: sum(len(agreeing(s, places_of(*choice, s.ids), SCREENING)[0]) for s in few) for choice in choices}
    best = max(counts, key=counts.get)
    inliers, ratios, shown, total = Counter(), [], [], 0
    for s in seen:
        places = places_of(*best, s.ids)
        lying, _ = agreeing(s, places)
        shown.append(len(lying) >= MIN_AGREEING)
        total += len(s.ids) if len(s.ids) >= MIN_AGREEING else 0
        if shown[-1]:
            inliers.update(int(s.ids[k]) for k in lying)
            ratios += _sides(s, lying, places)
    share = sum(inliers.values()) / total
    if share < FITTING_SHARE:
        return None
    return Layout(*best, dict(inliers), share, float(np.median(ratios)), tuple(shown))


def agreeing(seen, places, tries=THOROUGH):
    """Return (indices of markers that a homography takes from their places (n, 2), y down, to where they are, it or None)."""
    if len(seen.ids) < MIN_MARKERS or np.linalg.matrix_rank(places - places.mean(axis=0)) < 2:
        return [], None
    H, mask = cv2.findHomography(places, seen.centres(), cv2.RANSAC, TOLERANCE * seen.side(), maxIters=tries)
    if H is None or np.linalg.det(H) <= 0:  # mirrored: no print is
        return [], None
    return list(np.flatnonzero(mask.ravel())), H


def _sides(seen, lying, places):
    """Return the sides of markers in units of their places, for corners that are found too far inside.

    Each is measured by what its nearest neighbours say of the scale: a bent lens has another one everywhere.
    """
    places, centres, sides = places[lying], seen.centres()[lying], []
    for k, index in enumerate(lying):
        near = np.argsort(np.linalg.norm(places - places[k], axis=1))[:NEIGHBOURS]
        known = np.column_stack([places[near], np.ones(len(near))])
        if np.linalg.matrix_rank(known) < 3:
            continue
        affine = np.linalg.lstsq(known, centres[near], rcond=None)[0][:2]
        edges = np.roll(seen.quads[index], -1, axis=0) - seen.quads[index]
        longer = 1 + 2 * CORNERS_INSIDE_PX / np.linalg.norm(edges, axis=1)
        sides += list(np.linalg.norm(edges @ np.linalg.inv(affine), axis=1) * longer)
    return [float(v) for v in sides if np.isfinite(v)]


def smallest_dictionary(name, markers):
    """Return the smallest dictionary of a family that has so many markers."""
    sizes = [size for size in FAMILIES[name] if size >= markers]
    return f"{name.rpartition('_')[0]}_{sizes[0]}" if sizes else name
