"""Exposing turns one render a station into one image a capture: own noise, the same bytes each time, colour if any."""

import json

import cv2
import numpy as np
import pandas as pd
import pytest
from effect_views import MARGIN, view

from effects import library
from expose_twin import expose_twin
from inputs import tables
from inputs.photo_facts import photo_facts
from inputs.render_store import write_station
from light_captures import twins_in_light
from rig.errors import InputError
from rig.geometry import split_pose
from rig.light import LIGHT

WIDTH, HEIGHT = 120, 80


@pytest.fixture
def run(tmp_path):
    """Return a function that exposes a camera of two captures of one station and one of a station without pose."""
    v = view(width=WIDTH, height=HEIGHT)
    camera = [["cam", WIDTH, HEIGHT, v.K[0, 0], v.K[1, 1], v.K[0, 2], v.K[1, 2]]]
    captures = [[f"a{k}", "cam", "s", k, f"a{k}.png", "", None, None] for k in (0, 1)]
    captures.append(["lost", "cam", "nowhere", 0, "lost.png", "", None, None])
    for name, rows, schema in (("cameras", camera, tables.CAMERAS), ("captures", captures, tables.CAPTURES)):
        table = pd.DataFrame(rows, columns=list(schema.columns))
        if name == "captures":
            table = table.astype({"frame": "Int64", "t_s": float})
        tables.write_table(table, tmp_path / f"expand/{name}.csv", schema)
    facts = {"name": "c", "exposure": 1.0, "encoding": "srgb", "noise_dn": 2.0}
    (tmp_path / "expand/scene.json").write_text(json.dumps(facts))
    intrinsics = dict(zip(("fx", "fy", "cx", "cy"), camera[0][3:], strict=True))
    (tmp_path / "register.json").write_text(json.dumps(intrinsics | {"inverted": False}))
    radiance = np.full((HEIGHT + 2 * MARGIN, WIDTH + 2 * MARGIN), 0.3, np.float32)
    write_station(tmp_path / "render/cam", "s", radiance, MARGIN, "key")
    pose = np.concatenate(split_pose(v.T_cam_world)).tolist()
    entry = {"file": "cam/s.npz", "key": "key", "pose": pose}
    (tmp_path / "render/cam.json").write_text(json.dumps({"stations": {"s": entry}}))

    def expose(effects=(), seed="seed", light=None, files=None):
        paths = (tmp_path / "expand", tmp_path / "register.json", tmp_path / "render/cam.json")
        expose_twin(*paths, light, files, "cam", list(effects), seed, tmp_path / "twin/cam")
        assert [p.name for p in (tmp_path / "twin").iterdir()] == ["cam"]
        return {p.stem: p.read_bytes() for p in sorted((tmp_path / "twin/cam").iterdir())}

    return expose


def pixels(data):
    """Return the pixels of PNG bytes as they are stored."""
    return cv2.imdecode(np.frombuffer(data, np.uint8), cv2.IMREAD_UNCHANGED)


def test_trials_share_the_render_not_the_noise(run):
    """Noise repeated between trials would look like a fixed pattern; other noise in a second run like a change."""
    first, again = run(), run()
    assert first == again
    assert list(first) == ["a0", "a1"]  # `lost` has no pose, hence no twin
    a, b = (pixels(data).astype(float) for data in first.values())
    assert a.shape == (HEIGHT, WIDTH)
    assert (a - b).std() == pytest.approx(2.0 * np.sqrt(2), rel=0.05)
    assert run(seed="other") != first


def test_effects_reach_the_file(run):
    """Red is brighter where red's gain is: channels are stored in the order that readers expect."""
    images = run([["colour_balance", library.nulls_of("colour_balance") | {"red_gain": 1.3}]])
    blue, green, red = pixels(images["a0"]).reshape(-1, 3).mean(axis=0)
    assert red > green + 5
    assert blue == pytest.approx(green, abs=0.5)


