"""Studies of twins: what the tables say is what was looked at, presets say where each value is from."""

import os
import re
import subprocess
import sys

import cv2
import pandas as pd
import pytest
import yaml

from inputs.experiment import load_experiment
from inputs.safe_yaml import load_yaml
from inputs.twin_study import Choice, load_study
from inputs.twins import load_twin
from rig.errors import InputError
from summarise_study import ablation_of, best_choices, by_variant, choices_of
from tiny_campaign import board, write_campaign
from twin_study.variants import variants_of
from workflow_runs import PROJECT, copy_project, snakemake

PRESETS = sorted((PROJECT / "config/twins/presets").glob("*.yaml"))
PAPER = PROJECT / "config/experiments/paper.yaml"
BLUR, VIGNETTING = ("lens_blur", {"sigma_px": 8.0}), ("vignetting", {"a2": 0.2})
SMALL = {
    "experiments/small.yaml": {
        "name": "small",
        "cameras": {"one": "one.yaml", "tele": "one.yaml"},
        "rig": "few.yaml",
        "heights_m": [0.3, 0.4],
        "tilts_deg": [45.0],
    },
    "cameras/one.yaml": {"width": 480, "height": 360, "fov_deg": 60.0, "fov_axis": "horizontal"},
    "rigs/few.yaml": {
        "ladders": [
            {
                "dictionary": "DICT_5X5_1000",
                "plates": 4,
                "columns_x_m": [-0.07, 0.07],
                "first_y_m": 0.2,
                "step_y_m": 0.12,
            }
        ]
    },
    "studies/small.yaml": {
        "heights_m": [0.3],
        "detectors": ["aruco"],
        "published_pct": {"one": 50.0},
        "choices": [
            {"open": "blur", "choice": "next to none", "times": {"lens_blur": {"sigma_px": 0.05}}},
            {"open": "lens", "choice": "longer", "effects": {"focal_length": {"ratio": 1.6}}},
            {"open": "noise", "choice": "what this twin lacks", "times": {"sensor_noise": {"gain_dn_per_e": 2.0}}},
        ],
    },
    "twins/small/tele.yaml": {"effects": [{"effect": "focal_length", "parameters": {"ratio": 1.6}}]},
    "twins/small/one.yaml": {"effects": [{"effect": name, "parameters": p} for name, p in (BLUR, VIGNETTING)]},
}
SETTINGS = ["--config", "experiment=config/experiments/small.yaml", "render={edge_samples: 16, overscan: 0.0}"]


def write(project, files):
    """Write files of the configuration, {name: plain data}."""
    for name, data in files.items():
        path = project / "config" / name
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_text(yaml.safe_dump(data))


@pytest.fixture(scope="module")
def studied(tmp_path_factory):
    """Return the results of a run of a small experiment's study."""
    project = copy_project(tmp_path_factory.mktemp("study") / "project")
    write(project, SMALL)
    status, said = snakemake(project, "--cores", 1, "twin_study", *SETTINGS)
    assert status == 0, said[-4000:]
    return project / "results/small"


def test_what_the_rows_say_is_what_the_images_had(studied):
    """Fails if "all but" an effect still has it, "only" has others too, or choices start from another twin than the whole."""
    table = pd.read_csv(studied / "study/ablation.csv").query("camera == 'one'").set_index("twin")
    assert set(table.markers) == {4} and set(table.rig) == {4}
    found = {"no effect": 4, "only lens_blur": 0, "only vignetting": 4, "all but lens_blur": 4, "all but vignetting": 0}
    assert table.found.to_dict() == found | {"all effects": 0}
    assert table.change_pct["only lens_blur"] == -100 and table.change_pct["all but lens_blur"] == 100
    choices = pd.read_csv(studied / "study/choices.csv").query("camera == 'one'").set_index("choice")
    assert choices.found.to_dict()["next to none"] == 4 and choices.change_pct["next to none"] == 100
    assert choices.nearer_pct["next to none"] == 0  # from 0 to 100 %, and 50 % are published


