"""The study of poses: the poses are those that the table tells, errors, flips and covariances are right, maps count rightly."""

import numpy as np
import pandas as pd
import pytest

from blender.renderer import Renderer
from detectors.contract import Detection, estimate_poses
from effects.encoding import srgb_encode
from id_study.views import study_marker
from inputs.tables import CORNERS
from map_poses import map_poses, telling_poses
from poses_study.errors import corner_jacobian, pose_errors, ratio_of, unit_covariances
from poses_study.maps import MEASURES, Plane, cells_of, draw_maps
from poses_study.measures import by_detector, by_pose, corner_sigma, image_table, with_trust
from poses_study.views import (
    HEIGHT_PX,
    PLACES,
    WIDTH_PX,
    K,
    digitised,
    expected_levels,
    pose_of,
    pose_table,
    scene_of,
    study_noise,
    true_corners,
    view_of,
)
from rig.geometry import invert_pose, make_pose, perturb_pose, project
from rig.plates import marker_corners_plate
from study_poses import SIGHTINGS, sighting

FAMILY, CODE_M = "DICT_5X5_1000", 0.07
RANGES = {"nearest_m": 0.4, "farthest_m": 4.0, "steepest_deg": 80.0}


def poses(count, **changes):
    return pose_table(count, **(RANGES | changes), seed="seed")


def sightings(table, corners_of, draws=4, detector="x"):
    """Return sightings of all poses; corners_of(row, draw) gives the corners (4, 2) or None."""
    rows = []
    for row in table.itertuples():
        for draw in range(draws):
            corners = corners_of(row, draw)
            corners = np.full(8, np.nan) if corners is None else np.ravel(corners)
            rows.append([FAMILY, row.pose, detector, 0, draw, 0, *corners])
    return pd.DataFrame(rows, columns=list(SIGHTINGS.columns))


def test_poses_are_even_in_all_six_and_a_longer_study_begins_with_a_shorter():
    """Fails if a degree of freedom bunches, hangs on another, or if more poses are all others."""
    table = poses(1000)
    pd.testing.assert_frame_equal(poses(100), table.head(100))
    assert (pose_table(100, **RANGES, seed="other")[PLACES] != table.head(100)[PLACES]).all(axis=None)
    shares = table[PLACES].assign(distance_m=np.log(table.distance_m))
    region = (table.x_px - K[0, 2]) / (table.x_px - K[0, 2]).abs().max()
    for name in ("distance_m", "azimuth_deg", "obliqueness_deg", "roll_deg"):
        counts, _ = np.histogram(shares[name], bins=10)
        assert counts.min() > 90 and counts.max() < 110, name
    others = np.corrcoef(np.column_stack([shares.drop(columns=["x_px", "y_px"]), region]).T) - np.eye(5)
    assert np.abs(others).max() < 0.05
    assert table.distance_m.between(0.4, 4).all() and table.obliqueness_deg.max() < 80


def test_a_pose_is_what_its_row_tells():
    """Fails if azimuth or roll run the other way, an angle is taken to the axis and not to the line of sight, or the place is
    missed.
    """
    for row in poses(60).itertuples():
        T = pose_of(row)
        assert np.isclose(np.linalg.det(T[:3, :3]), 1)
        np.testing.assert_allclose(project(K, T, np.zeros(3)), [row.x_px, row.y_px], atol=1e-6)
        camera = invert_pose(T)[:3, 3]
        assert np.isclose(np.linalg.norm(camera), row.distance_m)
        assert np.isclose(np.degrees(np.arccos(camera[2] / row.distance_m)), row.obliqueness_deg, atol=1e-5)
        assert np.isclose(np.degrees(np.arctan2(camera[1], camera[0])) % 360, row.azimuth_deg)
        corners = true_corners(FAMILY, 0, row)
        turned = true_corners(FAMILY, 0, row._replace(roll_deg=row.roll_deg + 5))
        u, v = (c[0] - [row.x_px, row.y_px] for c in (corners, turned))
        assert u[0] * v[1] - u[1] * v[0] > 0  # clockwise, as y runs down


