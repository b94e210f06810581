"""Blender's renders held to exact area coverage, to the pixel convention and to the formulas of the scene's light."""

import numpy as np
import pandas as pd
import pytest
from exact_coverage import exact_radiance, sky_coverage

from blender.edges import edge_pixels, edge_segments
from blender.renderer import Renderer
from effects.base import Scene, View, highlight_radiance, light_factor
from markers.contract import marker_plate
from rig.geometry import camera_matrix, invert_pose, make_pose, project, station_pose
from rig.plates import spread_ink

WIDTH, HEIGHT, MARGIN = 160, 120, 12
K = camera_matrix(150.0, 150.0, 79.5, 59.5)


def encoded(radiance):
    """Return sRGB grey levels of 8 bits, unrounded (IEC 61966-2-1)."""
    v = np.maximum(radiance, 1e-9)
    return 255 * np.where(v <= 0.0031308, 12.92 * v, 1.055 * v ** (1 / 2.4) - 0.055)


def rig(**changes):
    """Return a scene of four plates, one turned, one far away."""
    rows = [(3, 0.0, 0.35, 0), (7, 0.16, 0.5, 0.4), (11, -0.17, 0.6, 0), (19, 0.05, 2.5, 0)]
    columns = ["dictionary", "id", "code_m", "plate_m", "x", "y", "z", "rx", "ry", "rz"]
    table = pd.DataFrame([["DICT_5X5_1000", i, 0.1, 0.13, x, y, 0, 0, 0, r] for i, x, y, r in rows], columns=columns)
    plates = tuple(marker_plate(m) for m in table.itertuples())
    return Scene(plates, 0.8, 0.05, 0.35, 0.3).with_(**changes)


@pytest.fixture
def render(tmp_path):
    """Return a function that renders a scene from a pose."""

    def rendered(scene, T, K=K, samples=256):
        renderer = Renderer(scene, K, WIDTH, HEIGHT, MARGIN, samples, 1, tmp_path / "blender")
        try:
            return renderer.render(T)
        finally:
            renderer.close()

    return rendered


def assert_exact(got, scene, T, K=K):
    """Edges within a grey level (RMS), no lean to either side, flats exact."""
    exact, edge = exact_radiance(scene, K, T, WIDTH, HEIGHT, MARGIN)
    error = encoded(got) - encoded(exact)
    assert edge.sum() > 500
    assert np.sqrt((error[edge] ** 2).mean()) < 1.0
    assert abs(error[edge].mean()) < 0.1
    assert np.abs(error[~edge]).max() < 0.1


def test_render_is_exact_coverage(render):
    """Were the pixel not a box, half a pixel off or edges poorly sampled, coverage would differ."""
    T = station_pose(0.3, 30)
    assert_exact(render(rig(), T), rig(), T)


def test_pixels_that_are_not_square_and_an_off_centre_axis(render):
    """Were fx, fy, cx or cy mixed up anywhere, a camera with four different values would show it; so would roll."""
    odd = camera_matrix(150.0, 171.3, 71.2, 66.9)
    T = make_pose([0.05, -0.1, 0.3], [0.02, 0.0, 0.05]) @ station_pose(0.35, 40)
    assert_exact(render(rig(), T, odd), rig(), T, odd)


