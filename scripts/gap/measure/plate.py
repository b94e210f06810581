"""Measure one plate in one image: corners by a fit of the known code, levels, edge spread, overshoot; compiled.

The patch is compared with the ideal one (exact coverage, nominal levels, the campaign's encoding) under a homography
that is fitted; what is left over is expanded in a few images that each mean something physical. The same code
measures real and twin, so that what the expansion leaves out cancels in the gap.
"""

import numpy as np

from gap.observables import CORNERS, EDGES, FEATURE_RIDGE, HELD_FEATURES, LEVELS, N_FEATURES, STATE_FEATURES, STATE_RIM
from gap.pixels.raster import add_edge, running_sums
from kernels import njit

# The expansion: displacement of the four code corners (x, y each), then
WHITE, BLACK, GROUND, SLOPE_U, SLOPE_V = range(N_FEATURES)[LEVELS]
SPREAD_X, SPREAD_Y, SPREAD_XY, OVERSHOOT, INK, RIM = range(N_FEATURES)[EDGES]
N_STATE = len(STATE_FEATURES)
RIM_STEP_PX = 0.25  # of the difference that says how the plate's outline moves
MAX_RIM = 1.5  # of the plate's half side
DEPTH = 4  # iterations whose changes lead the next
PX_PER_LEVEL = 0.02  # how much a grey level counts beside a pixel there
COARSE_ITERATIONS, FINE_ITERATIONS = 5, 30
CUTTING_ITERATIONS = 10  # after which a fit keeps its window: a row that comes and goes may keep it from its end
SMALLEST_STEP_PX = 0.001
LARGEST_PX = 600


@njit(cache=True, nogil=True)
def code_homography(corners, half_code):
    """Return the 3 x 3 homography that takes the plate's plane, metres, to pixels; corners (4, 2) are the code's.

    In closed form by way of the unit square, its origin in the upper left corner (Heckbert 1989, Fundamentals of Texture Mapping
    and Image Warping, section 2.2.3).
    """
    H, side = np.empty((3, 3)), 2 * half_code
    x, y = corners[:, 0], corners[:, 1]
    right_x, right_y, down_x, down_y = x[1] - x[2], y[1] - y[2], x[3] - x[2], y[3] - y[2]
    sum_x, sum_y = x[0] - x[1] + x[2] - x[3], y[0] - y[1] + y[2] - y[3]
    area = right_x * down_y - down_x * right_y
    u, v = (sum_x * down_y - down_x * sum_y) / area, (right_x * sum_y - sum_x * right_y) / area
    middle = 1 + 0.5 * (u + v)  # the denominator in the middle, where it is to be 1
    for i in range(2):
        first, along, across = corners[0, i], corners[1, i] * (1 + u), corners[3, i] * (1 + v)
        along, across = along - first, across - first
        H[i, 0], H[i, 1], H[i, 2] = along / side, -across / side, first + 0.5 * (along + across)
    H[2, 0], H[2, 1], H[2, 2] = u / side, -v / side, middle
    for i in range(3):
        for k in range(3):
            H[i, k] /= middle
    return H


@njit(cache=True, nogil=True)
def _draw(acc, H, rectangles, dx, dy):
    for i in range(rectangles.shape[0]):
        x0, y0, x1, y1 = rectangles[i]
        px = np.empty(4)
        py = np.empty(4)
        for k in range(4):
            x = x0 if k == 0 or k == 3 else x1
            y = y1 if k < 2 else y0
            w = H[2, 0] * x + H[2, 1] * y + H[2, 2]
            px[k] = (H[0, 0] * x + H[0, 1] * y + H[0, 2]) / w + 0.5 - dx
            py[k] = (H[1, 0] * x + H[1, 1] * y + H[1, 2]) / w + 0.5 - dy
        for k in range(4):
            n = (k + 1) % 4
            add_edge(acc, px[k], py[k], px[n], py[n], -1.0)


@njit(cache=True, nogil=True)
def _box(image, radius):
    """Return the mean over a (2 radius + 1) square, edges repeated."""
    if radius == 0:
        return image.copy()
    h, w = image.shape
    rows = np.empty((h, w))
    out = np.empty((h, w))
    n = 2 * radius + 1
    for r in range(h):
        total = 0.0
        for k in range(-radius, radius + 1):
            total += image[r, min(max(k, 0), w - 1)]
        for c in range(w):
            rows[r, c] = total / n
            total += image[r, min(c + radius + 1, w - 1)] - image[r, max(c - radius, 0)]
    total = np.zeros(w)
    for k in range(-radius, radius + 1):
        total += rows[min(max(k, 0), h - 1)]
    for r in range(h):
        coming, going = rows[min(r + radius + 1, h - 1)], rows[max(r - radius, 0)]
        for c in range(w):
            out[r, c] = total[c] / n
            total[c] += coming[c] - going[c]
    return out


