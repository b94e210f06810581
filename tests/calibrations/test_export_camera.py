"""What a twin says of a camera goes out: as it is where a format holds it, else with its error, or not at all."""

import json

import numpy as np
import pytest
from cameras import LENSES, camera, twin

import export_camera
from calibrations.formats import available_formats, read_calibration
from calibrations.lens import project
from calibrations.refit import rays_of_frame
from effects import pipeline
from rig.errors import InputError

FORMATS = available_formats()
RADIAL = ("radial_distortion", {"k1": -0.12, "k2": 0.02, "k3": 0.004})
SHIFTED = [RADIAL, ("focal_length", {"ratio": 1.03}), ("principal_point", {"dx_px": 3.0, "dy_px": -2.0})]
COLOURS = ("lateral_chromatic_aberration", {"red_ratio": 1.001, "blue_ratio": 0.998})
DARK = ("vignetting", {"a2": 0.3, "a4": 0.1, "a6": -0.02})
NOISE = ("sensor_noise", {"gain_dn_per_e": 0.2, "read_noise_dn": 1.0})


@pytest.mark.parametrize("name", ["opencv", "opencv_camel", "ros", "mrcal", "colmap"])
def test_a_lens_that_a_format_holds_goes_out_as_it_is(tmp_path, name):
    """Fails if effects are composed in another order than images are made in."""
    given = twin(SHIFTED)
    text, told = export_camera.export_twin(given, FORMATS[name], 0.5)
    path = tmp_path / "c.x"
    path.write_text(text)
    rays = np.random.default_rng(0).uniform(-0.4, 0.4, (500, 2)) * [1, 0.7]
    ideal = rays * (given.K[0, 0], given.K[1, 1]) + given.K[:2, 2]
    landed = pipeline.map_points(ideal, given.view(), SHIFTED)
    np.testing.assert_allclose(project(read_calibration(path), rays), landed, atol=1e-6)
    assert told == [told[0]] and told[0].endswith("as it is")


def test_what_a_format_misses_is_told_in_pixels():
    """Fails if Kalibr's four coefficients take the place of five in silence, or the error told is not the real one."""
    own = camera("opencv", 5)
    own = type(own)(**own.__dict__ | {"coefficients": (*own.coefficients[:4], -0.02)})
    text, (told,) = export_camera.convert(own, "c", FORMATS["lensfun"], 50.0)
    assert "refitted, RMS" in told
    rays, pixels = rays_of_frame(own)
    lens = FORMATS["lensfun"].read(text, "here")["c lens"]
    back = FORMATS["lensfun"].for_size(lens, own.width, own.height)
    largest = np.linalg.norm(project(back, rays) - pixels, axis=1).max()
    assert f"at most {largest:.2g} px off" in told


def test_what_a_format_misses_by_far_is_refused():
    """Fails if a file is written that no one should use."""
    with pytest.raises(InputError, match=r"lensfun XML can't hold this lens: .* misses by up to .* px \(RMS"):
        export_camera.convert(camera("fisheye", 4), "c", FORMATS["lensfun"], 0.5)


def test_effects_without_a_place_are_named():
    """Fails if users think that noise or shading went along."""
    _, told = export_camera.export_twin(twin([RADIAL, COLOURS, DARK, NOISE]), FORMATS["opencv"], 0.5)
    assert "no place for lateral_chromatic_aberration, vignetting, sensor_noise" in told[1]


def test_lensfun_takes_colours_and_the_fall_off_of_light():
    """Fails if the fall-off is inverted, or its radius is another one."""
    text, told = export_camera.export_twin(twin([COLOURS, DARK, NOISE]), FORMATS["lensfun"], 0.5)
    back = FORMATS["lensfun"].read(text, "here")["here_cam lens"]
    assert (back.red, back.blue) == (pytest.approx(1.001, abs=1e-6), pytest.approx(0.998, abs=1e-6))
    np.testing.assert_allclose(back.falloff, (-0.3, -0.1, 0.02), atol=0.01)
    assert "no place for sensor_noise;" in told[1]


