"""A moving experiment's file: what is wrong in it is named in one message."""

import shutil
from pathlib import Path

import pytest

from moving.config import load_moving
from rig.errors import InputError

CONFIG = Path(__file__).resolve().parents[2] / "config"
REST = "{kind: at_rest, camera_m: [0, -1, 0.5], look_at_m: [0, 0, 0.3]}"
GOOD = f"""
name: small
rig: desk.yaml
camera: {{width: 320, height: 180, fov_deg: 60.0, fov_axis: horizontal}}
exposure_s: 0.005
readout_s: 0.01
detectors: {{aruco: {{}}}}
trajectories: {{still: {REST}}}
""".replace("[0, -1, 0.5]", "[0.0, -1.0, 0.5]").replace("[0, 0, 0.3]", "[0.0, 0.0, 0.3]")


def write(folder, text):
    (folder / "moving").mkdir()
    shutil.copytree(CONFIG / "rigs", folder / "rigs")
    path = folder / "moving/small.yaml"
    path.write_text(text)
    return path


@pytest.mark.parametrize("path", sorted((CONFIG / "moving").glob("*.yaml")), ids=lambda path: path.name)
def test_the_files_in_the_repository_are_right(path):
    moving = load_moving(path)
    assert len(moving.markers) and moving.file.name == path.stem


def test_defaults_are_filled_in(tmp_path):
    moving = load_moving(write(tmp_path, GOOD))
    assert (moving.file.frames, moving.file.fps, moving.shape) == (60, 30.0, (180, 320))


@pytest.mark.parametrize(
    ("old", "new", "words"),
    [
        ("exposure_s: 0.005", "exposure_s: 0.03", ["exposure_s 0.03", "readout_s 0.01", "fps 30"]),
        ("exposure_s: 0.005", "exposure_s: -1.0", ["exposure_s", "-1.0", "greater than 0"]),
        ("readout_s: 0.01", "readout: 0.01", ["readout", "readout_s"]),
        ("kind: at_rest", "speed: 1, kind: at_rest", ["trajectories.still", "speed", "unknown key", "look_at_m"]),
        ("kind: at_rest", "kind: dance", ["trajectories.still", "at_rest", "pan"]),
        ("kind: at_rest", "kind: pan", ["trajectories.still", "pan_deg", "required"]),
        ("[0.0, 0.0, 0.3]", "[0.0, -1.0, 0.3]", ["trajectories.still", "look_at_m", "straight above"]),
        ("still:", "a/b:", ["a/b", "letters, digits"]),
        ("desk.yaml", "../../secret.yaml", ["rig", "secret.yaml"]),
        ("desk.yaml", "none.yaml", ["none.yaml", "no such file"]),
    ],
)
def test_a_wrong_value_is_named_with_what_is_allowed(tmp_path, old, new, words):
    assert old in GOOD
    with pytest.raises(InputError) as error:
        load_moving(write(tmp_path, GOOD.replace(old, new)))
    assert "\n" not in str(error.value)
    for word in words:
        assert word in str(error.value)


def test_detectors_keep_their_parameters(tmp_path):
    """Fails if a detector's parameters get lost on the way from the file."""
    moving = load_moving(write(tmp_path, GOOD.replace("aruco: {}", "bart: {bridge_frames: 5, threshold: otsu}")))
    assert moving.file.detectors == {"bart": {"bridge_frames": 5, "threshold": "otsu"}}
