"""Locks: what `make lock` writes from pyproject.toml holds versions and hashes, and no lock moves another's version."""

import re
import tomllib

import pytest

from workflow_runs import PROJECT

LOCKED = ("slurm", "s3", "bench-s3")


def versions(name):
    """Return {package: version} of a lock."""
    text = (PROJECT / f"envs/{name}.lock.txt").read_text()
    return dict(re.findall(r"^([A-Za-z0-9._-]+)==([^ ;\\\n]+)", text, re.M))


@pytest.mark.parametrize("group", LOCKED)
def test_what_a_group_asks_for_is_locked(group):
    """Fails if a dependency was added to a group and `make lock` was not run."""
    asked = tomllib.loads((PROJECT / "pyproject.toml").read_text())["dependency-groups"][group]
    names = [re.match(r"[A-Za-z0-9._-]+", a)[0] for a in asked if isinstance(a, str)]
    assert names and not set(names) - versions(group).keys()


@pytest.mark.parametrize("group", LOCKED)
def test_no_group_moves_a_version_of_the_environment(group):
    """Fails if what is installed beside the environment would change it, and with it results."""
    base = versions("twingap")
    assert {n: v for n, v in versions(group).items() if base.get(n, v) != v} == {}