@pytest.mark.parametrize("nearest", [0.3, 0.4, 2.0])
def test_plates_are_wholly_in_the_picture_and_come_near_its_rim(nearest):
    """Fails if a plate is cut by the frame, which would be a miss of no detector, or if poses keep to the middle."""
    outline = scene_of(FAMILY, 0).plates[0].outline_world()
    table = poses(400, nearest_m=nearest)
    seen = np.stack([project(K, pose_of(row), outline) for row in table.itertuples()])
    assert seen.min() > -0.5 and (seen < np.array([WIDTH_PX, HEIGHT_PX]) - 0.5).all()
    assert seen[..., 0].min() < 25 and seen[..., 1].max() > HEIGHT_PX - 25


@pytest.mark.parametrize("number", [1, 4])
def test_a_pose_looks_as_blender_renders_it(tmp_path, number):
    """Fails if the study's own drawing leans to one side of Blender's, or shows a horizon."""
    row = list(poses(10).itertuples())[number]
    view, scene = view_of(row), scene_of(FAMILY, 0)
    renderer = Renderer(scene, view.K, WIDTH_PX, HEIGHT_PX, 0, 256, 1, tmp_path / "blender")
    try:
        rendered = 255 * srgb_encode(renderer.render(view.T_cam_world))
    finally:
        renderer.close()
    off = (rendered - expected_levels(scene, view))[2:-2, 2:-2]
    near = np.abs(off) > 0.6
    assert np.abs(off).max() < 12 and np.sqrt((off[near] ** 2).sum() / near.sum().clip(1)) < 2.5
    assert abs(off.mean()) < 0.05


def test_draws_differ_and_are_the_same_again():
    """Fails if noise depends on order, is the same in all draws, or is not of one grey level."""
    levels = np.full((HEIGHT_PX, WIDTH_PX), 100, np.float32)
    images = [digitised(levels, study_noise(draw, "seed")).astype(float) for draw in (0, 0, 1)]
    np.testing.assert_array_equal(images[0], images[1])
    assert 1.9 < (images[0] - images[2]).var() < 2.4


def test_a_sighting_is_the_nearest_right_id_and_the_others_are_false():
    """Fails if a right id elsewhere counts as seen, or false ids are forgotten."""
    square = np.array([[-5, -5], [5, -5], [5, 5], [-5, 5]], float)
    place = (np.array([50.0, 40.0]), 6.0)
    found = [Detection(FAMILY, 0, square + p) for p in ([53, 40], [51, 40], [90, 40])] + [Detection(FAMILY, 7, square)]
    corners, false = sighting(found, FAMILY, 0, place)
    np.testing.assert_array_equal(corners, square + [51, 40])
    assert false == 2
    corners, false = sighting(found[2:], FAMILY, 0, place)
    assert np.isnan(corners).all() and false == 2


def test_the_other_pose_of_the_plane_is_a_flip_and_a_wrong_one_is_not():
    """Fails if flips pass as errors, errors as flips, or if a distance or a turn is told wrongly."""
    T = make_pose([2.6, 0.4, 0.3], [0.1, -0.05, 2.0])
    square = marker_corners_plate(CODE_M)
    true = project(K, T, square)
    (_, _, _), (rvec, tvec, _) = estimate_poses(true, CODE_M, K)
    moved = T.copy()
    moved[:3, 3] *= 1.01
    turn = make_pose(np.radians([0, 0, 4]), np.zeros(3))
    turned = T.copy()
    turned[:3, :3] = turn[:3, :3] @ T[:3, :3]
    seen = np.stack([true, project(K, make_pose(rvec, tvec), square), project(K, moved, square)])
    seen = np.concatenate([seen, project(K, turned, square)[None], np.full((1, 4, 2), np.nan)])
    errors = pose_errors(seen, T, true, CODE_M, K)
    assert errors["flipped"].tolist() == [False, True, False, False, False]
    distance = np.linalg.norm(T[:3, 3])
    np.testing.assert_allclose(errors["distance_error_m"][[0, 2, 3]], [0, 0.01 * distance, 0], atol=2e-5)
    np.testing.assert_allclose(errors["rotvec_deg"][[0, 3]], [[0, 0, 0], [0, 0, 4]], atol=0.02)
    assert np.isnan(errors["distance_error_m"][4]) and np.isnan(errors["rotvec_deg"][4]).all()


