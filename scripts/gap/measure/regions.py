"""Measure uniform regions in windows of an image: levels over the frame, noise by level, correlation, blocks, stripes."""

import numpy as np

from gap.measure.plate import _draw, code_homography, plate_window
from gap.observables import COLUMN, NOISE_FEATURES, columns
from gap.pixels.raster import running_sums
from kernels import njit

GROUND, WHITE, BLACK, SKY = 1, 2, 3, 4
FIELD_COLUMNS, FIELD_ROWS = 8, 5
N_GROUND = FIELD_COLUMNS * FIELD_ROWS  # regions of ground; those of sky follow
REGION_SIDE_PX = 16  # of the squares that are looked at: whole blocks of 16, less 8 on each side
REGION_EDGE_PX = 8
HORIZON_BAND_PX = 30
BLOCK_PX = 16
LARGEST_PX = 900
FEWEST_PX = 200
FEWEST_GROUND_PX = 2000
SHORTEST_STRIPE_PX = 8
FLAT_DN2 = 1 / 12  # variance that rounding adds: what a codec or a filter leaves below it hangs on a tenth of a level
FLAT_ERROR = 1.0  # standard error of such a variance's logarithm
FEWEST_STRIPES = 20
# Columns of NOISE_FEATURES: variances by surface, what neighbours share, rare large values, traces of a codec, stripes, colour
BY_SURFACE, SHARED = columns("noise_ground", "noise_sky"), columns("noise_y_over_x", "noise_lag2_y")
BLOCKS, STRIPES = columns("blocks_x", "blocks_y"), columns("stripes_row", "stripes_column")
ON_GROUND, TAILS, COLOUR = (COLUMN[name] for name in ("noise_ground", "noise_tails", "noise_colour"))


@njit(cache=True, nogil=True)
def _classify_plate(out, corners, half_code, half_plate, rectangles):
    """Write the classes of a plate's pixels and of those near it into ``out`` (H, W); corners (4, 2) are the code's."""
    h, w = out.shape
    s, t, pad = half_code, half_plate, 5
    H = code_homography(corners, s)
    x0, y0, x1, y1 = plate_window(H, t, pad)
    if x1 - x0 > LARGEST_PX or y1 - y0 > LARGEST_PX:
        return
    ph, pw = y1 - y0, x1 - x0
    acc = np.zeros((ph, pw + 2))
    _draw(acc, H, np.array([[-t, -t, t, t]]), x0, y0)
    plate = running_sums(acc)
    acc[:] = 0
    _draw(acc, H, rectangles, x0, y0)
    black = running_sums(acc)
    for r in range(max(0, -y0), min(ph, h - y0)):
        for c in range(max(0, -x0), min(pw, w - x0)):
            pure_white, pure_black = True, True
            for dr in range(-1, 2):
                for dc in range(-1, 2):
                    rr, cc = min(max(r + dr, 0), ph - 1), min(max(c + dc, 0), pw - 1)
                    if plate[rr, cc] < 0.9999 or black[rr, cc] > 1e-4:
                        pure_white = False
                    if black[rr, cc] < 0.9999:
                        pure_black = False
            near = False
            for dr in range(-4, 5, 2):
                for dc in range(-4, 5, 2):
                    rr, cc = min(max(r + dr, 0), ph - 1), min(max(c + dc, 0), pw - 1)
                    if plate[rr, cc] > 1e-4:
                        near = True
            if pure_white:
                out[y0 + r, x0 + c] = WHITE
            elif pure_black:
                out[y0 + r, x0 + c] = BLACK
            elif near or plate[r, c] > 1e-4:
                out[y0 + r, x0 + c] = 0


