"""A render's key holds everything that decides its pixels: what it misses leaves old pixels standing."""

import shutil
from dataclasses import dataclass, fields, replace

import numpy as np
import pytest

import kernels
from effects.base import Scene
from inputs import render_store
from render_stations import key_of
from rig.plates import Plate

DISCS = np.array([[0.05, 0.05, 0.01, 0.0]])
PLATE = Plate("p", np.eye(4), np.array([0.0, 0.1]), np.array([0.0, 0.1]), np.array([[True]]), DISCS)
REST = (np.eye(3), (64, 48), 4, 16, "CPU", "5.2.3", np.eye(4))


@dataclass(frozen=True)
class Hazy(Scene):
    """A scene with a field that came later."""

    haze: float = 0.0


SCENE = Hazy((PLATE,), 0.8, 0.05, 0.35, 0.3)


def other(value):
    """Return a value that differs from ``value`` as little as matters."""
    if value is None:
        return {"strength": 1.0}
    if isinstance(value, str):
        return value + "q"
    if isinstance(value, tuple):
        return (*value[:-1], value[-1] + 1)
    if isinstance(value, np.ndarray) and value.dtype == bool:
        return ~value
    return value + 1e-9


@pytest.mark.parametrize("name", [f.name for f in fields(SCENE) if f.name != "plates"])
def test_each_field_of_the_scene_is_in_the_key(name):
    """Fails if a field is left out of the key: an effect that changes it would be adopted and never rendered."""
    changed = SCENE.with_(**{name: other(getattr(SCENE, name))})
    assert key_of(changed, *REST) != key_of(SCENE, *REST) == key_of(SCENE.with_(), *REST)


@pytest.mark.parametrize("name", [f.name for f in fields(PLATE)])
def test_each_field_of_a_plate_is_in_the_key(name):
    """Fails if a plate that lies elsewhere, or shows another code, keeps the old render."""
    changed = SCENE.with_(plates=(replace(PLATE, **{name: other(getattr(PLATE, name))}),))
    assert key_of(changed, *REST) != key_of(SCENE, *REST)


@pytest.mark.parametrize("k", range(len(REST)))
def test_camera_pose_and_settings_are_in_the_key(k):
    """Fails if another pose, size, number of samples or version of Blender keeps the old render."""
    assert key_of(SCENE, *REST[:k], other(REST[k]), *REST[k + 1 :]) != key_of(SCENE, *REST)


def test_what_cannot_be_written_down_is_no_key():
    """Fails if an object is hashed by its address: everything would be rendered again in every run."""
    with pytest.raises(TypeError, match="object"):
        key_of(SCENE.with_(light=object()), *REST)


@pytest.mark.parametrize("edited", ["blender/renderer.py", "blender/faces.py", "rig/geometry.py", "effects/base.py"])
def test_all_code_that_renders_is_in_the_key(tmp_path, monkeypatch, edited):
    """Fails if an edit of what draws, or of what that imports, leaves pixels of before standing."""
    hashes = []
    for change in ("", "", "\n# edited\n"):
        scripts = tmp_path / f"{len(hashes)}"
        shutil.copytree(
            kernels.__file__.removesuffix("kernels.py"), scripts, ignore=shutil.ignore_patterns("__pycache__")
        )
        with (scripts / edited).open("a") as file:
            file.write(change)
        with monkeypatch.context() as patched:
            for module in (kernels, render_store):
                patched.setattr(module, "SCRIPTS", scripts)
            hashes.append([render_store.code_sha256(f"blender/{name}.py") for name in ("renderer", "moving")])
    assert hashes[0] == hashes[1] and not set(hashes[0]) & set(hashes[2])
