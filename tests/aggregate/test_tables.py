"""Hand-made detections with known counts give the known Tables 1 and 2."""

import json

import numpy as np
import pandas as pd
import pytest

from aggregate.small_campaign import detection, markers, write, write_tables
from make_tables import BY_TYPE, make_by_type, make_table1_by_type

HALF_MARKER_PX = 25.0


def test_counts_worked_out_by_hand(tmp_path):
    """6 markers were there. Real finds 4, twin 3, both 2; two false ids are real, none is the twin's."""
    found = [
        detection("real", "a", 0, farther_m=0.02),
        detection("real", "a", 1, farther_m=-0.01),
        detection("real", "b", 0),
        detection("real", "b", 1),
        detection("real", "b", 2, as_id=1),
        detection("real", "b", 2, as_id=17),
        detection("twin", "a", 0),
        detection("twin", "a", 1),
        detection("twin", "b", 2),
    ]
    cells, false_ids, table1, table2 = write_tables(tmp_path, write(tmp_path, found))
    assert len(cells) == 8
    row = table1.iloc[0]
    assert row.n_markers == 6
    assert row.coverage_pct == pytest.approx(100 * 4 / 6)
    assert row.coverage_rig_pct == pytest.approx(100 * 4 / 8)
    assert row.coverage_twin_pct == pytest.approx(100 * 3 / 6)
    assert row.precision_pct == pytest.approx(100 * 2 / 3)
    assert row.recall_pct == pytest.approx(100 * 2 / 4)
    # Observed agreement 3/6, chance (4/6)(3/6) + (2/6)(3/6) = 1/2.
    assert row.kappa == pytest.approx(0.0)
    assert row.delta_distance_cm == pytest.approx(1.5)
    assert row.delta_rotation_deg == pytest.approx(0.0, abs=1e-6)
    assert (table2.false_ids.iloc[0], table2.false_ids_twin.iloc[0]) == (2, 0)
    assert sorted(false_ids.id) == [1, 17]


def test_marker_cut_by_the_frame_is_not_there_to_be_found(tmp_path):
    """If it counted, coverage would fall for what no camera can see; finding it is no false id."""
    cells, false_ids, table1, _ = write_tables(tmp_path, write(tmp_path, [detection("real", "a", 3)]))
    assert not cells[cells.id == 3].available.any()
    assert table1.coverage_pct.iloc[0] == 0
    assert false_ids.empty


@pytest.mark.parametrize(("shift_px", "counts"), [(HALF_MARKER_PX - 0.1, True), (HALF_MARKER_PX + 0.1, False)])
def test_half_marker_rule(tmp_path, shift_px, counts):
    """A right id counts within half a marker's side of the truth and is a false id beyond."""
    cells, false_ids, *_ = write_tables(tmp_path, write(tmp_path, [detection("real", "a", 1, shift_px)]))
    assert cells.real.sum() == counts
    assert len(false_ids) == (not counts)


def test_flips_are_counted_apart_and_not_averaged_in(tmp_path):
    """A steady pair 2 degrees and 1 cm apart, a flip of 60 degrees and 9 cm: only the first is averaged."""
    found = [
        detection("real", "a", 0, turned_deg=30, farther_m=0.01),
        detection("twin", "a", 0, turned_deg=28),
        detection("real", "a", 1, turned_deg=30, farther_m=0.09),
        detection("twin", "a", 1, turned_deg=-30),
    ]
    *_, table1, _ = write_tables(tmp_path, write(tmp_path, found))
    row = table1.iloc[0]
    assert row.flip_rate_pct == 50
    assert row.delta_rotation_deg == pytest.approx(2)
    assert row.delta_distance_cm == pytest.approx(1)


def test_second_run_is_the_same_byte_for_byte(tmp_path):
    """If clocks, hash orders or unseeded draws crept in, nobody could compare two runs."""
    found = [detection(s, c, k, farther_m=0.01 * k) for s in ("real", "twin") for c in "ab" for k in (0, 1)]
    written = []
    for name in ("one", "two"):
        folder = tmp_path / name
        folder.mkdir()
        write_tables(folder, write(folder, found))
        written.append({p.name: p.read_bytes() for p in folder.iterdir() if p.is_file()})
    assert written[0] == written[1]


def test_no_marker_found_is_coverage_0_and_not_a_crash(tmp_path):
    *_, table1, table2 = write_tables(tmp_path, write(tmp_path, []))
    assert table1.coverage_pct.tolist() == [0]
    assert table1[["precision_pct", "recall_pct", "delta_distance_cm", "flip_rate_pct"]].isna().all(axis=None)
    assert table2.false_ids.tolist() == [0]


def test_without_photographs_the_twin_alone_is_covered(tmp_path):
    """A designed experiment: stations are the captures, and the real side stays empty rather than 0."""
    arguments = write(tmp_path, [detection("twin", "h1", 0)], captures=(), register=False)
    *_, table1, table2 = write_tables(tmp_path, arguments)
    assert table1.coverage_twin_pct.iloc[0] == pytest.approx(100 / 3)
    assert table1[["coverage_pct", "precision_pct", "kappa"]].isna().all(axis=None)
    assert table2.false_ids.isna().all()
    assert "coverage of the twin alone" in (tmp_path / "table1.md").read_text()