@njit(cache=True, nogil=True)
def _encode(value, lut):
    t = min(max(value, 0.0), 1.0) * (lut.shape[0] - 1)
    i = min(int(t), lut.shape[0] - 2)
    return lut[i] + (t - i) * (lut[i + 1] - lut[i])


@njit(cache=True, nogil=True)
def _plate_coordinates(inverse, x, y, half_code):
    """Return plate coordinates of a pixel in units of half the code's side."""
    scale = 1 / ((inverse[2, 0] * x + inverse[2, 1] * y + inverse[2, 2]) * half_code)
    u = (inverse[0, 0] * x + inverse[0, 1] * y + inverse[0, 2]) * scale
    v = (inverse[1, 0] * x + inverse[1, 1] * y + inverse[1, 2]) * scale
    return u, v


@njit(cache=True, nogil=True)
def px_per_m(corners, half_code):
    """Return the pixels that a metre on the plate spans, on average."""
    side = 0.0
    for k in range(4):
        along = corners[(k + 1) % 4] - corners[k]
        side += np.hypot(along[0], along[1]) / 4
    return side / (2 * half_code)


@njit(cache=True, nogil=True)
def _draw_model(shape, corners, half_code, half_plate, rectangles, levels, shifts, lut, x0, y0):
    """Return (coverage of the plate, of black, plate coordinates u, v in half code sides, grey levels), each (h, w) of ``shape``,
    of a plate at ``corners``; the rest as ``_expand``.
    """
    h, w = shape
    H = code_homography(corners, half_code)
    acc = np.zeros((h, w + 2))
    _draw(acc, H, np.array([[-half_plate, -half_plate, half_plate, half_plate]]), x0, y0)
    plate = running_sums(acc)
    acc[:] = 0
    _draw(acc, H, rectangles, x0, y0)
    black = running_sums(acc)
    white_level, black_level, ground_level = levels
    model, us, vs = np.empty((h, w)), np.empty((h, w)), np.empty((h, w))
    inverse = np.linalg.inv(H)
    for r in range(h):
        for k in range(w):
            lin = ground_level + (white_level - ground_level) * plate[r, k] + (black_level - white_level) * black[r, k]
            model[r, k] = _encode(lin, lut)
            us[r, k], vs[r, k] = _plate_coordinates(inverse, k + x0, r + y0, half_code)
            white = plate[r, k] - black[r, k]
            model[r, k] += shifts[0] * white + shifts[1] * black[r, k] + shifts[2] * (1 - plate[r, k])
            model[r, k] += plate[r, k] * (shifts[3] * us[r, k] + shifts[4] * vs[r, k])
    return plate, black, us, vs, model