def test_a_photograph_of_a_board_has_its_own_light(run, tmp_path):
    """Fails if the twin of a photograph by warm light from the right is grey and even, or one's light lies on another."""
    scene = tmp_path / "expand/scene.json"
    board = {"type": "chessboard", "columns": 8, "rows": 6, "square_m": 0.03}
    reflectance = {"white": 0.8, "black": 0.05, "ground": 0.3, "background": 0.3}
    scene.write_text(json.dumps(json.loads(scene.read_text()) | {"target": board, "reflectance": reflectance}))
    lights = pd.DataFrame(np.nan, index=[0, 1], columns=list(tables.LIGHTS.columns)).assign(capture=["a0", "a1"])
    light = dict.fromkeys(LIGHT, 0.0) | {"gain": -0.3, "along_x": 0.3, "red": 0.2, "blue": -0.2}
    lights.loc[0, list(light)] = list(light.values())
    tables.write_table(lights, tmp_path / "light.csv", tables.LIGHTS)
    plain, images = run(), run(light=tmp_path / "light.csv")
    assert images["a1"] == plain["a1"]  # too little was seen of it
    blue, green, red = pixels(images["a0"])[HEIGHT // 2 :].reshape(-1, 3).mean(axis=0)
    assert red > green + 5 > blue + 10
    left, right = (pixels(images["a0"])[HEIGHT // 2 :, side, 1].mean() for side in (slice(0, 30), slice(-30, None)))
    assert right > left + 10


def test_a_light_is_sought_behind_what_the_twin_does_to_levels(run, tmp_path):
    """Fails if a twin's vignetting is left out where light is sought, or a lens alone makes it be sought twice."""
    run()
    paths, place = (tmp_path / "expand", tmp_path / "register.json", tmp_path / "render/cam.json"), lambda x, y: (x, y)
    dark = [("vignetting", library.nulls_of("vignetting") | {"a2": 0.6})]
    twins = twins_in_light(*paths, "cam", dark, place)
    assert sorted(twins) == ["a0", "a1"]
    shown = twins["a0"](np.zeros(len(LIGHT)))
    assert shown.shape == (HEIGHT, WIDTH, 3) and shown[0, 0, 1] < shown[HEIGHT // 2, WIDTH // 2, 1] - 20
    assert twins_in_light(*paths, "cam", [("radial_distortion", {"k1": -0.1})], place) == {}


def test_the_twin_of_a_jpeg_is_one(run, tmp_path):
    """Fails if a photograph's own tables are not in its twin, or are in that of a photograph whose file has none."""
    (tmp_path / "a0.jpg").write_bytes(
        cv2.imencode(".jpg", np.zeros((16, 16, 3), np.uint8), [cv2.IMWRITE_JPEG_QUALITY, 20])[1]
    )
    (tmp_path / "a1.png").write_bytes(cv2.imencode(".png", np.zeros((16, 16, 3), np.uint8))[1])
    facts = [photo_facts(path) | {"capture": path.stem} for path in (tmp_path / "a0.jpg", tmp_path / "a1.png")]
    files = pd.DataFrame(facts, columns=list(tables.FILES.columns))
    tables.write_table(
        files.astype({"jpeg_quality": "Int64", "orientation": "Int64"}), tmp_path / "files.csv", tables.FILES
    )
    plain, images = run(), run(files=tmp_path / "files.csv")
    assert images["a1"] == plain["a1"]
    noisy, compressed = (pixels(data["a0"]).astype(float) for data in (plain, images))
    assert compressed.std() < 0.5 * noisy.std()  # noise of two grey levels is below a step


def test_a_lens_that_looks_too_far_leaves_nothing(run, tmp_path):
    """Half a folder of images would be taken for all of them."""
    with pytest.raises(InputError, match="render.overscan"):
        run([["focal_length", {"ratio": 0.5}]])
    assert list((tmp_path / "twin").iterdir()) == []