def test_horizon_lies_within_a_hundredth_of_a_pixel(render):
    """Were the ground finite or lowered without care, the horizon would sink."""
    scene = rig(plates=rig().plates[:1])
    T = make_pose([0, 0, 0.02], [0, 0, 0]) @ station_pose(0.9, 10)
    got = render(scene, T, samples=1024)
    sky = (got - scene.ground) / (scene.background - scene.ground)
    columns = slice(MARGIN, -MARGIN)
    exact = sky_coverage(K, T, got.shape, MARGIN)
    height = (sky - exact)[: got.shape[0] // 2, columns].sum(axis=0)  # pixels by which the sky reaches too far down
    assert abs(height.mean()) < 0.002
    assert np.abs(height).max() < 0.02


def test_lifted_and_tilted_plates_are_where_they_are(render):
    """Were plates laid on the ground again, a bent rail would not show."""
    lift = make_pose([0.2, 0.1, 0], [0, 0, 0.05])
    plates = tuple(p.__class__(p.name, lift @ p.T_world_plate, p.x_m, p.y_m, p.white) for p in rig().plates[:3])
    T = station_pose(0.4, 40)
    assert_exact(render(rig(plates=plates), T), rig(plates=plates), T)


@pytest.mark.parametrize("spread_m", [0.004, -0.003])
def test_ink_spread_moves_the_boundaries_of_black(render, spread_m):
    """Were ink spread ignored or of the wrong sign, the edges would lie elsewhere."""
    T = station_pose(0.3, 30)
    got = render(rig(ink_spread_m=spread_m), T)
    assert_exact(got, rig(plates=tuple(spread_ink(p, spread_m) for p in rig().plates)), T)


def test_mount_moves_the_camera(render):
    """Were the mount applied on the wrong side, the rig would be seen from elsewhere."""
    mount, T = make_pose([0.03, -0.05, 0.1], [0.01, 0.02, -0.03]), station_pose(0.3, 30)
    assert np.array_equal(render(rig(T_cam_mount=mount), T), render(rig(), mount @ T))


def ground_points(T):
    """Return x, y (metres) of the ground that each pixel's centre sees."""
    rows, columns = np.mgrid[: HEIGHT + 2 * MARGIN, : WIDTH + 2 * MARGIN] - MARGIN
    rays = np.stack([(columns - K[0, 2]) / K[0, 0], (rows - K[1, 2]) / K[1, 1], np.ones(rows.shape)], axis=-1)
    T_world_cam = invert_pose(T)
    d = rays @ T_world_cam[:3, :3].T
    points = T_world_cam[:3, 3] - d * (T_world_cam[2, 3] / d[..., 2:])
    return points[..., 0], points[..., 1]


@pytest.mark.parametrize("levelling_per_m2", [0.0, 4.0])
def test_light_and_highlight_follow_their_formulas(render, levelling_per_m2):
    """Were Blender's shading another than effects.base says, the fit's fast shading would be fitted to a fiction."""
    lamp = {"x_m": 0.1, "y_m": 1.0, "height_m": 1.2, "strength": 0.4, "roughness": 0.25, "fresnel": 0.8}
    light = {"gradient_x": 0.3, "gradient_y": -0.2, "levelling_per_m2": levelling_per_m2}
    light |= {"lamp_share": 0.3, "lamp_x_m": -0.6, "lamp_y_m": 0.3, "lamp_height_m": 1.6}
    T = station_pose(0.4, 60)  # no horizon
    got = render(rig(light=light, highlight=lamp), T)
    plain, edge = exact_radiance(rig(), K, T, WIDTH, HEIGHT, MARGIN)
    x, y = ground_points(T)
    view = View(K, WIDTH, HEIGHT, MARGIN, T, "c", "0", "0")
    on_plate = np.abs(plain - rig().ground) > 1e-3
    wanted = plain * light_factor(light, x, y) + on_plate * highlight_radiance(lamp, view, x, y)
    assert highlight_radiance(lamp, view, x, y)[on_plate].max() > 0.1
    error = (got - wanted)[~edge]  # one ray a pixel, anywhere in it: light that changes within it is noise
    assert abs(error.mean()) < 2e-4 and np.abs(error).max() < 4e-3


def test_stations_do_not_depend_on_what_was_rendered_before(tmp_path):
    """Were something left over between stations, a killed run that goes on would give other pixels."""
    renderer = Renderer(rig(), K, WIDTH, HEIGHT, MARGIN, 64, 1, tmp_path / "blender")
    poses = [station_pose(0.3, 30), station_pose(0.5, 60), station_pose(0.3, 30)]
    first, _, again = [renderer.render(T) for T in poses]
    renderer.close()
    assert np.array_equal(first, again)
    assert not (tmp_path / "blender").exists()


def test_every_pixel_that_an_edge_crosses_is_known():
    """Were an edge's pixel overlooked, it would get one sample: a jagged edge."""
    for T in (station_pose(0.3, 0), station_pose(0.3, 30), make_pose([0, 0, 1.57], [0, 0, 0]) @ station_pose(0.5, 20)):
        exact, _ = exact_radiance(rig(), K, T, WIDTH, HEIGHT, MARGIN)
        known = edge_pixels(edge_segments(rig().plates), K, T, exact.shape, MARGIN)
        levels = [0.8, 0.05, 0.35, 0.3]
        mixed = np.min([np.abs(exact - level) for level in levels], axis=0) > 1e-3
        assert mixed.sum() > 100
        assert not (mixed & ~known).any()
        assert known.mean() < 0.5


def test_projection_of_plates_is_in_the_frame():
    """The scenes of these tests must show plates, or the tests above prove nothing."""
    for T in (station_pose(0.3, 30), station_pose(0.4, 60)):
        centres = project(K, T, np.array([p.T_world_plate[:3, 3] for p in rig().plates]))
        assert ((centres > 0) & (centres < [WIDTH, HEIGHT])).all(axis=1).sum() >= 2


def test_adaptive_sampling_is_exact_too(tmp_path):
    """A GPU renders this way: were its camera or its samples other, renders would depend on the device."""
    odd = camera_matrix(150.0, 171.3, 71.2, 66.9)
    T = station_pose(0.3, 30)
    renderer = Renderer(rig(), odd, WIDTH, HEIGHT, MARGIN, 256, 1, tmp_path / "blender")
    renderer.render(T)
    assert_exact(renderer._render_adaptively(), rig(), T, odd)
    renderer.close()
