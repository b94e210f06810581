"""The exported file does to an image what the project does, bit for bit, and needs nothing of it."""

import importlib.util
import subprocess
import sys

import cv2
import numpy as np
import pytest
from cameras import twin

from effects import library, pipeline
from job import write_atomically
from rig.geometry import camera_matrix
from twin_bundle import twin_camera_file

NOT_IN_THE_SCENE = [n for n, m in library.available_effects().items() if m.STAGE != "scene"]
# In another interpreter, which has numpy and OpenCV and refuses all else that the project uses
ALONE = """
import sys
class Refuse:
    def find_spec(self, name, path=None, target=None):
        if name.partition(".")[0] in ("numba", "scipy", "PIL", "pydantic", "rig", "effects", "job", "imports"):
            raise ImportError(name)
sys.meta_path.insert(0, Refuse())
import numpy as np
import twin_camera
clean = np.load("clean.npy")
np.save("alone.npy", twin_camera.apply(clean, seed=5, T_cam_world=np.load("pose.npy")))
"""


def strong(name):
    """Return parameters of an effect that show: a start of its fit, what is at its null there moved off it."""
    made, known = {}, library.parameters_of(name)
    steps = 4 if len(known) < 20 else 0.5  # many small ones add up
    for key, p in known.items():
        value = library.starts_of(name)[0][key]
        made[key] = value if p.is_choice or value != p.null else min(max(p.null + steps * p.matters, p.lower), p.upper)
    return made


def exported(folder, given):
    """Return the module that a CameraTwin is exported to."""
    text, _ = twin_camera_file(given)
    with write_atomically(folder / "twin_camera.py") as file:
        file.write(text)
    spec = importlib.util.spec_from_file_location("twin_camera", folder / "twin_camera.py")
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


