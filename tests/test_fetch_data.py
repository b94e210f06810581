"""What a remote lost or damaged is named by its capture, in one line. By a folder as remote; `make bench-s3` has a server."""

import shutil
import subprocess

import pytest

from fetch_data import fetch_data
from rig.errors import InputError
from tiny_campaign import write_campaign
from verify_data import files_of, md5_of


@pytest.fixture(scope="module")
def pushed(tmp_path_factory):
    """Return a git repository with a tiny campaign that DVC has pushed to the folder ``remote`` beside it."""
    from dvc.repo import Repo

    folder = tmp_path_factory.mktemp("fetch")
    clone = folder / "clone"
    write_campaign(clone / "data/raw/tiny")
    subprocess.run(["git", "init", "-q", str(clone)], check=True)
    with Repo.init(str(clone)) as repo:
        repo.add([str(clone / "data/raw/tiny")])
    config = "[core]\n    remote = team\n    analytics = false\n['remote \"team\"']\n    url = ../../remote\n"
    (clone / ".dvc/config").write_text(config)
    with Repo(str(clone)) as repo:
        repo.push()
    return clone


@pytest.fixture
def place(pushed, tmp_path, monkeypatch):
    """Return (a clone without captures, the remote's folder of objects); what a test breaks there is its own."""
    shutil.copytree(pushed.parent, tmp_path, dirs_exist_ok=True)
    clone = tmp_path / "clone"
    shutil.rmtree(clone / "data/raw/tiny")
    shutil.rmtree(clone / ".dvc/cache")
    monkeypatch.chdir(clone)
    return clone, tmp_path / "remote/files/md5"


def object_of(remote, pushed, name):
    """Return the remote's file that holds a capture."""
    md5 = md5_of(pushed / "data/raw/tiny" / name)
    return remote / md5[:2] / md5[2:]


def message(**more):
    """Return the one line with which fetching ends."""
    with pytest.raises(InputError) as error:
        fetch_data("data/raw/tiny.dvc", **more)
    assert "\n" not in str(error.value)
    return str(error.value)


def test_what_is_whole_is_fetched(place, pushed):
    """Fails if a capture is not in its place afterwards, or has other content."""
    clone, _ = place
    fetch_data("data/raw/tiny.dvc")
    assert files_of(clone / "data/raw/tiny") == files_of(pushed / "data/raw/tiny")


def test_a_damaged_and_a_missing_object_are_named_by_their_captures(place, pushed):
    """Fails if damage passes as a capture, or only hashes are told."""
    clone, remote = place
    damaged, missing = (object_of(remote, pushed, f"images/left/{name}.png") for name in "ab")
    damaged.chmod(0o644)
    damaged.write_bytes(b"not what it was")
    missing.unlink()
    said = message()
    assert "damaged on the remote: images/left/a.png" in said and "did not arrive: images/left/b.png" in said
    assert not (clone / "data/raw/tiny").exists()


def test_a_copy_damaged_on_this_machine_is_fetched_anew(place, pushed):
    """Fails if the remote is blamed for what happened here, or the damaged copy stays."""
    clone, _ = place
    fetch_data("data/raw/tiny.dvc")
    md5 = md5_of(clone / "data/raw/tiny/images/left/a.png")
    copy = clone / ".dvc/cache/files/md5" / md5[:2] / md5[2:]
    copy.chmod(0o644)
    copy.write_bytes(b"not what it was")
    shutil.rmtree(clone / "data/raw/tiny")
    fetch_data("data/raw/tiny.dvc")
    assert files_of(clone / "data/raw/tiny") == files_of(pushed / "data/raw/tiny")


def test_files_of_ones_own_are_not_overwritten_unasked(place):
    """Fails if a capture that somebody changed is lost without a word."""
    clone, _ = place
    fetch_data("data/raw/tiny.dvc")
    mine = clone / "data/raw/tiny/images/left/a.png"
    mine.chmod(0o644)
    mine.write_bytes(b"mine")
    assert "--force" in message() and mine.read_bytes() == b"mine"
    fetch_data("data/raw/tiny.dvc", force=True)
    assert mine.read_bytes() != b"mine"


def test_a_remote_that_is_not_there_is_named(place):
    """Fails if a share that is not mounted passes as one that has all."""
    _, remote = place
    shutil.rmtree(remote.parents[1])
    assert "the list of its captures is missing or damaged on the remote" in message()


def test_an_unknown_remote_and_a_missing_file_are_named(place):
    """Fails if a misspelt name ends in a traceback."""
    assert "elsewhere" in message(remote="elsewhere")
    with pytest.raises(InputError, match="no such file"):
        fetch_data("data/raw/tin.dvc")