def test_the_jacobian_is_that_of_differences():
    """Fails if a sign is wrong, or the marker turns about the camera and not about itself."""
    T = pose_of(next(poses(3).itertuples()))
    J, square, step = corner_jacobian(T, CODE_M, K), marker_corners_plate(CODE_M), 1e-6
    for k in range(6):
        sides = []
        for sign in (1, -1):
            delta = np.zeros(6)
            delta[k] = sign * step
            moved = perturb_pose(T, delta)
            if k < 3:
                moved[:3, 3] = T[:3, 3]
            sides.append(project(K, moved, square).ravel())
        np.testing.assert_allclose(J[:, k], (sides[0] - sides[1]) / (2 * step), rtol=1e-4, atol=1e-2)


def test_scatter_is_the_predicted_one_where_corners_are_independent():
    """Fails if the covariance is wrong by a factor, or if corners that err together pass for independent ones."""
    table = poses(500, nearest_m=0.4, farthest_m=0.8, steepest_deg=80)
    table = table[table.obliqueness_deg > 30]
    rng = np.random.default_rng(1)
    noisy = sightings(table, lambda row, draw: true_corners(FAMILY, 0, row) + rng.normal(0, 0.05, (4, 2)))
    images = with_trust(image_table(noisy, table, CODE_M))
    told = by_detector(images)
    for name in ("distance_scatter_ratio", "rotation_scatter_ratio", "distance_error_ratio", "rotation_error_ratio"):
        assert 0.93 < told[name] < 1.07, (name, told[name])
    assert np.isclose(corner_sigma(images), 0.05, rtol=0.05) and np.isclose(told["corner_scatter_px"], 0.05, rtol=0.1)
    outward = sightings(table, lambda row, draw: _grown(true_corners(FAMILY, 0, row), rng.normal(0, 0.05)))
    assert by_detector(with_trust(image_table(outward, table, CODE_M)))["distance_scatter_ratio"] > 1.3


def _grown(corners, px):
    away = corners - corners.mean(axis=0)
    return corners + px * away / np.linalg.norm(away, axis=1, keepdims=True)


def test_a_steady_error_is_no_scatter():
    """Fails if a bias of all draws is taken for scatter, or scatter of none for a good prediction."""
    table = poses(20, farthest_m=0.8)
    steady = sightings(table, lambda row, draw: _grown(true_corners(FAMILY, 0, row), -0.5))
    told = by_detector(with_trust(image_table(steady, table, CODE_M)))
    assert told["corner_scatter_px"] == 0 and np.isnan(told["distance_scatter_ratio"])
    assert told["distance_bias_pct"] > 0.5 and told["distance_error_ratio"] > 1
    rng = np.random.default_rng(3)
    noisy = steady.assign(**{name: steady[name] + rng.normal(0, 0.05, len(steady)) for name in CORNERS})
    told = by_detector(with_trust(image_table(noisy, table, CODE_M)))
    assert 0.7 < told["distance_scatter_ratio"] < 1.3 and told["distance_error_ratio"] > 1


def test_ratios_are_one_for_a_normal_distribution():
    """Fails if the median is not that of chi-square with as many directions."""
    values = np.random.default_rng(2).normal(0, 1, (20000, 3))
    assert np.isclose(ratio_of((values**2).sum(axis=1), 3), 1, atol=0.02)
    assert np.isclose(ratio_of((2 * values[:, 0]) ** 2, 1), 2, atol=0.05)
    assert np.isnan(ratio_of([np.nan], 1))
    variance, turn = unit_covariances(make_pose([np.pi, 0, 0], [0, 0, 1.0]), CODE_M, K)
    # straight ahead the size, and so the distance, is told by eight coordinates, each half a side off the middle
    side_px = K[0, 0] * CODE_M
    assert np.isclose(np.sqrt(variance), np.sqrt(1 / 2) / side_px, rtol=1e-3) and turn.shape == (3, 3)


def test_flips_and_misses_are_counted_and_in_no_error():
    """Fails if a flip's error enters the means, coverage counts poses that were missed, or draws are lost."""
    table = poses(400, nearest_m=1.0)
    table = table[table.obliqueness_deg.between(40, 60)].head(10)

    def seen(row, draw):
        true = true_corners(FAMILY, 0, row)
        if row.Index == table.index[0]:
            return None
        if row.Index == table.index[1] and draw < 2:
            _, (rvec, tvec, _) = estimate_poses(true, CODE_M, K)
            return project(K, make_pose(rvec, tvec), marker_corners_plate(CODE_M))
        return true

    images = with_trust(image_table(sightings(table, seen), table, CODE_M))
    told, rows = by_detector(images), by_pose(images)
    assert (told["poses"], told["images"], told["coverage_pct"]) == (10, 40, 90.0)
    assert told["coverage_pct_low"] < 70 and told["coverage_pct_high"] < 99
    assert np.isclose(told["flip_rate_pct"], 100 * 2 / 36)
    assert told["rotation_error_95_deg"] < 0.01 and told["distance_error_95_pct"] < 0.01
    assert rows.rotation_scatter_deg.max() < 0.01 and rows.corner_scatter_px.max() < 0.01
    assert rows.found.tolist() == [0] + [4] * 9 and rows.flipped.tolist() == [0, 2] + [0] * 8
    assert rows.rotation_error_deg.isna().tolist() == [True] + [False] * 9 and rows.rotation_error_deg.max() < 0.01


