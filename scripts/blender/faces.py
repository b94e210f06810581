"""A plate as faces of one mesh: each black or white, none upon another, so that no face fights its neighbour for a ray."""

import bpy  # noqa: F401  # brings mathutils
import numpy as np
from mathutils import Vector
from mathutils.geometry import delaunay_2d_cdt

from rig.discs import built_outlines

INSIDE_FACES = 1  # mathutils' word for triangles that lie in one of the faces handed over
APART = 1e-9  # of half a plate: points nearer to each other are one


def plate_faces(plate):
    """Return (points (n, 3) in the world, faces as tuples of indices, whether each face is white) of a rig.plates.Plate."""
    rows, columns = len(plate.y_m), len(plate.x_m)
    cells = [
        (a, a + 1, a + columns + 1, a + columns)
        for a in (j * columns + i for j in range(rows - 1) for i in range(columns - 1))
    ]
    white = plate.white.ravel().tolist()
    if not len(plate.discs):
        return plate.grid_world().reshape(-1, 3), cells, white
    return _cut_faces(plate, cells, white)


def _cut_faces(plate, cells, white):
    """Return as ``plate_faces``: triangles of the cells, cut along the discs; what was painted last has its colour."""
    x, y = np.meshgrid(plate.x_m, plate.y_m)
    rims = built_outlines(plate)
    points = np.concatenate([np.stack([x.ravel(), y.ravel()], axis=1), *rims])
    first, faces = x.size, list(cells)
    for rim in rims:
        faces.append(tuple(range(first, first + len(rim)))[::-1])  # counter-clockwise, as the cells
        first += len(rim)
    colours = [*white, *(disc[3] > 0 for disc in plate.discs)]
    middle, scale = points.mean(axis=0), np.ptp(points, axis=0).max() / 2
    scaled = [Vector(p) for p in ((points - middle) / scale).tolist()]
    made, _, triangles, _, _, origins = delaunay_2d_cdt(scaled, [], faces, INSIDE_FACES, APART)
    flat = np.array([p[:] for p in made]) * scale + middle
    return plate.to_world(flat), [tuple(t) for t in triangles], [bool(colours[max(o)]) for o in origins]