@njit(cache=True, nogil=True)
def _expand(image, corners, half_code, half_plate, rectangles, levels, shifts, lut, x0, y0, radius):
    """Return (expansion images (19, h - 2, w - 2), residual) of a patch (h, w) about the model at ``corners``, its rim left out.

    ``half_plate`` is that found so far, ``shifts`` (5,) are grey levels already found for white, black, ground and the
    slopes over the plate. In single precision: the fit's sums over them take most of its time.
    """
    h, w = image.shape
    plate, black, us, vs, model = _draw_model(
        (h, w), corners, half_code, half_plate, rectangles, levels, shifts, lut, x0, y0
    )
    wider = half_plate + RIM_STEP_PX / px_per_m(corners, half_code)
    acc = np.zeros((h, w + 2))
    _draw(acc, code_homography(corners, half_code), np.array([[-wider, -wider, wider, wider]]), x0, y0)
    rim = running_sums(acc) - plate
    white_level, black_level, ground_level = levels
    contrast = _encode(white_level, lut) - _encode(black_level, lut) + shifts[0] - shifts[1]
    outer_contrast = _encode(white_level, lut) - _encode(ground_level, lut) + shifts[0] - shifts[2]
    smooth = _box(model, radius)
    blurred = _box(image, radius)
    wide = _box(smooth, 4)
    rim = _box(rim, radius)
    B = np.empty((N_FEATURES, h - 2, w - 2), np.float32)
    residual = np.empty((h - 2, w - 2), np.float32)
    gx = np.empty(w - 2)
    gy = np.empty(w - 2)
    for r in range(1, h - 1):
        above, row, below = smooth[r - 1], smooth[r], smooth[r + 1]
        u, v = us[r, 1:-1], vs[r, 1:-1]
        for k in range(w - 2):
            residual[r - 1, k] = blurred[r, k + 1] - row[k + 1]
            gx[k] = 0.5 * (row[k + 2] - row[k])
            gy[k] = 0.5 * (below[k + 1] - above[k + 1])
        # bilinear weights of the corners: how far this pixel moves when one corner does
        for n in range(4):
            su = 1.0 if n == 1 or n == 2 else -1.0
            sv = 1.0 if n < 2 else -1.0
            for k in range(w - 2):
                weight = 0.25 * (1 + su * u[k]) * (1 + sv * v[k])
                B[2 * n, r - 1, k] = -gx[k] * weight
                B[2 * n + 1, r - 1, k] = -gy[k] * weight
        for k in range(w - 2):
            on, ink = plate[r, k + 1], black[r, k + 1]
            B[WHITE, r - 1, k] = on - ink
            B[BLACK, r - 1, k] = ink
            B[GROUND, r - 1, k] = 1 - on
            B[SLOPE_U, r - 1, k] = on * u[k]
            B[SLOPE_V, r - 1, k] = on * v[k]
        for k in range(w - 2):
            centre = row[k + 1]
            B[SPREAD_X, r - 1, k] = 0.5 * (row[k] - 2 * centre + row[k + 2])
            B[SPREAD_Y, r - 1, k] = 0.5 * (below[k + 1] - 2 * centre + above[k + 1])
            B[SPREAD_XY, r - 1, k] = 0.25 * (below[k + 2] - below[k] - above[k + 2] + above[k])
            B[OVERSHOOT, r - 1, k] = centre - wide[r, k + 1]
        for k in range(w - 2):
            bx = 0.5 * (black[r, k + 2] - black[r, k])
            by = 0.5 * (black[r + 1, k + 1] - black[r - 1, k + 1])
            B[INK, r - 1, k] = -contrast * np.sqrt(bx * bx + by * by)
            B[RIM, r - 1, k] = outer_contrast * rim[r, k + 1] / RIM_STEP_PX
    return B, residual


@njit(cache=True, nogil=True)
def _solve(B, residual, ridge):
    """Return (coefficients, normal matrix, residual sum of squares, pixels) of the regression on images B (n, h, w)."""
    n = B.shape[0]
    columns = B.reshape(n, -1)
    y = residual.reshape(-1)
    A = (columns @ columns.T).astype(np.float64)
    b = (columns @ y).astype(np.float64)
    rss = 0.0  # summed in double precision: most of it may be explained
    for k in range(len(y)):
        rss += y[k] * y[k]
    M = A.copy()
    for i in range(n):
        M[i, i] += ridge[i]
    coefficients = np.linalg.solve(M, b)
    explained = 0.0
    for i in range(n):
        explained += coefficients[i] * b[i]
    return coefficients, M, rss - explained, len(y)


@njit(cache=True, nogil=True)
def plate_window(H, half_plate, pad):
    """Return (x0, y0, x1, y1) of the pixels that a plate covers, ``pad`` px around it; H takes the plate to pixels."""
    xs = np.empty(4)
    ys = np.empty(4)
    for k in range(4):
        x = -half_plate if k == 0 or k == 3 else half_plate
        y = half_plate if k < 2 else -half_plate
        q = H[2, 0] * x + H[2, 1] * y + H[2, 2]
        xs[k] = (H[0, 0] * x + H[0, 1] * y + H[0, 2]) / q
        ys[k] = (H[1, 0] * x + H[1, 1] * y + H[1, 2]) / q
    x0, y0 = int(np.floor(xs.min())) - pad, int(np.floor(ys.min())) - pad
    x1, y1 = int(np.ceil(xs.max())) + pad + 1, int(np.ceil(ys.max())) + pad + 1
    return x0, y0, x1, y1


