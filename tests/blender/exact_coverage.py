"""What renders are held to: cells of plates clipped to pixel squares, written apart from the project's synthesis.

Every cell of a plate is projected corner by corner, cut off behind the camera, clipped to each pixel's square
(Sutherland and Hodgman 1974), and its area counted; the horizon is clipped in the same way. Light is even.
"""

import numpy as np
from numba import njit

NEAR_M = 1e-4


@njit(cache=True)
def _cut(polygon, n, a, b, c, out):
    """Keep the part of a polygon (first n rows) where a x + b y + c >= 0; return its number of corners."""
    count = 0
    for i in range(n):
        x0, y0 = polygon[i, 0], polygon[i, 1]
        x1, y1 = polygon[(i + 1) % n, 0], polygon[(i + 1) % n, 1]
        d0, d1 = a * x0 + b * y0 + c, a * x1 + b * y1 + c
        if d0 >= 0:
            out[count, 0], out[count, 1] = x0, y0
            count += 1
        if (d0 >= 0) != (d1 >= 0):
            t = d0 / (d0 - d1)
            out[count, 0], out[count, 1] = x0 + t * (x1 - x0), y0 + t * (y1 - y0)
            count += 1
    return count


@njit(cache=True)
def _area(polygon, n):
    total = 0.0
    for i in range(n):
        j = (i + 1) % n
        total += polygon[i, 0] * polygon[j, 1] - polygon[j, 0] * polygon[i, 1]
    return abs(total) / 2


@njit(cache=True)
def add_polygon(coverage, polygon):
    """Add a convex polygon's (n, 2) area in each pixel to ``coverage``; x right, y down, pixel (0, 0) spans 0..1."""
    height, width = coverage.shape
    top = max(0, int(np.floor(polygon[:, 1].min())))
    bottom = min(height, int(np.ceil(polygon[:, 1].max())))
    band, strip = np.empty((24, 2)), np.empty((24, 2))
    first, second = np.empty((24, 2)), np.empty((24, 2))
    for row in range(top, bottom):
        n = _cut(polygon, len(polygon), 0.0, 1.0, -float(row), strip)
        n = _cut(strip, n, 0.0, -1.0, row + 1.0, band)
        if n < 3:
            continue
        left = max(0, int(np.floor(band[:n, 0].min())))
        right = min(width, int(np.ceil(band[:n, 0].max())))
        for column in range(left, right):
            k = _cut(band, n, 1.0, 0.0, -float(column), first)
            k = _cut(first, k, -1.0, 0.0, column + 1.0, second)
            if k >= 3:
                coverage[row, column] += _area(second, k)


def _before_camera(points):
    """Return the part (m, 3) of a polygon in the camera's frame that lies before the camera."""
    kept = []
    for a, b in zip(points, np.roll(points, -1, axis=0), strict=True):
        if a[2] >= NEAR_M:
            kept.append(a)
        if (a[2] >= NEAR_M) != (b[2] >= NEAR_M):
            t = (NEAR_M - a[2]) / (b[2] - a[2])
            kept.append(a + t * (b - a))
    return np.array(kept).reshape(-1, 3)


def coverage_of(polygons_world, K, T_cam_world, shape, margin):
    """Return the covered area (H + 2m, W + 2m) of each pixel by convex, disjoint polygons (n, k, 3) of the world."""
    coverage = np.zeros(shape)
    for polygon in polygons_world:
        p = _before_camera(polygon @ T_cam_world[:3, :3].T + T_cam_world[:3, 3])
        if len(p) < 3:
            continue
        x = K[0, 0] * p[:, 0] / p[:, 2] + K[0, 2] + margin + 0.5
        y = K[1, 1] * p[:, 1] / p[:, 2] + K[1, 2] + margin + 0.5
        add_polygon(coverage, np.ascontiguousarray(np.stack([x, y], axis=1)))
    return coverage


def sky_coverage(K, T_cam_world, shape, margin):
    """Return the share (H + 2m, W + 2m) of each pixel that looks above the horizon of the plane z = 0."""
    height, width = shape
    right, down, forward = T_cam_world[:3, 2]  # the world's up in the camera
    a, b = right / K[0, 0], down / K[1, 1]
    c = forward - a * (K[0, 2] + margin + 0.5) - b * (K[1, 2] + margin + 0.5)
    frame = np.array([[0, 0], [width, 0], [width, height], [0, height]], float)
    out = np.empty((24, 2))
    n = _cut(frame, 4, a, b, c, out)
    coverage = np.zeros(shape)
    if n >= 3:
        add_polygon(coverage, out[:n].copy())
    return coverage


def cells_of(plate, white):
    """Return the cells (n, 4, 3) of one colour of a plate in the world."""
    g = plate.grid_world()
    cells = np.stack([g[:-1, :-1], g[:-1, 1:], g[1:, 1:], g[1:, :-1]], axis=2)
    return cells[plate.white == white]


def exact_radiance(scene, K, T_cam_world, width, height, margin):
    """Return (radiance, edge mask), each (H + 2m, W + 2m), of a scene under even light; plates hide no plates."""
    shape = (height + 2 * margin, width + 2 * margin)
    pose = scene.T_cam_mount @ T_cam_world
    white, black = (
        coverage_of(np.concatenate([cells_of(p, w) for p in scene.plates]), K, pose, shape, margin)
        for w in (True, False)
    )
    sky = sky_coverage(K, pose, shape, margin)
    ground = 1 - white - black - sky
    parts = np.stack([white, black, sky, ground])
    levels = np.array([scene.white, scene.black, scene.background, scene.ground])
    return np.tensordot(levels, parts, 1), (parts.max(axis=0) < 1 - 1e-6)