def test_a_lens_moves_what_counts_as_in_the_picture(studied):
    """Fails if markers are sought where a pinhole would put them, of a choice of the lens or in the run's own tables."""
    table = pd.read_csv(studied / "study/readings/one.csv").set_index("name")
    assert 0 < table.markers["longer"] < 4
    cells = pd.read_parquet(studied / "aggregate/cells.parquet").query("camera == 'tele' and detector == 'aruco'")
    low = cells[cells.height_m == 0.3]
    assert low.available.sum() == low.twin.sum() == table.markers["longer"]


def test_a_study_tells_of_the_runs_own_twins(studied):
    """Fails if "all effects" are other images than those of the experiment's Tables 1 and 2."""
    cells = pd.read_parquet(studied / "aggregate/cells.parquet")
    mine = cells.query("camera == 'one' and detector == 'aruco' and height_m == 0.3 and available")
    whole = pd.read_csv(studied / "study/readings/one.csv").query("kind == 'whole'")
    assert (int(whole.markers.sum()), int(whole.found.sum())) == (len(mine), int(mine.twin.sum()))
    page = (studied / "study/study.md").read_text()
    assert "without effects the twin's coverage is 100.0 %, with all 0.0 %" in page


def test_a_study_gives_equal_bytes_again(studied):
    """Fails if readings or tables depend on anything but the files and names that they are made of."""
    files = [path for path in sorted((studied / "study").rglob("*")) if path.is_file()]
    first = {path: path.read_bytes() for path in files}
    status, said = snakemake(studied.parents[1], "--cores", 1, "twin_study", "--forcerun", "study_twin", *SETTINGS)
    assert status == 0 and "study_twin" in said, said[-4000:]
    assert {path: path.read_bytes() for path in files} == first and len(files) == 7


