"""Provenance names code, versions, data and configuration; two runs differ only where these do."""

import json

import pytest

from rig.errors import InputError
from write_provenance import git_state, write_provenance


def provenance(tmp_path, dvc_text="outs:\n- md5: 0123.dir\n  path: frame\n"):
    manifest, lock, dvc = tmp_path / "brio.json", tmp_path / "lock.txt", tmp_path / "frame.dvc"
    manifest.write_text(json.dumps({"blender": "5.2.3", "device": "CPU", "stations": [1, 2]}))
    lock.write_text("numpy==2\n")
    dvc.write_text(dvc_text)
    out = tmp_path / "provenance.json", tmp_path / "run_config.yaml"
    write_provenance([manifest], lock, [dvc], [], {"detectors": ["aruco"], "campaign": None}, *out)
    return [path.read_bytes() for path in out]


def test_provenance_names_blender_data_and_configuration(tmp_path):
    """If any were missing nobody could tell which renders and which captures a table is about."""
    written, config = provenance(tmp_path)
    content = json.loads(written)
    assert content["render"] == {"brio": {"blender": "5.2.3", "device": "CPU"}}
    assert list(content["data_md5"].values()) == ["0123.dir"]
    assert content["packages"]["opencv-contrib-python-headless"]
    assert config == b"campaign:\ndetectors:\n- aruco\n"


def test_provenance_has_no_clock(tmp_path):
    assert provenance(tmp_path) == provenance(tmp_path)


def test_not_a_dvc_file_is_named(tmp_path):
    with pytest.raises(InputError, match=r"frame\.dvc"):
        provenance(tmp_path, "outs: 3\n")


def test_outside_a_repository_the_commit_is_unknown(tmp_path):
    """A copy of the folder without git must still run to its report."""
    assert git_state(tmp_path) == {"commit": None, "changed_files": None}
