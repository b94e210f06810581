"""The rule's job: real and twin images of one camera to sorted detections with both poses."""

import json
import shutil

import cv2
import numpy as np
import pandas as pd
import pytest

from bench.marker_scenes import FOCAL_PX, scene
from detect_captures import detect_captures
from inputs.tables import DETECTIONS
from join_detections import join_tables
from rig.errors import InputError


@pytest.fixture
def run(tmp_path):
    """Return a function that writes the files of a tiny camera, runs one detector and returns its tables and the truth."""
    image, truth = scene(np.random.default_rng(0), 640, 480, 4, (60, 70), (10, 30))
    (tmp_path / "images").mkdir()
    (tmp_path / "twin").mkdir()
    for name in ("7", "007"):  # names that a careless reader would take for one number
        cv2.imwrite(str(tmp_path / f"images/{name}.png"), image)
        cv2.imwrite(str(tmp_path / f"twin/{name}.png"), image)
    known = truth[:3]
    names = {"dictionary": [t.dictionary for t in known], "id": [t.id for t in known], "code_m": 0.07, "plate_m": 0.1}
    zeros = dict.fromkeys(["x", "y", "z", "rx", "ry", "rz"], 0.0)
    pd.DataFrame(names | zeros).to_csv(tmp_path / "markers.csv", index=False)
    K = {"fx": FOCAL_PX, "fy": FOCAL_PX, "cx": 319.5, "cy": 239.5}
    (tmp_path / "register.json").write_text(json.dumps(K))

    def go(photographs=True, parameters=None, part=None):
        rows = [[c, "cam", f"images/{c}.png"] for c in ("7", "007") if photographs] + [["x", "other", "none.png"]]
        captures = pd.DataFrame(rows, columns=["capture", "camera", "image"])
        captures[["station", "trial", "sequence", "frame", "t_s"]] = ["s", 0, None, None, None]
        captures.to_csv(tmp_path / "captures.csv", index=False)
        detect_captures(
            "cam",
            "bart",
            parameters or {},
            ["DICT_5X5_1000", "DICT_ARUCO_ORIGINAL"],
            tmp_path,
            tmp_path / "captures.csv",
            tmp_path / "markers.csv",
            tmp_path / "register.json",
            tmp_path / "twin",
            tmp_path / "out.csv",
            tmp_path / "timing.csv",
            part,
        )
        return pd.read_csv(tmp_path / "out.csv", dtype={"capture": str}), pd.read_csv(tmp_path / "timing.csv"), truth

    return go


def test_sorted_rows_of_both_sources_with_both_poses(run, tmp_path):
    table, timing, truth = run()
    assert list(table.columns) == list(DETECTIONS.columns)
    assert len(table) == 4 * len(truth)
    order = table[["source", "capture", "dictionary", "id"]]
    assert order.equals(order.sort_values(list(order.columns), ignore_index=True))
    unknown = (table.dictionary == truth[3].dictionary) & (table.id == truth[3].id)
    assert table[unknown].rx.isna().all(), "a marker that is not of the rig has no size, hence no pose"
    known = table[~unknown]
    assert known[["rx", "tz", "reproj_px", "rx_alt", "reproj_alt_px"]].notna().all(axis=None)
    assert (known.reproj_px <= known.reproj_alt_px).all()
    for t in truth[:3]:
        rows = known[(known.dictionary == t.dictionary) & (known.id == t.id)]
        assert np.allclose(rows.tz, 0.07 * FOCAL_PX / t.side_px, rtol=0.02)
    assert len(timing) == 4 and (timing.ms > 0).all()


def test_parts_joined_are_what_one_job_writes(run, tmp_path):
    """Fails if a part has other captures or twin images than its own, or a detector remembers the image before."""
    run()
    whole, parts = (tmp_path / "out.csv").read_bytes(), []
    for k in range(2):
        run(part=[k, k + 1])
        parts.append(shutil.copy(tmp_path / "out.csv", tmp_path / f"{k}.csv"))
    join_tables(parts, tmp_path / "joined.csv")
    assert (tmp_path / "joined.csv").read_bytes() == whole


def test_a_second_run_gives_the_same_bytes(run, tmp_path):
    run()
    first = (tmp_path / "out.csv").read_bytes()
    run()
    assert (tmp_path / "out.csv").read_bytes() == first


def test_an_experiment_without_photographs_has_only_twin_rows(run):
    table, _, _ = run(photographs=False)
    assert set(table.source) == {"twin"}


def test_a_wrong_parameter_names_the_key(run):
    with pytest.raises(InputError, match=r"detectors\.bart.*no parameter 'speed'"):
        run(parameters={"speed": 11})