@njit(cache=True, nogil=True)
def flat_classes(shape, corners, measured, half_code, half_plate, rectangles, first, boxes, horizon):
    """Return the class of each pixel (0: not flat), uint8 of ``shape``.

    corners (p, 4, 2) of the code and whether they were measured (p,); rectangles of all plates (n, 4), those of
    plate i are ``first[i]:first[i+1]``; boxes (q, 4) to leave out; horizon (W,) its row in each column, about
    which some are left out.
    """
    h, w = shape
    out = np.ones((h, w), np.uint8)
    for c in range(w):
        for r in range(h):
            if r < horizon[c] - HORIZON_BAND_PX:
                out[r, c] = SKY
            elif r <= horizon[c] + HORIZON_BAND_PX:
                out[r, c] = 0
    for i in range(boxes.shape[0]):
        x0, y0, x1, y1 = boxes[i]
        for r in range(max(0, int(y0)), min(h, int(y1) + 1)):
            for c in range(max(0, int(x0)), min(w, int(x1) + 1)):
                out[r, c] = 0
    for i in range(corners.shape[0]):
        if measured[i]:
            _classify_plate(out, corners[i], half_code[i], half_plate[i], rectangles[first[i] : first[i + 1]])
    return out


@njit(cache=True, nogil=True)
def structure(image, classes):
    """Return sums over pairs of equal class in an image (rows, columns): (of each class, by steps of 8, of fourth powers)."""
    h, w = image.shape
    sums = np.zeros((5, 8))  # per class: d1x^2, n, d1y^2, n, d2x^2, n, d2y^2, n
    blocks = np.zeros((4, 2))  # at x multiples of 8, elsewhere, the same in y: sum, n
    fourth = np.zeros(3)
    for r in range(h):
        for c in range(w):
            k = classes[r, c]
            if k == 0:
                continue
            value = image[r, c]
            if c + 1 < w and classes[r, c + 1] == k:
                d = (image[r, c + 1] - value) ** 2
                sums[k, 0] += d
                sums[k, 1] += 1
                if k == 1:
                    b = 0 if c % 8 == 7 else 1
                    blocks[b, 0] += d
                    blocks[b, 1] += 1
                    fourth[0] += d
                    fourth[1] += d * d
                    fourth[2] += 1
            if r + 1 < h and classes[r + 1, c] == k:
                d = (image[r + 1, c] - value) ** 2
                sums[k, 2] += d
                sums[k, 3] += 1
                if k == 1:
                    b = 2 if r % 8 == 7 else 3
                    blocks[b, 0] += d
                    blocks[b, 1] += 1
            if c + 2 < w and classes[r, c + 2] == k:
                sums[k, 4] += (image[r, c + 2] - value) ** 2
                sums[k, 5] += 1
            if r + 2 < h and classes[r + 2, c] == k:
                sums[k, 6] += (image[r + 2, c] - value) ** 2
                sums[k, 7] += 1
    return sums, blocks, fourth


@njit(cache=True, nogil=True)
def _stripes(image, regions):
    """Return the mean squared step between neighbouring rows' (and columns') means of regions (k, 4) of an image, times
    their number of pixels: (2, 2) of sum and number, rows first.
    """
    out = np.zeros((2, 2))
    for k in range(regions.shape[0]):
        x0, y0, x1, y1 = regions[k]
        for r in range(y0, y1 - 1):
            total = 0.0
            for c in range(x0, x1):
                total += image[r + 1, c] - image[r, c]
            if x1 - x0 >= SHORTEST_STRIPE_PX:
                out[0, 0] += total * total / (x1 - x0)
                out[0, 1] += 1
        for c in range(x0, x1 - 1):
            total = 0.0
            for r in range(y0, y1):
                total += image[r, c + 1] - image[r, c]
            if y1 - y0 >= SHORTEST_STRIPE_PX:
                out[1, 0] += total * total / (y1 - y0)
                out[1, 1] += 1
    return out


def _log_ratio(a, b):
    return float(np.log(max(a, 1e-3) / max(b, 1e-3)))