def test_unknown_pose_makes_nothing_available(tmp_path):
    """A hand-held capture that could not be registered: no truth, so neither coverage nor false ids."""
    arguments = write(tmp_path, [detection("real", "a", 0)], register=False)
    stations = pd.read_csv(arguments["tables"]["stations"])
    stations[[c for c in stations if c not in ("camera", "station")]] = None
    stations.to_csv(arguments["tables"]["stations"], index=False)
    cells, false_ids, table1, _ = write_tables(tmp_path, arguments)
    assert len(cells) == 8 and false_ids.empty
    assert table1.n_markers.tolist() == [0]
    assert table1[["coverage_pct", "kappa", "flip_rate_pct"]].isna().all(axis=None)


def test_captures_named_by_numbers_are_found(tmp_path):
    """A capture called 007 must not become 7 on the way and lose its detections."""
    arguments = write(tmp_path, [detection("real", "007", 0)], captures=("007", "008"))
    cells, *_ = write_tables(tmp_path, arguments)
    assert cells[cells.capture == "007"].real.sum() == 1


def test_campaign_without_markers_has_empty_tables_and_a_sentence(tmp_path):
    """A chessboard has nothing to count; the columns must still be there for readers of the CSV."""
    arguments = write(tmp_path, [], the_markers=markers().iloc[:0])
    cells, _, table1, table2 = write_tables(tmp_path, arguments)
    assert cells.empty and table1.empty and table2.empty
    assert list(table1.columns[:9]) == [
        "camera",
        "coverage_pct",
        "precision_pct",
        "recall_pct",
        "kappa",
        "delta_distance_cm",
        "delta_rotation_deg",
        "flip_rate_pct",
        "n_markers",
    ]
    assert "no markers" in (tmp_path / "table2.md").read_text()


def test_simulated_stand_in_is_named_and_paper_stands_beside(tmp_path):
    """If the word were missing a reader would take simulated captures for photographs."""
    write_tables(tmp_path, write(tmp_path, [detection("real", "a", 0)]), origin="simulated")
    assert "simulated stand-in" in (tmp_path / "table1.tex").read_text()


def test_papers_row_only_states_what_is_known():
    from make_tables import TABLE2, readable

    row = dict.fromkeys(TABLE2) | {"camera": "brio", "algorithm": "aruco", "n_markers": 5}
    _, rows = readable(pd.DataFrame([row], columns=TABLE2), ["camera"], {"n_markers": "markers"})
    assert rows[1] == ["brio, paper", "84.02", "n/a", "91", *["n/a"] * 6]


def test_headlines_are_made_from_the_numbers(tmp_path):
    """If the words came from anywhere else the report could contradict its tables."""
    found = [detection("real", "a", 0), detection("real", "a", 1), detection("twin", "a", 1)]
    write_tables(tmp_path, write(tmp_path, found))
    (line,) = json.loads((tmp_path / "headlines.json").read_text())
    assert line.startswith("top: of 6 markers in the pictures, aruco finds 33.3 % in the real images and 16.7 %")
    assert "misses 1 that the real images have and has 0" in line
    assert line.endswith("0 of 1 pairs are flips, counted apart.")


def test_table_1_is_of_the_configured_detector(tmp_path):
    """A setting that nobody reads would leave OpenCV's rows under another detector's name."""
    arguments = write(tmp_path, [detection("real", "a", 0), detection("twin", "a", 0)])
    other = tmp_path / "detect/top/bart.csv"
    other.write_bytes(arguments["detections"][0].read_bytes())
    arguments["detections"].append(other)
    *_, table1, table2 = write_tables(tmp_path, arguments, reference="bart")
    assert list(table1.algorithm) == ["bart"] and list(table2.algorithm) == ["aruco", "bart"]


def test_table_2_by_type_holds_what_a_detector_reads():
    """Fails if a family that a detector does not read counts against it, or if families are counted together."""
    rows = [("DICT_4X4_50", True), ("DICT_4X4_50", False), ("STAG_HD21", True)]
    nothing = dict.fromkeys(("range_m", "delta_distance_m", "rotation_deg"), np.nan)
    cells = pd.DataFrame(
        [
            {
                "camera": "left",
                "detector": name,
                "capture": "a",
                "dictionary": family,
                "id": k,
                "has_real": False,
                **nothing,
            }
            | {"available": True, "real": False, "twin": found and name != "stag", "paired": False, "flipped": False}
            for name in ("aruco", "stag")
            for k, (family, found) in enumerate(rows)
        ]
    )
    false_ids = pd.DataFrame(
        [["left", "aruco", "twin", "DICT_4X4_50"]], columns=["camera", "detector", "source", "dictionary"]
    )
    table = make_by_type(cells, false_ids, "x", {"aruco": ["DICT_4X4_50"], "stag": ["STAG_HD21"]})
    columns = ["algorithm", "dictionary", "n_markers", "coverage_twin_pct", "false_ids_twin"]
    assert table[columns].to_numpy().tolist() == [
        ["aruco", "DICT_4X4_50", 2, 50.0, 1],
        ["stag", "STAG_HD21", 1, 0.0, 0],
    ]


def test_table_1_by_type_has_one_detector_a_family():
    """Fails if a family that the reference does not read is left out, or has two rows a camera."""
    read = {"aruco": ["DICT_4X4_50"], "bart": ["DICT_4X4_50"], "stag": ["STAG_HD21"], "other": ["STAG_HD21"]}
    names = [(a, family) for a in sorted(read) for family in read[a]]
    by_type = pd.DataFrame(
        [{"camera": "left", "algorithm": a, "dictionary": family} for a, family in names], columns=BY_TYPE
    )
    table = make_table1_by_type(by_type, "bart", read)
    assert table[["algorithm", "dictionary"]].to_numpy().tolist() == [["bart", "DICT_4X4_50"], ["stag", "STAG_HD21"]]
