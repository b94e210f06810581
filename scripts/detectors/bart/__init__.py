"""BART: a fast marker detector with exact corners, after what is published of the Bielefeld tracker.

Single images: ``make_detector(dictionaries).detect(image)``. Sequences: ``tracker.Tracker``. The pieces:
regions.py (dark regions), quads.py (quadrilaterals), codes.py (bit matrices), small.py (codes of mixed cells), edges.py
(exact corners), reading.py (quadrilaterals to markers), sightings.py (places seen twice), tracker.py.
"""

from concurrent.futures import ThreadPoolExecutor

import cv2
import numpy as np

from detectors.bart.codes import NO_CODE, code_tables
from detectors.bart.edges import identity, move_sides, refine_quad, spread_of_white, srgb_to_linear
from detectors.bart.quads import RETRY_PX, SMALLEST_PX, quads_of, search_boxes
from detectors.bart.reading import read_quads
from detectors.bart.regions import candidates, components
from detectors.bart.sightings import best_of_each, not_inside
from detectors.bart.small import fit_small
from detectors.contract import Detection, grey_image

PARAMETERS = {
    # "mean": dark is darker than its surroundings: bears uneven light. "otsu": one level for the whole image:
    # faster, but loses markers in shade. "both": what either finds, at the cost of both.
    "threshold": "mean",
    # Side of the surroundings, pixels of the searched level: wider closes the frames of large blurred markers
    # and merges markers with dark neighbours.
    "window_px": 15,
    # How much darker than its surroundings, grey levels: more ignores noise and loses faint markers.
    "offset_dn": 7,
    # Search a shrunken image first, and finer only where a small region was not read: several times faster.
    # False searches at full resolution only, and misses what only a magnified look can read (finer_levels).
    "multi_scale": True,
    # Largest image that is searched whole, in megapixels; larger ones are halved until they fit. More finds
    # smaller markers and costs time in proportion.
    "coarse_mpx": 0.8,
    # How many levels finer a small unread region is looked at, the finest being twice the image's resolution. Each
    # halves the size of the smallest markers and costs a tenth more time, in textured images a quarter.
    "finer_levels": 1,
    # Smallest contrast between paper and frame, grey levels: less reads fainter markers and more clutter.
    "contrast_dn": 15.0,
    # Wrong bits forgiven, if the dictionary's distance allows them with one to spare: more reads occluded and
    # noisy codes and raises the risk of a false id. DICT_ARUCO_ORIGINAL's distance never allows any.
    "wrong_bits": 1,
    # Corners fitted to the edges; False leaves them as the search found them: faster, ten times less exact.
    "exact_corners": True,
    # Light behind the grey levels: "srgb" or "linear", or "auto": the one of the two in which white spreads less
    # over black within the codes of this image, then all sides moved by what is left of it. "auto" takes out tone
    # curves and ink spread alike, so that corners are those of the design; the others keep what print and camera
    # really show.
    "light": "auto",
}

MIN_MODULE_PX = 5.0  # modules from which the spread of white is measured: smaller ones have no flat inside
SPREAD_MARKERS = 2  # so many of the largest are enough: each tells the spread to a few thousandths of a pixel
REGIONS_AT_ONCE = 16  # regions between two looks at the clock
SHARED_PARTS = 4  # of an image, for two threads: more even their work out, each costs some fifty microseconds
OTHER_LIGHT_PX = 0.15  # a spread that no sRGB image with ink on paper shows: tried again as linear light

_SECOND_THREAD = ThreadPoolExecutor(max_workers=1)