@njit(cache=True, nogil=True)
def _accelerated(state, step, before, changes, n):
    """Return the move of iteration n; ``before`` (2, k) and ``changes`` (2, DEPTH, k) keep earlier states and steps.

    A fit to a code sharper than the image creeps, or overshoots where edges are undersampled: what the last steps changed
    says where they lead. Source: D. G. Anderson, "Iterative procedures for nonlinear integral equations" (1965).
    """
    move = step.copy()
    if n > 0:
        changes[0, (n - 1) % DEPTH] = state - before[0]
        changes[1, (n - 1) % DEPTH] = step - before[1]
        m = min(n, DEPTH)
        by = np.ones(N_STATE)
        by[LEVELS] = PX_PER_LEVEL
        F = changes[1, :m] * by
        G = F @ F.T
        for i in range(m):
            G[i, i] = G[i, i] * (1 + 1e-6) + 1e-14
        share = np.linalg.solve(G, F @ (step * by))
        for i in range(m):
            move -= share[i] * (changes[0, i] + changes[1, i])
    before[0] = state
    before[1] = step
    return move


@njit(cache=True, nogil=True)
def measure_plate(image, start, half_code, half_plate, beyond, rectangles, levels, lut, radii, max_px):
    """Fit one plate.

    image        (H, W) float32 grey levels; start (14,) predicted corners of the code, pixels, shifts of the five levels,
                 and how far the plate reaches beyond ``half_plate``, pixels
    half_code, half_plate  metres; beyond  metres that white goes on where the patch ends; rectangles (n, 4) black area, metres
    levels       linear values of white, black, ground; lut grey level of linear values 0..1
    radii        box radii of the coarse-to-fine passes, ending in 0; max_px how far corners may go from ``start``

    Return (features (19,), information matrix (19, 19) per unit noise variance, corners (4, 2), noise variance of
    the fit, steps' last size in pixels, 1.0 if converged else 0.0); the first eight features are the corners.
    """
    corners = start[CORNERS].copy().reshape(4, 2)
    values = np.zeros(N_FEATURES)
    info = np.eye(N_FEATURES)
    variance = 0.0
    size = 1e9
    state = start.copy()
    x0, y0, x1, y1 = 0, 0, 0, 0
    for p in range(radii.shape[0]):
        radius = radii[p]
        changes = np.zeros((2, DEPTH, N_STATE))  # of the state and of its step, from one iteration to the next
        before = np.zeros((2, N_STATE))
        for n in range(COARSE_ITERATIONS if radius > 0 else FINE_ITERATIONS):
            corners = state[CORNERS].copy().reshape(4, 2)
            outline = half_plate + state[STATE_RIM] / px_per_m(corners, half_code)
            outline = min(max(outline, half_code), MAX_RIM * half_plate)
            if n < CUTTING_ITERATIONS:
                x0, y0, x1, y1 = plate_window(code_homography(corners, half_code), outline, 3 + 2 * radius)
                x0, y0, x1, y1 = max(x0, 0), max(y0, 0), min(x1, image.shape[1]), min(y1, image.shape[0])
            if x1 - x0 < 8 or y1 - y0 < 6 or x1 - x0 > LARGEST_PX or y1 - y0 > LARGEST_PX:
                return values, info, corners, variance, size, 0.0
            patch = image[y0:y1, x0:x1].astype(np.float64)
            shifts = state[LEVELS]
            white = outline + beyond
            B, residual = _expand(patch, corners, half_code, white, rectangles, levels, shifts, lut, x0, y0, radius)
            prior = FEATURE_RIDGE.copy()
            if radius > 0:
                prior[HELD_FEATURES] = 1e12
            values, info, rss, count = _solve(B, residual, prior)
            variance = max(rss, 0.0) / max(count - N_FEATURES, 1)
            step = values[STATE_FEATURES]
            size = max(np.abs(step[CORNERS]).max(), abs(step[STATE_RIM]))
            move = _accelerated(state, step, before, changes, n)
            move *= min(1.0, (1.5 + radius) / max(np.abs(move[CORNERS]).max(), abs(move[STATE_RIM]), 1e-9))
            state += move
            if np.abs(state[CORNERS] - start[CORNERS]).max() > max_px:
                return values, info, corners, variance, size, 0.0
            if size < SMALLEST_STEP_PX:
                break
    values[STATE_FEATURES] = state
    return values, info, state[CORNERS].copy().reshape(4, 2), variance, size, 1.0 if size < 0.05 else 0.0
