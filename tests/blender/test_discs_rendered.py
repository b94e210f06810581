"""Markers with discs as Blender renders them, held to the drawing that the fit uses; cells go a way of their own."""

from types import SimpleNamespace

import numpy as np
import pytest

from blender.faces import plate_faces
from blender.renderer import Renderer
from effects.base import Scene, View
from effects.encoding import srgb_encode
from gap.predict.synthesis import Prints, coverages, shade
from markers.contract import marker_plate
from rig.geometry import camera_matrix, station_pose
from rig.plates import spread_ink

WIDTH, HEIGHT, MARGIN = 120, 90, 8
K = camera_matrix(260.0, 260.0, 59.5, 44.5)


def rig(ink_spread_m=0.0):
    place = {"z": 0.0, "rx": 0.0, "ry": 0.0, "plate_m": 0.11}
    rows = [
        SimpleNamespace(dictionary="STAG_HD15", id=321, code_m=0.08, x=-0.08, y=0.43, rz=0.2, **place),
        SimpleNamespace(dictionary="tagStandard41h12", id=99, code_m=0.055, x=0.07, y=0.4, rz=-0.3, **place),
    ]
    return Scene(tuple(marker_plate(m) for m in rows), 0.8, 0.05, 0.35, 0.3, ink_spread_m=ink_spread_m)


@pytest.mark.parametrize("ink_spread_m", [0.0, 0.0003])
def test_blender_renders_what_the_fit_draws(tmp_path, ink_spread_m):
    """Fails if discs are missing, lie elsewhere, hide one another or fight the plate below them for a ray."""
    scene, T = rig(ink_spread_m), station_pose(0.35, 40)
    renderer = Renderer(scene, K, WIDTH, HEIGHT, MARGIN, 256, 1, tmp_path / "blender")
    try:
        rendered = renderer.render(T)
    finally:
        renderer.close()
    view = View(K, WIDTH, HEIGHT, MARGIN, T, "c", "a", "s")
    plates = [spread_ink(p, ink_spread_m) if ink_spread_m else p for p in scene.plates]
    drawn = shade(scene, view, *coverages(Prints(plates), view))
    error = (255 * srgb_encode(rendered) - 255 * srgb_encode(drawn))[2:-2, 2:-2]
    edge = np.abs(drawn[2:-2, 2:-2, None] - np.array([0.8, 0.05, 0.35, 0.3])).min(axis=2) > 1e-6
    assert edge.sum() > 500
    assert np.sqrt((error[edge] ** 2).mean()) < 1.0 and abs(error[edge].mean()) < 0.1
    assert np.abs(error[~edge]).max() < 0.1


def test_faces_cover_a_plate_once():
    """Fails if faces overlap, leave gaps, or if one has the colour of what was painted before it."""
    for plate in rig().plates:
        points, faces, white = plate_faces(plate)
        areas = np.zeros(2)
        for face, is_white in zip(faces, white, strict=True):
            corners = points[list(face), :2]
            x, y = corners.T
            area = (x * np.roll(y, -1) - np.roll(x, -1) * y).sum() / 2
            assert area > -1e-12
            areas[int(is_white)] += area
        cells = np.diff(plate.y_m)[:, None] * np.diff(plate.x_m)[None, :]
        black = cells[~plate.white].sum()
        if len(plate.discs):
            black += np.pi * (plate.discs[1:, 2] ** 2).sum() - np.pi * plate.discs[0, 2] ** 2
        assert areas.sum() == pytest.approx(cells.sum(), rel=1e-6)
        assert areas[0] == pytest.approx(black, rel=1e-4)
