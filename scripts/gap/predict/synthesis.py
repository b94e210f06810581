"""The twin's linear radiance straight from geometry: exact coverage of the known plates, no Blender in the loop.

What the fit renders with; a test holds it to Blender's renders.
"""

import cv2
import numpy as np

from effects.base import highlight_radiance, light_factor
from gap.pixels import windows
from gap.pixels.raster import add_polygons, add_spread_polygons, running_sums
from rig.discs import ARC_PIECES, lenses, outlines, pieces_of
from rig.geometry import project, transform
from rig.plates import cell_rectangles, disc_changes

EDGE_STEP_PX = 8.0  # edges bent by a lens are drawn in straight pieces no longer than this
DISC_SAGITTA_PX = 0.002  # between a disc and the polygon of its area: under a grey level at the hardest edge
MAX_GROUND_M = 1e3
GROUND_STEP_PX, GROUND_OFF_PX = 8, 1e-3  # of the grid on which a lens is inverted for the ground's light, and how well


def rectangle_corners(rectangles):
    """Return (n, 4, 2) corners on the plate, clockwise when seen from the front."""
    x0, y0, x1, y1 = rectangles.T
    return np.stack([np.stack(c, -1) for c in ((x0, y1), (x1, y1), (x1, y0), (x0, y0))], axis=1)


class Prints:
    """All plates of a scene in the world: outlines (p, 4, 3), black cells (n, 4, 3) as polygons, and discs that change
    the colour below them (k, 4) in the frames of their plates, ``plate_of_disc`` (k,), ``T_world_plate`` (p, 4, 4).
    """

    def __init__(self, plates):
        outlines, blacks, discs, shared = [], [], [], []
        for plate in plates:
            outlines.append(plate.outline_world())
            blacks.append(plate.to_world(rectangle_corners(cell_rectangles(plate))))
            discs.append(disc_changes(plate))
            shared.append(_shared_areas(plate, discs[-1]))
        self.outlines = np.array(outlines, float).reshape(-1, 4, 3)
        self.blacks = np.concatenate(blacks) if blacks else np.zeros((0, 4, 3))
        self.plate_of_black = np.repeat(np.arange(len(blacks)), [len(b) for b in blacks])
        self.discs = np.concatenate(discs) if discs else np.zeros((0, 4))
        self.plate_of_disc = np.repeat(np.arange(len(discs)), [len(d) for d in discs])
        self.T_world_plate = np.array([plate.T_world_plate for plate in plates]).reshape(-1, 4, 4)
        self.shared = np.concatenate(shared) if shared else np.zeros((0, 2 * ARC_PIECES, 3))
        self.plate_of_shared = np.repeat(np.arange(len(shared)), [len(s) for s in shared])
        self.reach = np.array([[plate.x_m[[0, -1]], plate.y_m[[0, -1]]] for plate in plates]).reshape(-1, 2, 2)

    def disc_polygons(self, which, pieces):
        """Return the discs of a mask as polygons (n, pieces, 3) in the world, cut at their plates' edges.

        White ones run the other way round: they take from the black that they lie on.
        """
        of, discs = self.plate_of_disc[which], self.discs[which]
        flat = np.clip(outlines(discs, pieces), self.reach[of, None, :, 0], self.reach[of, None, :, 1])
        flat[discs[:, 3] > 0] = flat[discs[:, 3] > 0][:, ::-1]
        T = self.T_world_plate[of]
        return np.einsum("nij,nkj->nki", T[:, :3, :2], flat) + T[:, None, :3, 3]


def _shared_areas(plate, discs):
    """Return what discs of one colour share, polygons (n, 2 ARC_PIECES, 3) in the world that take it off once."""
    flat, white = lenses(discs)
    flat[white > 0] = flat[white > 0][:, ::-1]
    return plate.to_world(flat)


def _subdivide(polygons, pieces):
    """Return polygons (n, m, d) with each edge cut into equal pieces: (n, m * pieces, d)."""
    following = np.roll(polygons, -1, axis=1)
    t = np.arange(pieces)[None, None, :, None] / pieces
    cut = polygons[:, :, None] * (1 - t) + following[:, :, None] * t
    return cut.reshape(len(polygons), -1, polygons.shape[-1])


def _pieces(pixels):
    """Return into how many pieces, a power of two, the edges of polygons (n, m, 2) are cut (n,)."""
    longest = np.nan_to_num(np.linalg.norm(pixels - np.roll(pixels, -1, axis=1), axis=-1)).max(1, initial=0.0)
    return 2 ** np.ceil(np.log2(np.maximum(longest / EDGE_STEP_PX, 1))).astype(int)


