"""Campaigns and designed experiments lead to the same tables."""

import json
import math

import numpy as np
import pandas as pd
import pytest
import yaml

from expand_tables import expand_tables
from inputs import tables
from inputs.experiment import load_experiment
from rig.errors import InputError
from rig.geometry import make_pose, transform
from tiny_campaign import CAPTURES, write_campaign
from workflow_runs import PROJECT

EXPERIMENTS = PROJECT / "config/experiments"
NAMES = ("markers", "cameras", "stations", "captures")


def expand(out, campaign=None, experiment=None):
    """Expand and return the four tables by name."""
    expand_tables(campaign, experiment, None, out)
    schemas = (tables.MARKERS, tables.CAMERAS, tables.STATIONS, tables.CAPTURES)
    return {n: tables.read_table(out / f"{n}.csv", schema) for n, schema in zip(NAMES, schemas, strict=True)}


def test_trials_share_a_station_and_heights_do_not(tmp_path):
    made = expand(tmp_path / "out", write_campaign(tmp_path / "c"))
    assert list(made["captures"].station) == ["h0300_t45", "h0300_t45", "h0300_t45", "h0600_t22p5"]
    assert list(made["stations"].camera) == ["left", "right", "right"]


def test_heights_that_differ_by_a_tenth_of_a_millimetre_are_two_stations(tmp_path):
    """Rounded names would give both the pose of one."""
    captures = CAPTURES.replace("left_b,left,0.3,", "left_b,left,0.3001,")
    made = expand(tmp_path / "out", write_campaign(tmp_path / "c", captures=captures))
    left = made["stations"][made["stations"].camera == "left"]
    assert list(left.station) == ["h0300_t45", "h300p1_t45"]
    assert left.height_m.tolist() == [0.3, 0.3001]


def test_full_poses_are_kept_and_shared_and_unknown_ones_stay_empty(tmp_path):
    rows = [
        "capture,camera,image,rx,ry,rz,tx,ty,tz",
        "p,left,images/left/a.png,1.5,0,0,0,0.3,0.7",
        "q,left,images/left/b.png,1.5,0,0,0,0.3,0.7",
        "007,right,images/right/a.png,,,,,,",
        "u,right,images/right/b.png,,,,,,",
    ]
    made = expand(tmp_path / "out", write_campaign(tmp_path / "c", captures="\n".join(rows) + "\n"))
    assert list(made["captures"].station) == ["p", "p", "007", "u"]
    assert made["stations"].tz.iloc[0] == 0.7
    assert made["stations"].tz.iloc[1:].isna().all()


def test_a_second_run_writes_the_same_bytes(tmp_path):
    campaign = write_campaign(tmp_path / "c")
    for out in ("a", "b"):
        expand(tmp_path / out, campaign)
    for path in (tmp_path / "a").iterdir():
        assert path.read_bytes() == (tmp_path / "b" / path.name).read_bytes()


def test_the_papers_cameras_and_the_ladders_of_the_embedded_campaign(tmp_path):
    made = expand(tmp_path / "out", experiment=EXPERIMENTS / "paper.yaml")
    assert made["cameras"][["width", "height"]].values.tolist() == [[1920, 1080], [3840, 2160], [2064, 2208]]
    assert made["cameras"].fx.round().tolist() == [1478, 1920, 866]  # 66, 90 and 100 degrees, horizontal
    embedded = pd.read_csv(PROJECT / "data/raw/frame/markers.csv") if (PROJECT / "data/raw/frame").is_dir() else None
    if embedded is None:
        pytest.skip("needs the embedded campaign: run `make data`")
    assert np.allclose(made["markers"].iloc[:, 1:], embedded.iloc[:, 1:], atol=1e-12)
    assert made["captures"].empty
    assert json.loads((tmp_path / "out/scene.json").read_text())["origin"] == "simulated"


def test_a_carriage_moves_the_board_away_in_its_steps(tmp_path):
    """The board is upright, its markers face the camera, and each stop is 10 cm further."""
    made = expand(tmp_path / "out", experiment=EXPERIMENTS / "carriage.yaml")
    centre = made["markers"][["x", "y", "z"]].mean().to_numpy()
    depths = []
    for s in made["stations"].itertuples():
        seen = transform(make_pose([s.rx, s.ry, s.rz], [s.tx, s.ty, s.tz]), centre)
        assert np.allclose(seen[:2], 0, atol=1e-12)
        depths.append(seen[2])
    assert np.allclose(np.diff(depths), 0.1) and math.isclose(depths[0], 0.5)
    normal = make_pose(made["markers"][["rx", "ry", "rz"]].iloc[0], [0, 0, 0])[:3, 2]
    assert np.allclose(normal, [0, -1, 0])


def experiment_with(folder, camera=None, rig=None):
    """Write a small experiment whose camera or rig file has other keys; return its path."""
    sheet = {"width": 1920, "height": 1080, "fov_deg": 66.0, "fov_axis": "horizontal"} | (camera or {})
    ladder = {"dictionary": "DICT_5X5_1000", "columns_x_m": [0.0], "first_y_m": 0.5, "step_y_m": 0.1} | (rig or {})
    files = {
        "cameras/one.yaml": sheet,
        "rigs/one.yaml": {"ladders": [ladder]},
        "experiments/e.yaml": {
            "name": "e",
            "cameras": {"one": "one.yaml"},
            "rig": "one.yaml",
            "heights_m": [1],
            "tilts_deg": [0],
        },
    }
    for name, data in files.items():
        (folder / name).parent.mkdir(parents=True, exist_ok=True)
        (folder / name).write_text(yaml.safe_dump(data))
    return folder / "experiments/e.yaml"


@pytest.mark.parametrize(
    ("camera", "rig", "words"),
    [
        ({"focal_mm": 2.2, "sensor_width_mm": 3.6}, {}, ["cameras/one.yaml", "fov_deg 66", "focal_mm 2.2", "2%"]),
        ({"fov_axis": "sideways"}, {}, ["cameras/one.yaml", "fov_axis", "'sideways'", "horizontal"]),
        ({"fov_deg": 1.15}, {"step_y_m": -1}, ["rigs/one.yaml", "ladders.0.step_y_m", "greater than 0"]),
        ({}, {"code_m": 0.2}, ["rigs/one.yaml", "ladders.0", "code_m 0.2", "plate_m 0.1"]),
        ({}, {"plates": 3, "first_id": 998}, ["rigs/one.yaml", "998..1000", "1000"]),
        ({}, {"colour": "red"}, ["rigs/one.yaml", "ladders.0.colour", "unknown key", "dictionary"]),
    ],
)
def test_an_impossible_experiment_is_refused(tmp_path, camera, rig, words):
    with pytest.raises(InputError) as error:
        load_experiment(experiment_with(tmp_path, camera, rig))
    for word in words:
        assert word in str(error.value)


def test_a_focal_length_that_agrees_is_accepted(tmp_path):
    path = experiment_with(tmp_path, {"focal_mm": 2.2, "sensor_width_mm": 2.857})
    assert round(load_experiment(path).file.cameras["one"].fx) == 1478
