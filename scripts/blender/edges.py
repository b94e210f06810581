"""Which pixels an edge crosses: only they need many samples. Needs no Blender."""

import numpy as np

from kernels import njit
from rig.discs import built_outlines
from rig.geometry import transform

NEAR_M = 1e-3
SLACK_PX = 1e-3  # more than Blender's single precision moves an edge
JUMP = 0.01  # of radiance, between neighbours; smooth light stays far below it


def edge_segments(plates):
    """Return the segments (n, 2, 3), metres in the world, along which radiance jumps on plates and at their rims."""
    found = [np.zeros((0, 2, 3))]
    for plate in plates:
        grid = plate.grid_world()
        colour = np.pad(plate.white.astype(int), 1, constant_values=-1)
        across = colour[1:, 1:-1] != colour[:-1, 1:-1]
        along = colour[1:-1, 1:] != colour[1:-1, :-1]
        found.append(np.stack([grid[:, :-1][across], grid[:, 1:][across]], axis=1))
        found.append(np.stack([grid[:-1][along], grid[1:][along]], axis=1))
        for flat in built_outlines(plate):
            rim = plate.to_world(flat)
            found.append(np.stack([rim, np.roll(rim, -1, axis=0)], axis=1))
    return np.concatenate(found)


def edge_pixels(segments, K, T_cam_world, shape, margin):
    """Return a mask of ``shape`` (H + 2m, W + 2m) of the pixels that segments or the horizon of z = 0 cross."""
    a, b = np.moveaxis(transform(T_cam_world, segments), 1, 0)
    before = (a[:, 2] > NEAR_M) | (b[:, 2] > NEAR_M)
    a, b = a[before], b[before]
    a, b = _cut_near(a, b), _cut_near(b, a)
    lines = np.concatenate([_to_array(a, K, margin), _to_array(b, K, margin)], axis=1)
    mask = np.zeros(shape, bool)
    _mark(np.concatenate([lines, _horizon(K, T_cam_world, shape, margin)]), mask)
    return mask


def overlooked_jumps(radiance, mask):
    """Return a mask of jumps of radiance between neighbours that ``mask`` does not hold, and what surrounds them.

    Finds what the geometry of plates does not tell, such as light that changes within a pixel near the horizon.
    """
    found = np.zeros(mask.shape, bool)
    for axis in (0, 1):
        first, second = (np.moveaxis(v, axis, 0) for v in (radiance[..., None], mask[..., None]))
        jump = (np.abs(np.diff(first, axis=0)) > JUMP) & ~second[1:] & ~second[:-1]
        target = np.moveaxis(found[..., None], axis, 0)
        target[1:] |= jump
        target[:-1] |= jump
    return _grown(found) & ~mask


def _grown(mask):
    """Return the mask with the four neighbours of each pixel."""
    grown = mask.copy()
    grown[1:] |= mask[:-1]
    grown[:-1] |= mask[1:]
    grown[:, 1:] |= mask[:, :-1]
    grown[:, :-1] |= mask[:, 1:]
    return grown


def _cut_near(point, other):
    """Return points (n, 3) of the camera's frame, moved along to the near plane where they lie behind it."""
    behind = point[:, 2] < NEAR_M
    t = np.where(behind, (NEAR_M - point[:, 2]) / np.where(behind, other[:, 2] - point[:, 2], 1.0), 0.0)
    return point + t[:, None] * (other - point)


def _to_array(points, K, margin):
    """Return array coordinates (n, 2), pixel (0, 0) spanning 0 to 1, of points of the camera's frame."""
    xy = points[:, :2] / points[:, 2:] * (K[0, 0], K[1, 1]) + K[:2, 2]
    return xy + margin + 0.5


def _horizon(K, T_cam_world, shape, margin):
    """Return the horizon as lines (0 or 1, 4): the rays at right angles to the world's z."""
    up = T_cam_world[:3, 2]
    a, b = up[0] / K[0, 0], up[1] / K[1, 1]
    c = up[2] - a * (K[0, 2] + margin + 0.5) - b * (K[1, 2] + margin + 0.5)
    if abs(b) >= abs(a) > 0 or abs(b) > 0 == abs(a):
        return np.array([[0.0, -c / b, shape[1], -(c + a * shape[1]) / b]])
    if abs(a) > 0:
        return np.array([[-c / a, 0.0, -(c + b * shape[0]) / a, shape[0]]])
    return np.zeros((0, 4))


@njit(cache=True)
def _mark(lines, mask):
    """Mark the pixels that lines (n, 4) of x0, y0, x1, y1 cross: row by row, the columns that the line spans there."""
    height, width = mask.shape
    for k in range(len(lines)):
        x0, y0, x1, y1 = lines[k]
        if y0 > y1:
            x0, y0, x1, y1 = x1, y1, x0, y0
        first = max(0.0, np.floor(y0 - SLACK_PX))
        last = min(height - 1.0, np.floor(y1 + SLACK_PX))
        slope = (x1 - x0) / (y1 - y0) if y1 > y0 else 0.0
        for row in range(int(first), int(last) + 1):
            if y1 - y0 > 1e-9:
                xa = x0 + slope * (min(max(row - SLACK_PX, y0), y1) - y0)
                xb = x0 + slope * (min(max(row + 1 + SLACK_PX, y0), y1) - y0)
            else:
                xa, xb = x0, x1
            left = max(0.0, np.floor(min(xa, xb) - SLACK_PX))
            right = min(width - 1.0, np.floor(max(xa, xb) + SLACK_PX))
            for column in range(int(left), int(right) + 1):
                mask[row, column] = True
