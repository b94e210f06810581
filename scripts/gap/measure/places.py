"""Where plates lie in an image: which are wholly inside, large enough, and where their neighbours say they are."""

import numpy as np

SMALLEST_SIDE_PX = 7.0  # of the code: a module is then one pixel
MAX_FOLLOWED_PX = 80.0
FEWEST_TO_FOLLOW = 4  # plates


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


def large_enough(corners, width, height):
    """Return a mask (p,) of codes, corners (p, 4, 2), that lie wholly inside the frame and are large enough to be measured."""
    return wholly_inside(corners, width, height) & (np.nan_to_num(code_sides_px(corners)) >= SMALLEST_SIDE_PX)


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
    return points + np.clip(shift, -MAX_FOLLOWED_PX, MAX_FOLLOWED_PX)


def agreeing(starts, corners, measured):
    """Return which of the measured plates (p,) lie, to within their code's side, where the others' move from their starts
    puts them: what is farther off is another plate.
    """
    if measured.sum() < FEWEST_TO_FOLLOW:
        return measured
    expected = follow_neighbours(starts, starts, corners, measured)
    off = np.abs(corners.mean(1) - expected.mean(1)).max(-1)
    return measured & ~(off > code_sides_px(expected))
