"""By what a plate's features change with the pixels of its image; compiled."""

import numpy as np

from gap.measure.plate import MAX_RIM, N_STATE, _expand, _solve, code_homography, plate_window, px_per_m
from gap.observables import CORNERS, FEATURE_RIDGE, LEVELS, N_FEATURES, STATE_FEATURES, STATE_RIM
from kernels import njit

PIXEL_STEP_PX = 0.05  # of the corners, for how the model changes with them


@njit(cache=True, nogil=True)
def plate_response(image, state, half_code, half_plate, beyond, rectangles, levels, lut):
    """Return (response (19, n), x0, y0, rows, columns): by what the features of a plate change with each pixel of a window.

    The plate was measured in ``image`` and its state (14,) is where the fit ended; the window is (rows, columns) from x0, y0.
    Where the fit's steps vanish, c(state, image) = 0 of the moving features: the implicit function theorem says how the state
    goes with the image; the others follow the state and the image. With M c = B r, M dc = dB (r - B'c) + B (dr - dB'c).
    """
    corners = state[CORNERS].copy().reshape(4, 2)
    outline = half_plate + state[STATE_RIM] / px_per_m(corners, half_code)
    outline = min(max(outline, half_code), MAX_RIM * half_plate)
    x0, y0, x1, y1 = plate_window(code_homography(corners, half_code), outline, 3)
    x0, y0, x1, y1 = max(x0, 0), max(y0, 0), min(x1, image.shape[1]), min(y1, image.shape[0])
    patch = image[y0:y1, x0:x1].astype(np.float64)
    B, residual = _expand(
        patch, corners, half_code, outline + beyond, rectangles, levels, state[LEVELS], lut, x0, y0, 0
    )
    c, M, _, _ = _solve(B, residual, FEATURE_RIDGE.copy())
    flat, left = B.astype(np.float64).reshape(N_FEATURES, -1), residual.astype(np.float64).ravel()
    by_pixel = np.linalg.solve(M, flat)
    explained = c @ flat
    unexplained = left - explained
    own = flat @ unexplained
    by_state = np.empty((N_FEATURES, N_STATE))
    for k in range(N_STATE):
        if LEVELS.start <= k < LEVELS.stop:  # levels bend nothing
            by_state[:, k] = -by_pixel @ flat[k]
            continue
        moved = state.copy()
        moved[k] += PIXEL_STEP_PX
        corners = moved[CORNERS].copy().reshape(4, 2)
        outline = half_plate + moved[STATE_RIM] / px_per_m(corners, half_code)
        outline = min(max(outline, half_code), MAX_RIM * half_plate)
        B_there, left_there = _expand(
            patch, corners, half_code, outline + beyond, rectangles, levels, state[LEVELS], lut, x0, y0, 0
        )
        flat_there = B_there.astype(np.float64).reshape(N_FEATURES, -1)
        there = flat_there @ unexplained - own
        there += flat @ (left_there.astype(np.float64).ravel() - left - c @ flat_there + explained)
        by_state[:, k] = np.linalg.solve(M, there) / PIXEL_STEP_PX
    moving = STATE_FEATURES
    for k in range(N_STATE):
        if not by_state[:, k].any():  # a board's paper has neither ground nor outline
            by_state[moving[k], k] = -1.0
    state_by_pixel = -np.linalg.solve(by_state[moving], by_pixel[moving])
    response = by_pixel + by_state @ state_by_pixel
    for k in range(N_STATE):
        response[moving[k]] = state_by_pixel[k]
    return response, x0 + 1, y0 + 1, y1 - y0 - 2, x1 - x0 - 2


@njit(cache=True, nogil=True)
def respond(response, change, x0, y0, rows, columns):
    """Return the features' change (19,) with a ``change`` of the image (H, W) that ``plate_response`` was taken of."""
    out = np.zeros(N_FEATURES)
    k = 0
    for r in range(rows):
        for c in range(columns):
            d = change[y0 + r, x0 + c]
            if d != 0.0:
                for f in range(N_FEATURES):
                    out[f] += response[f, k] * d
            k += 1
    return out