def sky_polygon(view, map_points):
    """Return the part of the image above the horizon of the ground plane as a polygon (1, m, 2), or None."""
    R = view.T_cam_world[:3, :3]
    left, right = -view.margin - 2.0, view.width + view.margin + 1.0
    # the ground's vanishing line: directions d with d . up = 0, up = the world's z in the camera
    up = R[:, 2]
    columns = np.linspace(left, right, 64)
    rays_x = (columns - view.K[0, 2]) / view.K[0, 0]
    if abs(up[1]) < 1e-9:
        return None
    rays_y = -(up[0] * rays_x + up[2]) / up[1]
    rows = view.K[1, 1] * rays_y + view.K[1, 2]
    line = np.stack([columns, rows], -1)
    if rows.max() < -view.margin - 2 or up[1] > 0:
        return None
    if map_points is not None:
        line = map_points(line)
    top = min(-view.margin - 10.0, line[:, 1].min() - 1)
    return np.concatenate([[[line[0, 0] - 50, top], [line[-1, 0] + 50, top]], line[::-1]])[None]


def coverages(prints, view, map_points=None, spread=None):
    """Return exact coverages of the whole array incl. margin: (plates, black, sky), each (H + 2m, W + 2m).

    map_points takes ideal pixels (n, 2) to image pixels; None is the pinhole. ``spread`` says where the parts of the light
    of image pixels land (effects.pipeline.light_spread); None: all stays.
    """
    m = view.margin
    shape = (view.height + 2 * m, view.width + 2 * m)

    def fill(parts):
        acc = np.zeros((shape[0], shape[1] + 2))
        for pixels in parts:
            vertices = np.ascontiguousarray(pixels + (m + 0.5))
            if spread is None:
                add_polygons(acc, vertices, np.ones(len(vertices)))
            else:
                directions, shares = spread(pixels.reshape(-1, 2))
                add_spread_polygons(acc, vertices, directions.reshape(*pixels.shape[:2], *directions.shape[1:]), shares)
        return running_sums(acc)

    return [fill(parts) for parts in drawn_polygons(prints, view, map_points)]


def window_coverages(prints, view, atlas, map_points=None, spread=None):
    """Return (plates, black, sky) as ``coverages``, of a gap.pixels.windows.Atlas, each of its whole shape."""

    def fill(parts):
        out = np.zeros(atlas.whole_shape)
        for pixels in parts:
            vertices = np.ascontiguousarray(pixels)
            if spread is None:
                windows.draw(vertices, atlas.tiles, out)
            else:
                directions, shares = spread(pixels.reshape(-1, 2))
                directions = np.ascontiguousarray(directions.reshape(*pixels.shape[:2], *directions.shape[1:]))
                windows.draw_spread(vertices, directions, np.ascontiguousarray(shares), atlas.tiles, out)
        return out

    return [fill(parts) for parts in drawn_polygons(prints, view, map_points)]


def drawn_polygons(prints, view, map_points):
    """Return the polygons to draw, frame pixels, lists of arrays (n, m, 2): outlines of the plates, their black, the sky."""
    in_view = visible_plates(prints.outlines, view)

    def bent(polygons_world):
        pixels = project(view.K, view.T_cam_world, polygons_world)
        if map_points is None or not len(pixels):
            return [pixels]
        pieces, parts = _pieces(pixels), []
        for count in np.unique(pieces):
            cut = project(view.K, view.T_cam_world, _subdivide(polygons_world[pieces == count], count))
            parts.append(map_points(cut.reshape(-1, 2)).reshape(cut.shape))
        return parts

    horizon = sky_polygon(view, map_points)
    blacks = prints.blacks[np.isin(prints.plate_of_black, np.flatnonzero(in_view))]
    black = bent(blacks) + _disc_parts(prints, in_view, view, map_points)
    return bent(prints.outlines[in_view]), black, [] if horizon is None else [horizon]


def _disc_parts(prints, in_view, view, map_points):
    """Return the polygons (n, m, 2) of the discs on plates in view, frame pixels, those of one number of corners together."""
    seen = in_view[prints.plate_of_disc]
    if not seen.any():
        return []

    def bent(world):
        pixels = project(view.K, view.T_cam_world, world)
        return pixels if map_points is None else map_points(pixels.reshape(-1, 2)).reshape(pixels.shape)

    rough = project(view.K, view.T_cam_world, prints.disc_polygons(seen, 8))
    radii = np.ptp(rough, axis=1).max(axis=1) / 2
    pieces = np.zeros(len(seen), int)
    pieces[seen] = pieces_of(radii, DISC_SAGITTA_PX)
    parts = [bent(prints.disc_polygons(pieces == count, count)) for count in np.unique(pieces[seen])]
    shared = prints.shared[in_view[prints.plate_of_shared]]
    return parts + [bent(shared)] if len(shared) else parts


