"""The page to explore, without a browser: numbers that it shows, images, what may not get into a page."""

import json

import cv2
import numpy as np
import pandas as pd
import pytest

from case_files import load_case, load_observations
from effects.base import Scene
from explore_camera import board_seen, rms_between, show_pair
from gap.observables import FEATURES
from inputs.campaign import CalibrationBoard
from report.explored import CAMERAS, DRAWN, GAPS, PLATE_GAPS_PX, STEPS, explore, paths_of, told_in, write_results
from reporting.explore_tables import as_js, bins_of, cell_sums, place_of, plate_sums, tilt_bins
from reporting.ladder_images import chosen, rungs_of
from rig.geometry import camera_matrix, project, station_pose
from rig.targets import target_plate
from workflow_runs import PROJECT


@pytest.fixture(scope="module")
def run(tmp_path_factory):
    """The results' folder of a small run."""
    return write_results(tmp_path_factory.mktemp("run"))


@pytest.fixture(scope="module")
def left(run):
    """What the page is told of one camera: (camera, cells)."""
    folder = run / "report/explore/left"
    return told_in(folder / "camera.js"), told_in(folder / "cells_0000.js")


def test_names_can_not_leave_the_script_that_they_are_in():
    """Fails if a name could end its script element, start a comment in it, or come out as another name."""
    name = "</script><script>alert(1)</script><!-- \u2028 & 'quoted\" \\"
    script = as_js("camera/a", {"name": name, "rms": float("nan")})
    assert "<" not in script and ">" not in script and "&" not in script and "\u2028" not in script
    assert json.loads(script[script.index(",") + 1 : script.rindex(")")]) == {"name": name, "rms": None}


def test_the_difference_goes_as_effects_are_added(left):
    """Fails if twins are not drawn in the capture's own pose, or a rung lacks the effects before it."""
    _, cells = left
    drawn = [c for c in cells.values() if len(c["steps"]) == 1 + len(STEPS)]
    assert len(drawn) == DRAWN
    for capture in drawn:
        ideal, found, same = capture["steps"]
        assert found["off_px"] < 0.15 and ideal["off_px"] > 3 * found["off_px"]
        assert found["rms_dn"] < 0.7 * ideal["rms_dn"]
        assert same["rms_dn"] == found["rms_dn"]


def test_images_of_the_ladder_are_whole_and_lossless_and_others_small(run, left):
    """Fails if a loupe of eight times would show what a codec did, or pixels of a reduced image."""
    camera, _ = left
    folder = run / "report/explore/left"
    captures = pd.read_csv(run / "expand/left/captures.csv")
    for k, (name, drawn) in enumerate(zip(camera["captures"]["name"], camera["captures"]["drawn"], strict=True)):
        file = captures.set_index("capture").image[name]
        real = cv2.imread(str(run.parent / "campaign" / file), cv2.IMREAD_GRAYSCALE)
        shown = cv2.imread(str(folder / f"{k:05d}_real.{'png' if drawn else 'jpg'}"), cv2.IMREAD_GRAYSCALE)
        assert np.abs(shown.astype(float) - real).mean() < (1e-9 if drawn else 3)
        assert len(list(folder.glob(f"{k:05d}_[0-9]*"))) == (1 + len(STEPS) if drawn else 1)


def test_the_page_is_told_what_the_ladder_says(left):
    """Fails if gaps stand beside another rung, or a parameter loses its error."""
    camera, _ = left
    assert [s["errors"]["gap"] for s in camera["steps"]] == [[g, 1.0] for g in GAPS]
    assert [s["effect"] for s in camera["steps"]] == ["ideal", *STEPS]
    assert camera["steps"][1]["parameters"]["ratio"]["se"] == 0.001
    assert camera["captures"]["before_px"] == [PLATE_GAPS_PX["configured"]] * 7


def test_a_marker_s_numbers_are_those_of_the_comparison(run, left):
    """Fails if distances of another detector, twin or marker are shown."""
    camera, cells = left
    table = pd.read_parquet(run / "compare/left.parquet")
    markers = pd.read_csv(run / "expand/markers.csv")
    pairs = table[table.paired]
    assert len(pairs) > 20
    for row in pairs.itertuples():
        capture = cells[str(camera["captures"]["name"].index(row.capture))]
        marker = markers.index[(markers.dictionary == row.dictionary) & (markers.id == row.id)][0]
        side = "before" if row.twin_is == "ideal" else "after"
        shown = capture["found"][row.detector][side][str(marker)]
        assert shown[:2] == [1, 1]
        np.testing.assert_allclose(shown[2:4], [row.distance_real_m, row.distance_twin_m], atol=6e-5)
        assert capture["found"][row.detector]["real"][str(marker)]