class Bart:
    """BART on single images: no memory of earlier ones. Safe to use from several threads at once."""

    def __init__(self, dictionaries, parameters):
        self.p = parameters
        self.groups = code_tables(dictionaries)
        self.grey = self.other_light = identity()
        self.light = identity() if parameters["light"] == "linear" else srgb_to_linear()
        self.detect(np.full((64, 64), 128, np.uint8))  # compiles, or loads what was compiled

    def detect(self, image):
        """Return the Detections of an image (grey or colour, see contract.grey_image)."""
        grey = grey_image(image)
        if min(grey.shape) < 8:
            return []  # smaller than a marker's modules
        found = self.search(grey)
        return self.finish(grey, found, self.light_of(grey, found))

    def search(self, grey):
        """Return the readable quads of an image, as a list of dicts: corners, name, id, wrong, contrast, size, code.

        Two threads share the parts where OpenCV may use two (cv2.setNumThreads): the same findings as of one.
        """
        pyramid, wholes = self._coarse(grey)
        parts = [(dark, some) for dark, regions in wholes for some in np.array_split(regions, SHARED_PARTS)]
        return best_of_each(_in_two_threads(lambda *part: self._search_part(grey, pyramid, *part, []), parts))

    def search_in_steps(self, grey):
        """Yield what a search has found so far after each step of a millisecond or less, at last all.

        Some places may have been seen twice (see best_of_each).
        """
        found = []
        pyramid, parts = self._coarse(grey)
        yield found
        for dark, regions in parts:
            for k in range(0, len(regions), REGIONS_AT_ONCE):
                found += self._search_part(grey, pyramid, dark, regions[k : k + REGIONS_AT_ONCE], found)
                yield found

    def _coarse(self, grey):
        """Return (pyramid of images, list of (binary image, regions) of its coarsest, one a way to binarise)."""
        level = 0
        if self.p["multi_scale"]:
            while grey.size >> (2 * level) > 1e6 * self.p["coarse_mpx"]:
                level += 1
        pyramid = [grey]
        for _ in range(level):
            pyramid.append(_halved(pyramid[-1]))
        methods = [m for m in ("mean", "otsu") if self.p["threshold"] in (m, "both")]
        return pyramid, [self._regions(pyramid[-1], method) for method in methods]

    def _search_part(self, grey, pyramid, dark, regions, known):
        """Return the findings among some regions of the coarsest image and, where those are small, in finer ones.

        known  findings so far, within which nothing is looked for again
        """
        quads, boxes = quads_of(regions, dark)
        found = self.read(grey, _to_full(quads - 1, len(pyramid) - 1))
        if self.p["multi_scale"]:
            found += self._search_finer(grey, pyramid, boxes - 1, known + found)
        return found

    def _search_finer(self, grey, pyramid, boxes, known):
        """Look again where a small region was not read: one level finer each time, in the end twice magnified."""
        more = []
        coarse = len(pyramid) - 1
        for level in range(coarse, max(coarse - self.p["finer_levels"], -1), -1):
            boxes = not_inside(boxes * 2**level, known + more)
            quads, rest = search_boxes(
                pyramid[max(level - 1, 0)],
                boxes // 2 ** max(level - 1, 0),
                level == 0,
                self.p["window_px"] | 1,
                np.float32(self.p["offset_dn"]),
                self.p["contrast_dn"],
            )
            more += self.read(grey, _to_full(quads, max(level - 1, 0)))
            boxes = rest
        return more

    def _dark(self, small, method):
        """Return the binary image of what is dark, with a border of zeros and rows of whole words."""
        h, w = small.shape
        padded = np.zeros((h + 2, (w + 2 + 7) // 8 * 8), np.uint8)
        dark = padded[1 : h + 1, 1 : w + 1]
        if method == "otsu":
            cv2.threshold(small, 0, 255, cv2.THRESH_BINARY_INV | cv2.THRESH_OTSU, dst=dark)
        else:
            # The same as cv2.adaptiveThreshold, in half its time.
            side = self.p["window_px"] | 1
            above = cv2.blur(small, (side, side), borderType=cv2.BORDER_REPLICATE)
            cv2.subtract(above, small, dst=above)
            cv2.threshold(above, self.p["offset_dn"] - 1, 255, cv2.THRESH_BINARY, dst=dark)
        return padded

    def _regions(self, small, method):
        """Return (binary image, its dark regions that may be markers: quads.candidates)."""
        dark = self._dark(small, method)
        return dark, candidates(components(dark.view(np.uint64)), SMALLEST_PX, max(small.shape))

    def read(self, grey, quads):
        """Return the findings (dicts, see search) among quads (n, 4, 2), pixels of ``grey``."""
        found = []
        for group in self.groups:
            corners, owner, wrong, contrast, fitted = read_quads(
                grey,
                self.grey,
                self.light,
                quads,
                group["size"],
                group["words"],
                group["owner"],
                group["wrong_bits"],
                float(self.p["contrast_dn"]),
                self.p["wrong_bits"],
                self.p["exact_corners"],
            )
            for k in range(len(corners)):
                found.append(
                    {
                        "corners": corners[k],
                        "name": group["names"][owner[k, 0]],
                        "id": int(owner[k, 1]),
                        "wrong": int(wrong[k]),
                        "contrast": float(contrast[k]),
                        "size": group["size"],
                        "code": None if fitted[k] == NO_CODE else group["words"][fitted[k]],
                    }
                )
        return found

    def search_near(self, grey, quad, reach):
        """Return the findings in the box round a quad (4, 2), widened on each side by ``reach`` times its size."""
        low, high = quad.min(axis=0), quad.max(axis=0)
        pad = reach * (high - low).max() + 8
        x0, y0 = np.maximum(np.floor(low - pad), 0).astype(int)
        x1, y1 = np.minimum(np.ceil(high + pad) + 1, grey.shape[::-1]).astype(int)
        if x1 - x0 < 8 or y1 - y0 < 8:
            return []
        level = int(self.p["multi_scale"] and (high - low).max() > 2 * RETRY_PX)
        crop = grey[y0:y1, x0:x1]
        dark, regions = self._regions(_halved(crop) if level else np.ascontiguousarray(crop), "mean")
        quads, _ = quads_of(regions, dark)
        return self.read(grey, _to_full(quads - 1, level) + (x0, y0))

    def light_of(self, grey, found):
        """Return (light table (256,), spread of white in pixels) of an image, from its findings."""
        if not (found and self.p["exact_corners"] and self.p["light"] == "auto"):
            return self.light, 0.0
        corners = np.stack([f["corners"] for f in found])
        sizes = np.array([f["size"] for f in found])
        spread = spread_of_white(grey, self.light, corners, sizes, MIN_MODULE_PX, SPREAD_MARKERS)
        if abs(spread) < OTHER_LIGHT_PX:
            return self.light, spread
        for k in range(len(found)):
            refine_quad(grey, self.other_light, corners[k].copy(), sizes[k], 2, corners[k])
        other = spread_of_white(grey, self.other_light, corners, sizes, MIN_MODULE_PX, SPREAD_MARKERS)
        return (self.other_light, other) if abs(other) < abs(spread) else (self.light, spread)

    def finish(self, grey, found, light_and_spread):
        """Return Detections whose corners are measured in that light, free of that spread (see light_of)."""
        light, spread = light_and_spread or (self.light, 0.0)
        detections = []
        for f in found:
            corners = f["corners"].copy()
            if light is not self.light:
                refine_quad(grey, light, corners.copy(), f["size"], 2, corners)
                if f["code"] is not None:
                    fit_small(grey, light, corners, f["size"], f["code"])
            if spread:
                move_sides(corners, spread)
            detections.append(Detection(f["name"], f["id"], corners))
        return detections


def _halved(grey):
    h, w = grey.shape[0] // 2, grey.shape[1] // 2
    return cv2.resize(grey[: 2 * h, : 2 * w], (w, h), interpolation=cv2.INTER_AREA)


def _to_full(points, level):
    """Return points of a pyramid level in pixels of the image; a pixel there lies amid those that it is the mean of."""
    return (points + 0.5) * 2**level - 0.5


def _in_two_threads(function, parts):
    """Return the lists function(*part) of all parts, joined in their order; each thread takes the next that is left."""
    results = [()] * len(parts)
    waiting = iter(enumerate(parts))

    def work():
        for k, part in waiting:
            results[k] = function(*part)

    other = _SECOND_THREAD.submit(work) if cv2.getNumThreads() > 1 else None
    work()
    if other is not None and not other.cancel():  # else it was busy all the time, or is gone in a forked process
        other.result()
    return [found for some in results for found in some]


def make_detector(dictionaries, **parameters):
    """Return BART for single images; ValueError for a value that is not allowed."""
    p = {**PARAMETERS, **parameters}
    if p["threshold"] not in ("mean", "otsu", "both"):
        raise ValueError(f"threshold is mean, otsu or both, not {p['threshold']!r}")
    if p["light"] not in ("auto", "srgb", "linear"):
        raise ValueError(f"light is auto, srgb or linear, not {p['light']!r}")
    if p["window_px"] < 3 or p["coarse_mpx"] <= 0 or p["wrong_bits"] < 0 or p["finer_levels"] < 0:
        raise ValueError("window_px is at least 3, coarse_mpx positive, wrong_bits and finer_levels not negative")
    return Bart(dictionaries, p)