def visible_plates(outlines, view):
    """Return a mask (p,) of the plates that touch the array (frame and margin) and lie wholly before the camera."""
    if not len(outlines):
        return np.zeros(0, bool)
    depth = transform(view.T_cam_world, outlines)[..., 2]
    pixels = project(view.K, view.T_cam_world, outlines)
    m = view.margin
    inside = (
        (np.nanmax(pixels[..., 0], 1) > -m - 1)
        & (np.nanmin(pixels[..., 0], 1) < view.width + m)
        & (np.nanmax(pixels[..., 1], 1) > -m - 1)
        & (np.nanmin(pixels[..., 1], 1) < view.height + m)
    )
    return inside & (depth > 1e-3).all(1)


def is_lit(scene):
    """Return whether the scene has a light of its own: then shading needs the ground's points."""
    return scene.light is not None or scene.highlight is not None


def shade(scene, view, plates, black, sky, ground=None):
    """Return the linear radiance (H + 2m, W + 2m) of coverages under the scene's light.

    The light varies slowly: it is taken at each pixel's centre on the ground plane z = 0, ``ground`` as ``ground_points``
    gives it, needed where the scene ``is_lit``.
    """
    radiance = scene.ground + (scene.white - scene.ground) * plates + (scene.black - scene.white) * black
    if scene.light is not None:
        radiance = radiance * light_factor(scene.light, *ground)
    if scene.highlight is not None:
        glossy = plates > 0
        x, y = (g[glossy] for g in ground)
        radiance[glossy] += plates[glossy] * highlight_radiance(scene.highlight, view, x, y)
    return radiance * (1 - sky) + scene.background * sky


def ground_points(view, map_points):
    """Return world x and y (H + 2m, W + 2m) of the ground seen at each pixel; far away above the horizon."""
    m = view.margin
    columns = np.arange(-m, view.width + m, dtype=np.float32)
    rows = np.arange(-m, view.height + m, dtype=np.float32)
    return ground_seen_at(view, map_points, *np.meshgrid(columns, rows))


def ground_seen_at(view, map_points, x, y):
    """Return world x and y (rows, columns) float32 of the ground seen at frame pixels x, y (rows, columns) float32.

    A lens bends rays: its map is inverted on a coarse grid and interpolated.
    """
    at = [(c + np.float32(view.margin)) / np.float32(GROUND_STEP_PX) for c in (x, y)]
    ideal = _ideal_grid(view, map_points)
    u, v = (cv2.remap(ideal[..., k], *at, cv2.INTER_LINEAR, borderMode=cv2.BORDER_REPLICATE) for k in (0, 1))
    (fx, _, cx), (_, fy, cy) = view.K[:2].tolist()
    x, y = (u - cx) / fx, (v - cy) / fy
    R, t = view.T_cam_world[:3, :3], view.T_cam_world[:3, 3]
    centre, R = (-R.T @ t).tolist(), R.tolist()  # Python's numbers leave float32 what it is
    along_x, along_y, along_z = (R[0][k] * x + R[1][k] * y + R[2][k] for k in range(3))
    distance = np.full_like(x, MAX_GROUND_M)
    down = along_z < -1e-6
    distance[down] = np.minimum(-centre[2] / along_z[down], MAX_GROUND_M)
    return centre[0] + distance * along_x, centre[1] + distance * along_y


def _ideal_grid(view, map_points):
    """Return the ideal pixels (rows, columns, 2) float32 of image pixels GROUND_STEP_PX apart: a lens inverted by fixed-point
    steps.
    """
    m, step = view.margin, GROUND_STEP_PX
    columns = np.arange(-m, view.width + m + step, step, dtype=float)
    rows = np.arange(-m, view.height + m + step, step, dtype=float)
    grid = np.stack(np.meshgrid(columns, rows), axis=-1)
    if map_points is None:
        return grid.astype(np.float32)
    target = grid.reshape(-1, 2)
    ideal = target.copy()
    for _ in range(8):
        missing = target - map_points(ideal)
        ideal += missing
        if np.abs(missing).max() < GROUND_OFF_PX:
            break
    return ideal.reshape(grid.shape).astype(np.float32)