def test_sums_of_plates_are_by_twin_tilt_distance_and_marker():
    """Fails if a filter of the map would count a plate of another tilt or distance."""
    corner = {f"corner_{axis}{k}": 3.0 if axis == "x" else 4.0 for axis in "xy" for k in range(4)}
    plates = pd.DataFrame(
        [
            {"twin": t, "capture": c, "plate": "D/1", "distance_m": d, "white": w, "dx_px": 3.0, **corner}
            for t, c, d, w in [
                ("configured", "a", 0.3, -2.0),
                ("configured", "b", 0.9, 4.0),
                ("explained", "b", 0.9, 1.0),
            ]
        ]
    )
    captures = pd.DataFrame({"tilt_bin": [0, 1]}, index=["a", "b"])
    rows = plate_sums(plates, captures, [0.0, 0.5, 1.0], {"D/0": 0, "D/1": 1})
    assert rows == [[0, 0, 0, 1, 1, 25.0, 2.0], [0, 1, 1, 1, 1, 25.0, 4.0], [1, 1, 1, 1, 1, 25.0, 1.0]]


def test_flips_and_what_one_side_missed_are_in_no_mean():
    """Fails if a flip's 100 degrees, or a marker without a pair, would colour the map."""
    rows = [("a", True, True, True, False, 0.02, 1.5), ("a", True, True, True, True, 0.5, 100.0)]
    rows += [("a", True, False, False, False, np.nan, np.nan), ("a", False, False, False, False, np.nan, np.nan)]
    names = ["capture", "real", "twin", "paired", "flipped", "delta_distance_m", "rotation_deg"]
    cells = pd.DataFrame(rows, columns=names).assign(
        available=True, twin_is="ideal", detector="d", dictionary="D", id=1, range_m=0.3
    )
    captures = pd.DataFrame({"tilt_bin": [0]}, index=["a"])
    assert cell_sums(cells, captures, [0.0, 0.5], {"D/1": 0}, ["d"]) == [[0, 0, 0, 0, 0, 4.0, 1.0, 1.0, 2.0, 1.5]]


def test_bins_hold_all_distances_and_tilts():
    """Fails if a capture falls out of all bins, which no filter would bring back."""
    for values in ([0.31, 2.2], [1.0], [0.0, 77.0]):
        edges = bins_of(values)
        assert edges[0] <= min(values) and max(values) <= edges[-1] and len(edges) <= 9
    labels, index = tilt_bins([0, 45, np.nan, 22.5])
    assert labels == ["0°", "22.5°", "45°"] and index == [0, 2, -1, 1]
    labels, index = tilt_bins(np.linspace(-4, 88, 40))
    assert labels[0] == "-10° to 0°" and max(index) == len(labels) - 1


def test_a_camera_sees_the_ground_from_where_it_stands():
    """Fails if the footprint is mirrored or turned: a reader would look for plates on the wrong side."""
    K = camera_matrix(100, 100, 49.5, 39.5)
    place = place_of(K, 100, 80, station_pose(1.0, 90))
    assert place["at"] == [0, 0, 1]
    ground = np.array(place["ground"])
    np.testing.assert_allclose([ground.min(0), ground.max(0)], [[-0.5, -0.4], [0.5, 0.4]], atol=0.01)
    ahead = np.array(place_of(K, 100, 80, station_pose(1.0, 30))["ground"])
    assert ahead[:, 1].min() > 0.5


def test_each_station_comes_before_its_second_trial():
    """Fails if repeats of one station would take the place of another station."""
    table = pd.DataFrame(
        [(f"s{s}_{t}", f"s{s}", t) for s in range(4) for t in range(2)], columns=["capture", "station", "trial"]
    )
    assert chosen(table, 4) == {"s0_0", "s1_0", "s2_0", "s3_0"}
    assert chosen(table, 6) >= chosen(table, 4) and len(chosen(table, 6)) == 6
    assert len(chosen(table, 2)) == 2 and chosen(table, 0) == set() and len(chosen(table, 99)) == 8


