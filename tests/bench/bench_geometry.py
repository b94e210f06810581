"""Geometry: Blender's renders of the embedded rig against exact area coverage and analytic projection.

``python tests/bench/bench_geometry.py`` prints a table and records it (record.py): error of pixels that an edge crosses (grey levels of
8 bits, sRGB) and of code corners (pixels; each plate's homography by least squares of its exact coverage, one step from the truth).
"""

import sys
import tempfile
from pathlib import Path

import numpy as np

ROOT = Path(__file__).resolve().parents[2]
sys.path[:0] = [str(ROOT / "scripts"), str(ROOT / "tests" / "blender")]

import pandas as pd  # noqa: E402
from exact_coverage import add_polygon, cells_of, exact_radiance  # noqa: E402

from expand_tables import expand_tables  # noqa: E402
from inputs import tables  # noqa: E402
from inputs.scene import load_scene  # noqa: E402
from record import record  # noqa: E402
from rig.geometry import camera_matrix, make_pose, project  # noqa: E402

CAMPAIGN = ROOT / "data/raw/frame"
MARGIN = 20
EDGE_SAMPLES = 256
SMALLEST_CODE_PX = 15
STEP_PX = 0.05


def encoded(radiance):
    """Return sRGB grey levels of 8 bits, unrounded."""
    v = np.maximum(radiance, 1e-9)
    return 255 * np.where(v <= 0.0031308, 12.92 * v, 1.055 * v ** (1 / 2.4) - 0.055)


def homography(source, target):
    """Return the 3 x 3 homography that takes four points (4, 2) to four others."""
    rows = []
    for (x, y), (u, v) in zip(source, target, strict=True):
        rows += [[x, y, 1, 0, 0, 0, -u * x, -u * y], [0, 0, 0, x, y, 1, -v * x, -v * y]]
    return np.append(np.linalg.solve(np.array(rows), np.asarray(target).ravel()), 1).reshape(3, 3)


def model(cells, levels, ground, shape, offset):
    """Return the radiance of a patch: cells [(n, 4, 2)] in array coordinates with their levels on even ground."""
    radiance = np.full(shape, float(ground))
    for polygons, level in zip(cells, levels, strict=True):
        coverage = np.zeros(shape)
        for polygon in polygons:
            add_polygon(coverage, polygon - offset)
        radiance += (level - ground) * coverage
    return radiance


def corner_errors(radiance, scene, plate, K, T, margin):
    """Return the errors (4, 2), pixels, of the code's corners in a render; None where the plate is cut or small."""
    x, y = plate.x_m[[1, -2]], plate.y_m[[1, -2]]
    corners = np.array([[x[0], y[1], 0], [x[1], y[1], 0], [x[1], y[0], 0], [x[0], y[0], 0]])
    code = corners @ plate.T_world_plate[:3, :3].T + plate.T_world_plate[:3, 3]
    cells = [project(K, T, cells_of(plate, w)) + margin + 0.5 for w in (True, False)]
    code = project(K, T, code) + margin + 0.5
    everything = np.concatenate([c.reshape(-1, 2) for c in cells])
    low, high = np.floor(everything.min(0)).astype(int) - 1, np.ceil(everything.max(0)).astype(int) + 1
    sides = np.linalg.norm(code - np.roll(code, 1, axis=0), axis=1)
    inside = np.isfinite(everything).all() and (low >= 0).all() and (high <= np.array(radiance.shape)[::-1]).all()
    if not inside or sides.min() < SMALLEST_CODE_PX:
        return None
    shape, levels = tuple((high - low)[::-1]), (scene.white, scene.black)
    patch = radiance[low[1] : high[1], low[0] : high[0]]

    def moved(k, step):
        target = code.copy()
        target[k // 2, k % 2] += step
        H = homography(code, target)
        parts = []
        for c in cells:
            p = np.concatenate([c, np.ones((*c.shape[:2], 1))], axis=2) @ H.T
            parts.append(p[..., :2] / p[..., 2:])
        return model(parts, levels, scene.ground, shape, low)

    J = np.stack([(moved(k, STEP_PX) - moved(k, -STEP_PX)).ravel() / (2 * STEP_PX) for k in range(8)], axis=1)
    residual = (patch - model(cells, levels, scene.ground, shape, low)).ravel()
    return np.linalg.lstsq(J, residual, rcond=None)[0].reshape(4, 2)


def main():
    """Print the table."""
    from blender.renderer import Renderer

    rows = []
    with tempfile.TemporaryDirectory() as folder:
        expand = Path(folder) / "expand"
        expand_tables(CAMPAIGN, None, None, expand)
        scene = load_scene(expand, None)
        stations = tables.read_table(expand / "stations.csv", tables.STATIONS)
        for c in tables.read_table(expand / "cameras.csv", tables.CAMERAS).itertuples():
            K = camera_matrix(c.fx, c.fy, c.cx, c.cy)
            renderer = Renderer(scene, K, c.width, c.height, MARGIN, EDGE_SAMPLES, 1, Path(folder) / "blender")
            edges, corners = [], []
            for s in stations[stations.camera == c.camera].itertuples():
                T = make_pose([s.rx, s.ry, s.rz], [s.tx, s.ty, s.tz])
                radiance = renderer.render(T)
                exact, edge = exact_radiance(scene, K, T, c.width, c.height, MARGIN)
                edges.append((encoded(radiance) - encoded(exact))[edge])
                found = [corner_errors(radiance, scene, p, K, T, MARGIN) for p in scene.plates]
                corners += [e for e in found if e is not None]
            renderer.close()
            edges, corners = np.concatenate(edges), np.concatenate(corners)
            rows.append(
                {
                    "camera": c.camera,
                    "edge_pixels": len(edges),
                    "edge_rms_dn": np.sqrt((edges**2).mean()),
                    "edge_mean_dn": edges.mean(),
                    "corners": len(corners),
                    "corner_rms_px": np.sqrt((corners**2).mean()),
                    "corner_mean_x_px": corners[:, 0].mean(),
                    "corner_mean_y_px": corners[:, 1].mean(),
                    "corner_worst_px": np.abs(corners).max(),
                }
            )
    table = pd.DataFrame(rows)
    print(table.round(4).to_markdown(index=False))
    mean = table[["corner_mean_x_px", "corner_mean_y_px"]].abs().to_numpy().max()
    low, high = table.edge_rms_dn.min(), table.edge_rms_dn.max()
    record(
        [
            ("corners in Blender's renders against projection, RMS", float(table.corner_rms_px.max()), "px"),
            ("corners in Blender's renders against projection, mean, the larger axis", float(mean), "px"),
            ("pixels that an edge crosses against exact coverage, RMS", f"{low:.2f} to {high:.2f}", "grey levels"),
        ]
    )


if __name__ == "__main__":
    main()