def noise_features(green, red, blue, classes, ground):
    """Return (values, standard errors) of NOISE_FEATURES; NaN where there is too little ground, or of less noise than FLAT_DN2.

    green, red, blue (H, W) float; red and blue may be None for a grey image; classes (H, W); ground (k, 4) x0, y0, x1, y1 of
    regions that are ground alone. Variances are those of differences of
    neighbours, halved, in squared grey levels; logarithms are natural.
    """
    sums, blocks, fourth = structure(green, classes)
    stripes = _stripes(green, ground)
    values, errors = np.full(len(NOISE_FEATURES), np.nan), np.full(len(NOISE_FEATURES), np.nan)
    with np.errstate(invalid="ignore", divide="ignore"):
        d1x, d1y, d2x, d2y = (sums[:, i] / sums[:, i + 1] / 2 for i in (0, 2, 4, 6))
    n = sums[:, 1] + sums[:, 3]
    for i, k in zip(range(len(values))[BY_SURFACE], (GROUND, WHITE, BLACK, SKY), strict=True):
        if n[k] >= FEWEST_PX:
            values[i] = np.log(max((sums[k, 0] + sums[k, 2]) / n[k] / 2, 1e-3))
            errors[i] = np.sqrt(3 / n[k]) if values[i] > np.log(FLAT_DN2) else FLAT_ERROR
    if n[GROUND] >= FEWEST_GROUND_PX and values[ON_GROUND] > np.log(FLAT_DN2):
        se = np.sqrt(6 / n[GROUND])
        g = GROUND
        values[SHARED] = _log_ratio(d1y[g], d1x[g]), _log_ratio(d2x[g], d1x[g]), _log_ratio(d2y[g], d1y[g])
        errors[SHARED] = 2 * se
        mean2 = fourth[0] / fourth[2]
        values[TAILS] = _log_ratio(fourth[1] / fourth[2], 3 * mean2**2)
        errors[TAILS] = np.sqrt(40 / n[g])
        at_8, elsewhere = blocks[::2], blocks[1::2]
        values[BLOCKS] = [_log_ratio(a / n_a, b / n_b) for (a, n_a), (b, n_b) in zip(at_8, elsewhere, strict=True)]
        errors[BLOCKS] = np.sqrt(3 / at_8[:, 1])
        for i, (total, pairs), of_noise in zip(range(len(values))[STRIPES], stripes, (d1y[g], d1x[g]), strict=True):
            if pairs >= FEWEST_STRIPES:
                values[i] = _log_ratio(total / pairs, 2 * of_noise)
                errors[i] = np.sqrt(3 / pairs)
        if red is not None:
            colour, _, _ = structure(red - blue, classes)
            per_pair = (colour[g, 0] + colour[g, 2]) / (colour[g, 1] + colour[g, 3]) / 2
            values[COLOUR] = _log_ratio(per_pair, 2 * np.exp(values[ON_GROUND]))
            errors[COLOUR] = np.sqrt(6 / n[g])
        # rare large values, as flats have after JPEG or with hot pixels, tell less of a variance than a normal's
        errors *= np.sqrt(max(np.exp(values[TAILS]), 1.0))
    return values, errors


def choose_regions(classes):
    """Return (2 * rows * columns, 4) int, x0, y0, x1, y1: for each cell of a grid over the frame a square of ground alone in
    classes (H, W), then for each one of sky; zeros where there is none.
    """
    h, w = classes.shape
    out = np.zeros((2, FIELD_ROWS, FIELD_COLUMNS, 4), int)
    for k, kind in enumerate((GROUND, SKY)):
        wanted = classes == kind
        for row in range(FIELD_ROWS) if wanted.any() else ():
            for column in range(FIELD_COLUMNS):
                x = column * w // FIELD_COLUMNS, (column + 1) * w // FIELD_COLUMNS
                y = row * h // FIELD_ROWS, (row + 1) * h // FIELD_ROWS
                out[k, row, column] = _region_in(wanted, x, y)
    return out.reshape(-1, 4)


def _region_in(wanted, x, y):
    """Return (x0, y0, x1, y1) of the square within x and y that is ``wanted`` (H, W) throughout, the nearest to the middle;
    zeros where there is none.
    """
    side = REGION_SIDE_PX
    places = [(c, r) for c in _first_pixels(*x) for r in _first_pixels(*y)]
    for c, r in sorted(places, key=lambda p: (np.hypot(p[0] + side / 2 - sum(x) / 2, p[1] + side / 2 - sum(y) / 2), p)):
        if wanted[r : r + side, c : c + side].all():
            return c, r, c + side, r + side
    return 0, 0, 0, 0


def _first_pixels(low, high):
    """Return where squares of REGION_SIDE_PX may begin between low and high, so that whole blocks hold them and their edges."""
    first = -(-(low - REGION_EDGE_PX) // BLOCK_PX) * BLOCK_PX + REGION_EDGE_PX
    return range(first, high - REGION_SIDE_PX + 1, BLOCK_PX)