def test_adopted_effects_come_before_the_steps():
    """Fails if the ladder forgets what the twin was given already."""
    verdict = {
        "configured": [{"effect": "exposure", "parameters": {"scale": 2.0}}],
        "steps": [{"effect": "focal_length", "parameters": {"ratio": {"value": 1.1, "se": 0.1}}}],
    }
    rungs = rungs_of(verdict)
    assert [name for name, _ in rungs] == ["ideal", "exposure", "focal_length"]
    assert rungs[-1][1] == [("exposure", {"scale": 2.0}), ("focal_length", {"ratio": 1.1})]


def test_equal_inputs_give_equal_bytes_and_nothing_half_written(run):
    """Fails if noise is drawn anew at each run, or files of an earlier run are left in the folder."""
    folder = run / "report/explore/right"
    before = {p.name: p.read_bytes() for p in folder.iterdir()}
    (folder / "00099_real.png").write_bytes(b"of another run")
    explore(run, run.parent / "campaign", "right")
    assert {p.name: p.read_bytes() for p in folder.iterdir()} == before
    verdict = paths_of(run, "right")["verdict"]
    told = verdict.read_text()
    verdict.write_text("{")
    with pytest.raises(json.JSONDecodeError):
        explore(run, run.parent / "campaign", "right")
    verdict.write_text(told)
    assert {p.name for p in folder.parent.iterdir() if p.is_dir()} == {*CAMERAS, "openseadragon"}


def test_residuals_of_the_methods_page_are_those_of_the_plates_that_a_run_measured(run, monkeypatch):
    """Fails if a run's observations cannot be whitened any more, or one twin's residuals are shown as the other's."""
    monkeypatch.syspath_prepend(PROJECT / "notebooks")
    import method_pictures

    paths = paths_of(run, "left")
    case, _ = load_case(paths["expand"], paths["register_json"], "left")
    load_observations(paths["observations"], case)
    measured = [
        (c.view.capture, case.scene.plates[k].name)
        for c in case.captures
        for k in np.flatnonzero(c.observation.measured)
    ]
    rows = [
        {"twin": twin, "capture": capture, "plate": plate} | dict.fromkeys(FEATURES, gap)
        for twin, gap in (("configured", 1.0), ("explained", 0.1))
        for capture, plate in measured
    ]
    monkeypatch.setattr(method_pictures, "read_plates", lambda *_: pd.DataFrame(rows))
    found = method_pictures.whitened(run, "left")
    assert found["configured"].size == len(measured) * len(FEATURES) > 0
    np.testing.assert_allclose(found["configured"], 10 * found["explained"])


def test_what_lies_about_a_board_is_not_compared(tmp_path):
    """Fails if a twin of a board, whose surroundings are not modelled, differs from its photograph by a bright wall behind it."""
    scene = Scene(
        (target_plate(CalibrationBoard(type="chessboard", columns=7, rows=5, square_m=0.02)),), 0.8, 0.05, 0.3, 0.3
    )
    K, T, size = camera_matrix(300.0, 300.0, 159.5, 119.5), station_pose(0.3, 60), (320, 240)
    T[:3, 3] -= T[:3, :3] @ [0.08, -0.1, 0.0]
    inside = board_seen(scene, K, T, size)
    middle, corner = project(K, T, np.array([[0.08, 0.06, 0.0], [0.16 - 0.001, 0.12 - 0.001, 0.0]])).round().astype(int)
    assert inside[tuple(middle[::-1])] and inside[tuple(corner[::-1])] and 0.05 < inside.mean() < 0.5
    beyond = project(K, T, np.array([0.165, 0.125, 0.0])).round().astype(int)
    assert not inside[tuple(beyond[::-1])]  # paper about the squares
    twin = np.full((*size[::-1], 3), 100, np.uint8)
    cv2.imwrite(str(tmp_path / "twin.png"), twin)
    photograph = np.where(inside[..., None], 104.0, 255.0) * np.ones(3)
    (step,) = show_pair(photograph, tmp_path / "twin.png", tmp_path, "00000", inside)["steps"]
    assert step["rms_dn"] == 4
    assert rms_between(photograph, twin) > 50 and rms_between(photograph, twin, np.zeros_like(inside)) is None
