"""Captures are compared with what DVC tracks, and what differs is named."""

import json
import shutil

import pytest

import verify_data
from rig.errors import InputError
from tiny_campaign import write_campaign
from workflow_runs import PROJECT


def tracked(folder, keep_listing=True):
    """Lay a campaign down and track it as DVC would; return (campaign, .dvc file, stores)."""
    campaign = write_campaign(folder / "c")
    files = verify_data.files_of(campaign)
    md5 = verify_data.directory_hash(files)
    dvc_file = folder / "c.dvc"
    dvc_file.write_text(f"outs:\n- md5: {md5}\n  size: 1\n  nfiles: {len(files)}\n  hash: md5\n  path: c\n")
    store = folder / "store"
    if keep_listing:
        listing = store / "files/md5" / md5[:2] / md5[2:]
        listing.parent.mkdir(parents=True)
        listing.write_text(json.dumps([{"md5": m, "relpath": p} for p, m in files.items()]))
    return campaign, dvc_file, [store]


def test_the_hash_is_the_one_that_dvc_gives():
    campaign, dvc_file = PROJECT / "data/raw/frame", PROJECT / "data/raw/frame.dvc"
    if not campaign.is_dir():
        pytest.skip("needs the embedded campaign: run `make data`")
    assert verify_data.directory_hash(verify_data.files_of(campaign)) == verify_data.tracked_md5(dvc_file)


def test_what_dvc_tracks_passes(tmp_path):
    campaign, dvc_file, stores = tracked(tmp_path)
    verify_data.verify_data(campaign, dvc_file, stores, tmp_path / "verified.json")
    assert json.loads((tmp_path / "verified.json").read_text())["files"] == 7


def test_changed_missing_and_extra_captures_are_each_named(tmp_path):
    campaign, dvc_file, stores = tracked(tmp_path)
    shutil.copy(campaign / "images/left/a.png", campaign / "images/left/b.png")
    (campaign / "images/right/a.png").unlink()
    (campaign / "images/right/new.png").write_bytes(b"x")
    with pytest.raises(InputError) as error:
        verify_data.verify_data(campaign, dvc_file, stores, tmp_path / "verified.json")
    for words in ("changed: images/left/b.png", "missing: images/right/a.png", "extra: images/right/new.png"):
        assert words in str(error.value)
    assert not (tmp_path / "verified.json").exists()


def test_without_dvcs_listing_a_change_is_still_noticed(tmp_path):
    campaign, dvc_file, stores = tracked(tmp_path, keep_listing=False)
    (campaign / "images/right/a.png").unlink()
    with pytest.raises(InputError, match="differs from"):
        verify_data.verify_data(campaign, dvc_file, stores, tmp_path / "verified.json")


def test_an_untracked_campaign_is_accepted_and_that_is_said(tmp_path, caplog):
    with caplog.at_level("INFO", logger="twingap"):
        verify_data.verify_data(write_campaign(tmp_path / "c"), None, [], tmp_path / "verified.json")
    assert "not tracked by DVC" in caplog.text


@pytest.mark.parametrize("text", ["outs: []\n", "a: 1\n", "outs:\n- md5: ../../etc.dir\n  hash: md5\n  path: c\n"])
def test_an_odd_dvc_file_is_refused(tmp_path, text):
    """Its hash becomes a path: it must be a hash."""
    path = tmp_path / "c.dvc"
    path.write_text(text)
    with pytest.raises(InputError, match="c.dvc"):
        verify_data.tracked_md5(path)