def render(given, margin, channels=1, seed=0):
    """Return a linear image of squares with a margin, (H, W) or (H, W, 3)."""
    rng = np.random.default_rng(seed)
    height, width = given.height + 2 * margin, given.width + 2 * margin
    squares = rng.uniform(0.02, 0.9, (height // 12 + 1, width // 12 + 1, channels))
    image = np.kron(squares, np.ones((12, 12, 1)))[:height, :width].astype(np.float32)
    return image[..., 0] if channels == 1 else image


def by_the_project(given, image, margin, seed):
    """Return what the project makes of the same render."""
    effects = [(n, p) for n, p in given.effects if n in NOT_IN_THE_SCENE]
    made = pipeline.to_uint8(pipeline.form_image(image, given.view(margin), effects, np.random.default_rng(seed)))
    return made[..., 0] if made.shape[2] == 1 else made


@pytest.fixture(scope="module")
def whole(tmp_path_factory):
    """Return (CameraTwin of all effects and one of the scene, the module that it is exported to)."""
    scene = [("marker_scale", {"scale": 1.1})]
    given = twin(pipeline.in_order([(n, strong(n)) for n in NOT_IN_THE_SCENE] + scene))
    return given, exported(tmp_path_factory.mktemp("whole"), given)


@pytest.mark.parametrize("channels", [1, 3])
@pytest.mark.parametrize("name", NOT_IN_THE_SCENE)
def test_every_effect_does_the_same_outside(whole, monkeypatch, name, channels):
    """Fails if an effect's code, or its parameters, change on the way into the file."""
    module, given = whole[1], twin([(name, strong(name))])
    monkeypatch.setitem(module.TWIN, "effects", [e for e in module.TWIN["effects"] if e[0] == name])
    image = render(given, 48, channels)
    pose = given.view().T_cam_world
    np.testing.assert_array_equal(module.apply(image, 5, pose), by_the_project(given, image, 48, 5))


def test_a_whole_twin_does_the_same_outside(whole):
    """Fails if effects act in another order there, or one of the scene is applied to an image."""
    given, module = whole
    assert module.TWIN["left_out"] == ["marker_scale"]
    image = render(given, 60, 3)
    pose = given.view().T_cam_world
    np.testing.assert_array_equal(module.apply(image, 1, pose), by_the_project(given, image, 60, 1))


def test_it_runs_with_numpy_and_opencv_alone(tmp_path):
    """Fails if the file needs scipy, numba, Pillow or a module of the project."""
    slow, folds = "denoising", "local_warp"  # where loops are not compiled; a frame that is as small
    names = [n for n in NOT_IN_THE_SCENE if n not in (slow, folds)]
    given = twin(
        pipeline.in_order([(n, strong(n)) for n in names]), K=camera_matrix(60.0, 60.0, 23.0, 16.0), width=48, height=32
    )
    module = exported(tmp_path, given)
    image, pose = render(given, 40), given.view().T_cam_world
    np.save(tmp_path / "clean.npy", image)
    np.save(tmp_path / "pose.npy", pose)
    subprocess.run([sys.executable, "-c", ALONE], cwd=tmp_path, check=True, timeout=300)
    alone = np.load(tmp_path / "alone.npy").astype(int)
    # where loops are not compiled, some sums are rounded elsewhere, and a level may fall on the other side of a half
    assert np.abs(alone - module.apply(image, 5, pose)).max() <= 2
    assert (alone == module.apply(image, 5, pose)).mean() > 0.99


def test_points_land_where_the_twin_has_them(tmp_path):
    """Fails if projection leaves out an effect, or takes z for something else than depth."""
    effects = [("radial_distortion", {"k1": -0.2}), ("focal_length", {"ratio": 1.02})]
    given = twin(effects)
    points = np.random.default_rng(2).uniform([-0.8, -0.5, 2], [0.8, 0.5, 4], (50, 3))
    ideal = points[:, :2] / points[:, 2:] * (given.K[0, 0], given.K[1, 1]) + given.K[:2, 2]
    landed = pipeline.map_points(ideal, given.view(), effects)
    np.testing.assert_allclose(exported(tmp_path, given).project(points), landed, atol=1e-12)


def test_the_margin_it_asks_for_is_enough_and_hardly_more(whole, monkeypatch):
    """Fails if users must guess how much more than the frame to render."""
    module, given = whole[1], twin([("radial_distortion", {"k1": -0.3})])
    monkeypatch.setitem(module.TWIN, "effects", given.effects)
    needed = module.margin_px()
    module.apply(render(given, needed))
    with pytest.raises(Exception, match="beyond the rendered margin"):
        module.apply(render(given, needed - 6))
    assert module.apply(render(given, 0), fill=True).shape == (140, 200)


def test_depth_is_asked_for_where_an_effect_depends_on_it(tmp_path):
    """Fails if a blur by depth is left out in silence for want of a pose."""
    given = twin([("defocus", {"blur_px_per_dioptre": 2.0, "focus_m": 0.5})])
    module = exported(tmp_path, given)
    with pytest.raises(Exception, match="depends on depth: give T_cam_world"):
        module.apply(render(given, 48))


def test_a_clean_picture_of_an_ideal_twin_stays_as_it_is(tmp_path):
    """Fails if exposure or encoding are applied one way only."""
    given = twin([], noise_dn=0.0)
    module = exported(tmp_path, given)
    image = np.random.default_rng(0).integers(0, 256, (140, 200, 3), np.uint8)
    assert np.abs(module.apply_to_image(image).astype(int) - image).max() <= 1


def test_the_command_line_writes_a_picture(tmp_path):
    """Fails if files' colours change places: OpenCV's are blue first."""
    exported(tmp_path, twin([], noise_dn=0.0))
    image = np.zeros((140, 200, 3), np.uint8)
    image[..., 2] = 200
    cv2.imwrite(str(tmp_path / "clean.png"), image)
    command = [sys.executable, "twin_camera.py", "clean.png", "out.png"]
    subprocess.run(command, cwd=tmp_path, check=True, timeout=120)
    np.testing.assert_array_equal(cv2.imread(str(tmp_path / "out.png")), image)
    wrong = subprocess.run([*command[:2], "no.png", "x.png"], cwd=tmp_path, capture_output=True, text=True, check=False)
    assert wrong.returncode == 1 and wrong.stderr.endswith("\nerror: no.png: no image of 8 bits\n")
