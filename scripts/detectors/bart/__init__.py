"""BART: a fast marker detector with exact corners, after what is published of the Bielefeld tracker.

Single images: ``make_detector(dictionaries).detect(image)``. Sequences: ``tracker.Tracker``. The pieces:
quads.py (dark regions to quadrilaterals), codes.py (bit matrices), edges.py (exact corners), tracker.py.
"""

import cv2
import numpy as np
from numba import njit

from detectors.bart.codes import (
    NO_CODE,
    code_tables,
    frame_contrast,
    frame_errors,
    match_word,
    read_levels,
    read_word,
)
from detectors.bart.edges import exact_corners, identity, refine_quad, srgb_to_linear
from detectors.bart.quads import find_quads
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
    # False searches at full resolution only, and misses what only a magnified look can read.
    "multi_scale": True,
    # Largest image that is searched whole, in megapixels; larger ones are halved until they fit. More finds
    # smaller markers and costs time in proportion.
    "coarse_mpx": 0.8,
    # Smallest contrast between paper and frame, grey levels: less reads fainter markers and more clutter.
    "contrast_dn": 15.0,
    # Wrong bits forgiven, if the dictionary's distance allows them with one to spare: more reads occluded and
    # noisy codes and raises the risk of a false id. DICT_ARUCO_ORIGINAL's distance never allows any.
    "wrong_bits": 1,
    # Corners fitted to the edges; False leaves them as the search found them: faster, ten times less exact.
    "exact_corners": True,
    # Light behind the grey levels: "srgb", "linear", or "auto": the mixture that makes edges symmetric.
    "light": "auto",
}


@njit(cache=True, nogil=True)
def read_quads(image, light, quads, size, words, owner, wrong_bits, least_contrast, most_wrong):
    """Return (corners float64 (m, 4, 2), owner int32 (m, 3), distance int32 (m,), contrast (m,)) of readable quads.

    quads  float64 (n, 4, 2), pixels of ``image``; corners come in the marker's own order.
    """
    n = len(quads)
    corners = np.empty((n, 4, 2))
    found = np.empty((n, 3), np.int32)
    distance = np.empty(n, np.int32)
    contrasts = np.empty(n)
    levels = np.empty((size + 4, size + 4))
    plane = np.empty(3)
    margins = np.empty(size * size)
    refined = np.empty((4, 2))
    m = 0
    for k in range(n):
        module = read_levels(image, quads[k], size, levels)
        if module == 0 or frame_contrast(levels, plane, 0.6 * least_contrast) == 0:
            continue
        worked, _ = refine_quad(image, light, quads[k], size, 2, refined)
        if worked:
            module = read_levels(image, refined, size, levels)
        contrast = frame_contrast(levels, plane, least_contrast)
        if contrast == 0 or frame_errors(levels, plane) > 1:
            continue
        entry, wrong = NO_CODE, 65
        for trial in range(3):
            if trial > 0 and module > 6:
                break
            word = read_word(levels, plane, contrast, 0.25 * trial, margins)
            entry, wrong = match_word(word, margins, words, owner, wrong_bits, most_wrong if trial == 0 else 0, 0.6)
            if entry != NO_CODE:
                break
        if entry == NO_CODE:
            continue
        turn = owner[entry, 2]
        for c in range(4):
            corners[m, c] = refined[(c + turn) % 4]
        found[m] = owner[entry]
        distance[m] = wrong
        contrasts[m] = contrast
        m += 1
    return corners[:m], found[:m], distance[:m], contrasts[:m]