def test_pictures_are_drawn_of_a_studys_run(studied, tmp_path):
    """Fails if the pictures of `make paper` need what a run and its study do not have."""
    drawn = [tmp_path / "figure3.png", tmp_path / "effects.png"]
    command = [sys.executable, PROJECT / "notebooks/paper_picture.py", studied, *drawn]
    environment = os.environ | {"PYTHONPATH": str(PROJECT / "scripts")}
    done = subprocess.run(command, env=environment, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr
    sizes = [cv2.imread(str(path)).shape for path in drawn]
    assert sizes[0][1] > sizes[0][0] > 100 and sizes[1][1] > 700


def test_variants_change_one_thing_each():
    """Fails if a variant has more or less than its name says, or if changing one changes the twin itself."""
    choices = SMALL["studies/small.yaml"]["choices"]
    made = variants_of([BLUR, VIGNETTING], "one", [Choice(**c).model_dump() for c in choices])
    told = {(v.kind, v.name): dict(v.effects) for v in made}
    assert told["ideal", ""] == {} and told["whole", ""] == dict([BLUR, VIGNETTING])
    assert told["alone", "lens_blur"] == dict([BLUR]) and told["without", "lens_blur"] == dict([VIGNETTING])
    assert told["choice", "next to none"] == {"lens_blur": {"sigma_px": 0.4}} | dict([VIGNETTING])
    assert told["choice", "longer"] == dict([BLUR, VIGNETTING]) | {"focal_length": {"ratio": 1.6}}
    assert ("choice", "what this twin lacks") not in told and BLUR[1] == {"sigma_px": 8.0}


def test_tables_are_sums_over_stations():
    """Fails if stations count alike whatever they show, or if nearer and farther change sides."""
    names = ["camera", "station", "height_m", "tilt_deg", "kind", "name", "open", "detector"]
    counts = ["rig", "markers", "found", "false_ids"]
    rows = [
        ["a", s, 0.3, 0.0, kind, name, opened, "d", 10, markers, found, 0]
        for s, markers in (("s", 2), ("t", 8))
        for kind, name, opened, found in (
            ("ideal", "", "", markers),
            ("whole", "", "", markers // 2),
            ("choice", "more", "light", markers // 2 + 1),
        )
    ]
    variants = by_variant(pd.DataFrame(rows, columns=names + counts))
    assert variants.coverage_pct.tolist() == [100, 50, 70] and variants.coverage_rig_pct.tolist() == [50, 25, 35]
    assert ablation_of(variants).change_pct.tolist() == [0, -50]
    choices = choices_of(variants, {"a": 80.0})
    assert choices.nearer_pct.tolist() == [20] and choices.nearer_rig_pct.tolist() == [10]
    assert best_choices(choices) == '- a, d: light, "more", comes nearest: 70.0 %, by 20.0 points.'
    assert best_choices(choices_of(variants, {})) == ""


@pytest.mark.parametrize("path", PRESETS, ids=lambda path: path.stem)
def test_each_value_of_a_preset_has_its_source_or_is_called_a_guess(path):
    """Fails if a value has neither, or if a preset can't be loaded."""
    values = sum(len(entry["parameters"]) for entry in load_yaml(path)["effects"])
    lines = re.findall(r"^ {6}(\w+): [-0-9.]+(.*)$", path.read_text(), re.M)
    assert len(lines) == values > 0 and load_twin(path).free == []
    assert [name for name, comment in lines if not re.match(r" +# (source|guess): \S", comment)] == []


def test_the_papers_twins_are_the_presets():
    """Fails if a camera of the paper has no preset, or another one's."""
    for camera in load_experiment(PAPER).file.cameras:
        own = PROJECT / f"config/twins/paper/{camera}.yaml"
        assert load_twin(own) == load_twin(PROJECT / f"config/twins/presets/{camera}.yaml")


def test_focal_lengths_of_the_papers_choices_are_what_their_words_say():
    """Fails if a ratio is not that of the pixels told, by more than they are rounded."""
    experiment = load_experiment(PAPER)
    study = load_study(PROJECT / "config/studies/paper.yaml", experiment, ["aruco", "bart"])
    told = [(c, int(m[1])) for c in study.choices if (m := re.search(r"f = (\d+) px", c.choice))]
    assert len(told) == 7
    for choice, focal_px in told:
        nominal = experiment.file.cameras[choice.cameras[0]].fx
        assert choice.effects["focal_length"]["ratio"] * nominal == pytest.approx(focal_px, abs=0.6)


@pytest.mark.parametrize(
    ("change", "words"),
    [
        ({"heights_m": [0.5]}, ["studies/small.yaml", "heights_m", "0.5", "0.3, 0.4"]),
        ({"detectors": ["bart"]}, ["detectors", "'bart'", "aruco"]),
        ({"published_pct": {"two": 1.0}}, ["published_pct", "'two'", "one, tele"]),
        ({"choices": [{"open": "a", "choice": "b", "effects": {"haze": {}}}]}, ["entry 1", "unknown effect 'haze'"]),
        (
            {"choices": [{"open": "a", "choice": "b", "times": {"lens_blur": {"px": 2}}}]},
            ["entry 1", "'px'", "sigma_px"],
        ),
        ({"choices": [{"open": "a"}]}, ["choices.0.choice", "required"]),
    ],
)
def test_a_wrong_study_is_refused(tmp_path, change, words):
    """Fails if a misspelt height, camera, effect or parameter is looked at as nothing."""
    write(tmp_path, SMALL | {"studies/small.yaml": SMALL["studies/small.yaml"] | change})
    experiment = load_experiment(tmp_path / "config/experiments/small.yaml")
    with pytest.raises(InputError) as error:
        load_study(tmp_path / "config/studies/small.yaml", experiment, ["aruco"])
    for word in words:
        assert word in str(error.value)


@pytest.mark.parametrize(
    ("source", "words"),
    [
        ("experiment=config/experiments/carriage.yaml", "config/studies/carriage.yaml: no such file"),
        ("campaign=board", "a study of twins is of an experiment without photographs"),
    ],
)
def test_a_study_of_nothing_ends_the_plan(studied, source, words):
    """Fails if a campaign, or an experiment without a study, comes to a job or ends with a traceback."""
    project = studied.parents[1]
    if not (project / "board").is_dir():
        write_campaign(project / "board", describe=board)
    status, said = snakemake(project, "-n", "twin_study", "--config", source)
    assert status == 1 and [line for line in said.splitlines() if line.startswith("error: ")][0].count(words) == 1
    assert "Traceback" not in said