@pytest.mark.parametrize("source", [("opencv", 8), ("fisheye", 4)])
@pytest.mark.parametrize("name", FORMATS)
def test_a_file_is_converted_or_refused_in_words(tmp_path, source, name, monkeypatch):
    """Fails if a conversion ends in a traceback, or leaves half a file."""
    monkeypatch.chdir(tmp_path)
    (tmp_path / "mine.yaml").write_text(FORMATS["opencv"].write("mine", camera(*source)))
    try:
        export_camera.main(["mine.yaml", "--format", name])
    except SystemExit as refused:
        assert refused.code == 1
        assert [p.name for p in tmp_path.iterdir()] == ["mine.yaml"]
    else:
        found = read_calibration(tmp_path / f"mine_{name}{FORMATS[name].SUFFIX}", (1280, 720))
        rays, pixels = rays_of_frame(camera(*source))
        assert np.linalg.norm(project(found, rays) - pixels, axis=1).max() < 0.5
    assert source in LENSES


@pytest.fixture
def place(tmp_path, monkeypatch):
    """Work in a folder with a campaign and what its diagnosis said."""
    monkeypatch.chdir(tmp_path)
    folder = tmp_path / "mine"
    folder.mkdir()
    (folder / "campaign.yaml").write_text(
        "schema: 1\nname: c\norigin: camera\nmarkers: m.csv\ncaptures: c.csv\n"
        "cameras:\n  cam: {width: 200, height: 140, fx: 190.0, fy: 190.0, cx: 99.5, cy: 69.5}\n"
        "  free: {width: 200, height: 140}\n"
    )
    step = {"effect": RADIAL[0], "parameters": {k: {"value": v, "se": 0.01} for k, v in RADIAL[1].items()}}
    diagnosis = tmp_path / "results/c/diagnosis"
    diagnosis.mkdir(parents=True)
    said = {"campaign": "c", "camera": "cam", "verdict": "explained", "steps": [step], "candidates": []}
    (diagnosis / "cam.json").write_text(json.dumps(said))
    return tmp_path


def test_the_twins_file_goes_before_the_verdict(place):
    """Fails if what people edited is passed over, or --verdict does not ask for the other."""
    arguments = ["cam", "--format", "mrcal", "--campaign", "mine"]
    export_camera.main(arguments)
    assert read_calibration("cam.cameramodel").coefficients[0] == pytest.approx(-0.12, abs=1e-9)
    (place / "config/twins/c").mkdir(parents=True)
    (place / "config/twins/c/cam.yaml").write_text("effects:\n- {effect: focal_length, parameters: {ratio: 1.1}}\n")
    export_camera.main(arguments)
    assert read_calibration("cam.cameramodel").fx == pytest.approx(209.0)
    export_camera.main([*arguments, "--verdict"])
    assert read_calibration("cam.cameramodel").fx == pytest.approx(190.0)


def test_a_boards_whole_lens_goes_out(place):
    """Fails if small terms of a lens, or the focal length that nobody knew, stay behind because they have no name."""
    path = place / "results/c/diagnosis/cam.json"
    lens = [("focal_length", {"ratio": 1.1}), ("principal_point", {"dx_px": 2.0, "dy_px": -1.0})]
    effects = [{"effect": n, "parameters": {k: {"value": v, "se": 0.1} for k, v in p.items()}} for n, p in lens]
    path.write_text(json.dumps(json.loads(path.read_text()) | {"whole_lens": {"effects": effects}}))
    export_camera.main(["cam", "--format", "mrcal", "--campaign", "mine"])
    found = read_calibration("cam.cameramodel")
    assert (found.fx, found.cx, found.cy) == pytest.approx((209.0, 101.5, 68.5))
    assert found.coefficients[0] == pytest.approx(-0.12, abs=1e-9)


@pytest.mark.parametrize(("arguments", "message"), [
    (["other", "--format", "opencv"], "no such diagnosis"),
    (["cam", "--format", "zemax"], "there are colmap"),
    (["free", "--format", "opencv"], "no such diagnosis"),
    (["missing.yaml", "--format", "opencv"], "no such file"),
])  # fmt: skip
def test_a_wrong_command_is_one_line(place, capfd, arguments, message):
    """Fails if a user sees a traceback, or a file appears."""
    with pytest.raises(SystemExit) as end:
        export_camera.main([*arguments, "--campaign", "mine"])
    said = capfd.readouterr().err
    assert end.value.code == 1 and said.count("\n") == 1 and message in said
    assert sorted(p.name for p in place.iterdir()) == ["mine", "results"]