class Bart:
    """BART on single images: no memory of earlier ones. Safe to use from several threads at once."""

    def __init__(self, dictionaries, parameters):
        self.p = parameters
        self.groups = code_tables(dictionaries)
        self.srgb, self.linear = srgb_to_linear(), identity()
        self.share = {"linear": 0.0, "srgb": 1.0, "auto": -1.0}[parameters["light"]]
        self.detect(np.full((64, 64), 128, np.uint8))  # compiles, or loads what was compiled

    def detect(self, image):
        """Return the Detections of an image (grey or colour, see contract.grey_image)."""
        grey = grey_image(image)
        if min(grey.shape) < 8:
            return []  # smaller than a marker's modules
        return self.finish(grey, self.search(grey))

    def search(self, grey):
        """Return the readable quads of an image, as a list of dicts: corners, name, id, wrong, contrast, size."""
        level = 0
        if self.p["multi_scale"]:
            while grey.size >> (2 * level) > 1e6 * self.p["coarse_mpx"]:
                level += 1
        small = _shrunk(grey, level)
        found, boxes = self._search_level(grey, small, 0.5**level, (0, 0))
        if self.p["multi_scale"]:
            found += self._search_finer(grey, boxes, level, found)
        return _best_of_each(found)

    def _search_level(self, grey, small, scale, origin):
        """Search one level; ``scale`` is its pixels per pixel of ``grey``, ``origin`` (x, y) its place there."""
        found, boxes = [], []
        for method in ("mean", "otsu"):
            if self.p["threshold"] in (method, "both"):
                quads, rest = self._quads(small, method)
                # Pixel centres: (0, 0) of a level lies amid the pixels that it is the mean of.
                quads = (quads + 0.5) / scale - 0.5 + np.array(origin)
                found += self._read(grey, quads)
                boxes.append((rest + np.array([0, 0, 1, 1])) / scale + np.array([*origin, *origin]))
        return found, np.concatenate(boxes)

    def _quads(self, small, method):
        h, w = small.shape
        padded = np.zeros((h + 2, (w + 2 + 7) // 8 * 8), np.uint8)
        dark = padded[1 : h + 1, 1 : w + 1]
        if method == "mean":
            cv2.adaptiveThreshold(
                small,
                255,
                cv2.ADAPTIVE_THRESH_MEAN_C,
                cv2.THRESH_BINARY_INV,
                self.p["window_px"] | 1,
                self.p["offset_dn"],
                dst=dark,
            )
        else:
            cv2.threshold(small, 0, 255, cv2.THRESH_BINARY_INV | cv2.THRESH_OTSU, dst=dark)
        quads, boxes = find_quads(padded, padded.view(np.uint64), 6, max(h, w))
        return quads - 1, boxes - 1

    def _read(self, grey, quads):
        found = []
        for group in self.groups:
            corners, owner, wrong, contrast = read_quads(
                grey,
                self.srgb,
                quads,
                group["size"],
                group["words"],
                group["owner"],
                group["wrong_bits"],
                float(self.p["contrast_dn"]),
                self.p["wrong_bits"],
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
                    }
                )
        return found

    def _search_finer(self, grey, boxes, level, found):
        """Look again, one level finer, where a small region was not read; twice magnified at the finest."""
        more = []
        centres = np.array([f["corners"].mean(axis=0) for f in found]).reshape(-1, 2)
        rows, columns = grey.shape
        for x0, y0, x1, y1 in boxes:
            side = max(x1 - x0, y1 - y0)
            if side > 48 * 2**level:
                continue
            if len(centres):
                inside = (centres > (x0, y0)) & (centres < (x1, y1))
                if inside.all(axis=1).any():
                    continue
            pad = 4 * 2**level
            a, b = int(max(x0 - pad, 0)), int(max(y0 - pad, 0))
            c, d = int(min(x1 + pad + 1, columns)), int(min(y1 + pad + 1, rows))
            crop = grey[b:d, a:c]
            if level > 0:
                crop, scale = _shrunk(crop, level - 1), 0.5 ** (level - 1)
            else:
                crop, scale = cv2.resize(crop, None, fx=2, fy=2, interpolation=cv2.INTER_CUBIC), 2.0
            if min(crop.shape) < 8:
                continue
            more += self._search_level(grey, crop, scale, (a, b))[0]
        return more

    def finish(self, grey, found):
        """Return Detections with exact corners."""
        if found and self.p["exact_corners"]:
            corners = np.stack([f["corners"] for f in found])
            sizes = np.array([f["size"] for f in found])
            exact_corners(grey, self.linear, self.srgb, corners, sizes, self.share)
            for f, c in zip(found, corners, strict=True):
                f["corners"] = c
        return [Detection(f["name"], f["id"], f["corners"]) for f in found]


def _shrunk(grey, level):
    for _ in range(level):
        h, w = grey.shape[0] // 2, grey.shape[1] // 2
        grey = cv2.resize(grey[: 2 * h, : 2 * w], (w, h), interpolation=cv2.INTER_AREA)
    return grey


def _best_of_each(found):
    """Return the findings without second sightings of one place: fewer wrong bits first, then more contrast."""
    kept = []
    for f in sorted(found, key=lambda f: (f["wrong"], -f["contrast"])):
        centre = f["corners"].mean(axis=0)
        near = (np.abs(centre - k["corners"].mean(axis=0)).max() < 0.25 * np.ptp(k["corners"], axis=0).max() for k in kept)
        if not any(near):
            kept.append(f)
    return kept


def make_detector(dictionaries, **parameters):
    """Return BART for single images; ValueError for a value that is not allowed."""
    p = {**PARAMETERS, **parameters}
    if p["threshold"] not in ("mean", "otsu", "both"):
        raise ValueError(f"threshold is mean, otsu or both, not {p['threshold']!r}")
    if p["light"] not in ("auto", "srgb", "linear"):
        raise ValueError(f"light is auto, srgb or linear, not {p['light']!r}")
    if p["window_px"] < 3 or p["coarse_mpx"] <= 0 or p["wrong_bits"] < 0:
        raise ValueError("window_px is at least 3, coarse_mpx positive, wrong_bits not negative")
    return Bart(dictionaries, p)
