"""The study of ids: what it counts, how far apart codes are, and that its views are what Blender renders."""

import cv2
import numpy as np
import pandas as pd
import pytest

from blender.renderer import Renderer
from detectors.contract import Detection
from effects.encoding import srgb_encode
from id_study.distances import cells_of, distances_between, nearest_others
from id_study.views import SIZE_PX, place_of, study_image, study_noise, study_scene, study_views
from markers.contract import count_of
from rank_ids import by_distance, by_family, by_id, confusions_of
from study_ids import READINGS, readings, study_ids


def rows(*values):
    table = pd.DataFrame(values, columns=list(READINGS.columns))
    return table.astype({"false_id": "Int64"})


def test_views_are_the_same_for_all_ids_and_spread_over_sizes_and_angles():
    """Fails if ids are seen from different places, under other noise, or if views bunch."""
    views = study_views(20)
    assert [v.capture for v in study_views(5)] == [v.capture for v in views[:5]]
    np.testing.assert_array_equal(study_views(5)[3].T_cam_world, views[3].T_cam_world)
    np.testing.assert_array_equal(study_noise(views[2], "a"), study_noise(views[2], "a"))
    assert np.abs(study_noise(views[2], "a") - study_noise(views[2], "b")).max() > 1
    halves = np.array([place_of("DICT_4X4_50", 3, v)[1] for v in views])
    tilts = np.degrees(np.arccos([v.T_cam_world[2, 2] * -1 for v in views]))
    assert halves.min() < 9 and halves.max() > 25
    assert tilts.min() < 10 and 60 < tilts.max() < 71 and np.all(np.diff(np.sort(tilts)) < 10)
    for family in ("DICT_4X4_50", "tagStandard41h12", "STAG_HD21"):
        image = study_image(study_scene(family, 3), views[4], 0.0)
        frame = np.concatenate([image[0], image[-1], image[:, 0], image[:, -1]])
        assert image.shape == (SIZE_PX, SIZE_PX) and np.ptp(frame.astype(int)) == 0 and image.max() > 220


@pytest.mark.parametrize("number", [1, 11])
def test_a_view_is_what_blender_renders(tmp_path, number):
    """Fails if the study's own drawing leans to one side of Blender's, or looks at the plate from elsewhere."""
    view, scene = study_views(20)[number], study_scene("DICT_ARUCO_ORIGINAL", 700)
    renderer = Renderer(scene, view.K, SIZE_PX, SIZE_PX, 0, 256, 1, tmp_path / "blender")
    try:
        rendered = 255 * srgb_encode(renderer.render(view.T_cam_world))
    finally:
        renderer.close()
    off = (rendered - study_image(scene, view, 0.0))[2:-2, 2:-2]
    assert np.sqrt((off[np.abs(off) > 0.6] ** 2).sum() / (np.abs(off) > 0.6).sum().clip(1)) < 2.5
    assert np.abs(off).max() < 12 and abs(off.mean()) < 0.3


def test_a_reading_counts_with_the_right_id_at_the_right_place():
    """Fails if a right id elsewhere counts as read, or a wrong one not as false."""
    square = np.array([[-5, -5], [5, -5], [5, 5], [-5, 5]], float)
    place = (np.array([50.0, 40.0]), 6.0)
    right = Detection("A", 3, square + [52, 41])
    assert readings([right], "A", 3, place) == (True, [])
    assert readings([Detection("A", 3, square + [60, 40])], "A", 3, place) == (False, [("A", 3)])
    assert readings([right, Detection("B", 9, square + [50, 40])], "A", 3, place) == (True, [("B", 9)])


def test_distances_are_those_of_opencv():
    """Fails if a turn is forgotten, or if cells of the frame count as different."""
    cells = cells_of("DICT_4X4_50")
    table = cv2.aruco.getPredefinedDictionary(cv2.aruco.DICT_4X4_50)
    bits = [cv2.aruco.Dictionary.getBitsFromByteList(b[None], 4) for b in table.bytesList]
    wanted = [[table.getDistanceToId(b, k) for k in range(50)] for b in bits]
    np.testing.assert_array_equal(distances_between(cells, cells), wanted)
    nearest, least, _ = nearest_others(cells)
    assert least.min() == 4 and (nearest != np.arange(50)).all()
    assert cells_of("STAG_HD23") is None
    assert (distances_between(cells, cells_of("DICT_5X5_50")) == cells[0].size).all()


def test_tables_count_each_view_once_and_each_false_id():
    """Fails if a view with two false ids counts twice as read, or if confusions lose their distance."""
    made = rows(
        ["DICT_4X4_50", 0, "view00", "x", True, "DICT_4X4_50", 1],
        ["DICT_4X4_50", 0, "view00", "x", True, "DICT_5X5_50", 7],
        ["DICT_4X4_50", 0, "view01", "x", False, "", None],
        ["DICT_4X4_50", 1, "view00", "x", True, "", None],
        ["DICT_4X4_50", 1, "view01", "x", True, "", None],
    )
    cells = {"DICT_4X4_50": cells_of("DICT_4X4_50")}
    ids = by_id(made, cells)
    assert ids[["id", "views", "read", "coverage_pct", "false_ids"]].to_numpy().tolist() == [
        [0, 2, 1, 50, 2],
        [1, 2, 2, 100, 0],
    ]
    (row,) = by_family(ids).to_dict("records")
    assert (row["ids"], row["coverage_pct"], row["ids_always_read"], row["false_ids"]) == (2, 75.0, 1, 2)
    assert row["coverage_pct_low"] < 75 < row["coverage_pct_high"]
    confusions = confusions_of(made, cells)
    between = distances_between(cells["DICT_4X4_50"], cells["DICT_4X4_50"])
    assert confusions.cells.tolist()[0] == between[0, 1] and confusions.cells.isna().tolist() == [False, True]
    distances = by_distance(confusions, cells, {"DICT_4X4_50": [0, 1]})
    assert distances.pairs.sum() == 2 * 49 and distances.confused_pairs.sum() == 1
    assert distances[distances.confused_pairs > 0].cells.tolist() == [between[0, 1]]


def test_a_study_gives_equal_bytes_again(tmp_path):
    """Fails if readings depend on anything but names, or if ids are read that are not there."""
    for name in "ab":
        study_ids("DICT_4X4_50", [3, 40], ["DICT_4X4_50"], {"aruco": {}}, 6, "seed", tmp_path / f"{name}.csv")
    assert (tmp_path / "a.csv").read_bytes() == (tmp_path / "b.csv").read_bytes()
    table = pd.read_csv(tmp_path / "a.csv")
    assert set(table.id) == {3, 40} and len(table.drop_duplicates(["id", "view"])) == 12
    assert table.read.sum() >= 8 and count_of("DICT_4X4_50") == 50