def test_a_cell_of_a_map_counts_its_own_images():
    """Fails if rows and columns are exchanged, a cell's neighbour counts, or few poses pass for many."""
    images = pd.DataFrame(
        {
            "pose": list("aabbccdd"),
            "x_px": [1.0] * 6 + [11.0] * 2,
            "y_px": [11.0] * 6 + [1.0] * 2,
            "found": [True, False] * 3 + [True] * 2,
            "flipped": False,
        }
    )
    plane = Plane("", "x_px", "y_px", np.array([0.0, 10, 20]), np.array([0.0, 10, 20]))
    cells = cells_of(images, MEASURES["coverage"], plane)
    np.testing.assert_array_equal(cells, [[np.nan, np.nan], [50, np.nan]])


def test_nothing_found_is_told_and_drawn(tmp_path):
    """Fails if a detector that finds nothing ends the study, or is left out of its tables."""
    table = poses(8)
    nothing = sightings(table, lambda row, draw: None)
    exact = sightings(table, lambda row, draw: true_corners(FAMILY, 0, row), detector="y")
    SIGHTINGS.validate(pd.concat([nothing, exact])).to_csv(tmp_path / "in.csv", index=False)
    made = []
    for name in ("a", "b"):
        map_poses([tmp_path / "in.csv"], [FAMILY], 4, 8, RANGES, "seed", tmp_path / name)
        files = sorted(path for path in (tmp_path / name).rglob("*.*") if path.is_file())
        made.append({str(path.relative_to(tmp_path / name)): path.read_bytes() for path in files})
    assert made[0] == made[1]
    told = pd.read_csv(tmp_path / "a/detectors.csv").set_index("detector")
    assert told.coverage_pct.to_dict() == {"x": 0, "y": 100} and np.isnan(told.rotation_error_deg["x"])
    assert set(made[0]) == {"poses.csv", "detectors.csv", "report.html"} | {f"maps/{FAMILY}/{m}.png" for m in MEASURES}
    page = made[0]["report.html"]
    assert b"missed, the largest" in page and b">nan" not in page and b" nan" not in page


def test_poses_shown_are_the_largest_that_failed():
    """Fails if small markers, which everybody misses, are shown in the place of large ones, or good poses as bad ones."""
    table = pd.DataFrame(
        {
            "pose": [f"p{k}" for k in range(9)],
            "side_px": [10.0, 50, 40, 30, 20, 60, 70, 80, 90],
            "found": [0, 0, 0, 0, 0, 0, 5, 5, 5],
            "flipped": [0] * 6 + [5, 1, 0],
            "rotation_error_deg": [np.nan] * 7 + [1.0, 2.0],
        }
    )
    shown = {words: rows.pose.tolist() for words, rows in telling_poses(table)}
    assert shown["missed, the largest"] == ["p5", "p1", "p2", "p3", "p4"]
    assert shown["flipped, the largest"] == ["p7", "p6"]
    assert shown["most turned, not flipped"] == ["p8", "p7"]


def test_maps_have_a_row_a_detector():
    """Fails if a picture leaves detectors out."""
    table = poses(30)
    images = with_trust(image_table(sightings(table, lambda row, draw: true_corners(FAMILY, 0, row)), table, CODE_M))
    one, two = (
        np.frombuffer(draw_maps(dict.fromkeys(names, images), "coverage", table, 80.0)[16:24], ">u4")
        for names in ("a", "ab")
    )
    assert one[0] == two[0] and two[1] > 1.5 * one[1]


def test_the_marker_is_that_of_the_other_study():
    """Fails if the print has another size: errors in metres would be of another marker."""
    assert study_marker(FAMILY, 0).code_m == CODE_M and len(CORNERS) == 8
