"""The models are the only source of the configuration: generated files are in step, what is wrong is named."""

import pytest

import generate_config
from inputs.config import check_config
from inputs.safe_yaml import load_yaml
from rig.errors import InputError


@pytest.mark.parametrize(
    "path", sorted(generate_config.generated()), ids=lambda path: f"{path.parent.name}-{path.name}"
)
def test_generated_files_are_in_step_with_the_models(path):
    """Repair: python scripts/generate_config.py"""
    assert path.read_text() == generate_config.generated()[path]


def test_the_commented_default_is_the_default():
    """Otherwise a user who edits the file starts from other values than one who has none."""
    assert check_config(load_yaml(generate_config.CONFIG / "config.default.yaml")) == check_config({})


@pytest.mark.parametrize(
    ("data", "words"),
    [
        ({"frobnicate": 1}, ["frobnicate", "unknown key", "campaign"]),
        ({"render": {"device": "tpu"}}, ["render.device", "'tpu'", "'cpu' or 'gpu'"]),
        ({"render": {"edge_samples": 0}}, ["render.edge_samples", "'0'", "greater than or equal to 16"]),
        ({"render": {"overscan": float("nan")}}, ["render.overscan", "finite"]),
        ({"render": 3}, ["render", "3"]),
        ({"campaign": None}, ["campaign", "experiment"]),
        ({"detectors": ["aruco"]}, ["detectors"]),
        ({"aggregate": {"reference_detector": "nobody"}}, ["aggregate.reference_detector", "'nobody'", "aruco"]),
    ],
)
def test_a_wrong_value_is_named_with_what_is_allowed(data, words):
    with pytest.raises(InputError) as error:
        check_config(data)
    for word in words:
        assert word in str(error.value)


def test_values_of_the_command_line_arrive_as_meant():
    """Snakemake hands nested values of --config over as text, and null as the word."""
    done = check_config({"campaign": "null", "experiment": "x.yaml", "render": {"threads": "2"}})
    assert done["campaign"] is None
    assert done["render"]["threads"] == 2


def test_parameters_of_detectors_arrive_as_meant():
    """--config "detectors={bart: {multi_scale: false}}" arrives as the text 'false', which is no bool."""
    given = {"bart": {"multi_scale": "false", "window_px": "15", "coarse_mpx": "0.8", "threshold": "mean"}}
    done = check_config({"detectors": given | {"aruco": {}}})["detectors"]
    assert done["bart"] == {"multi_scale": False, "window_px": 15, "coarse_mpx": 0.8, "threshold": "mean"}


def test_null_takes_a_detector_out():
    """Snakemake merges a user's settings into the default ones: leaving a name out leaves it in."""
    done = check_config({"detectors": {"aruco": {}, "aruco_subpix": "null", "bart": None}})
    assert done["detectors"] == {"aruco": {}}


def test_an_experiment_takes_the_campaigns_place():
    done = check_config({"campaign": "data/raw/frame", "experiment": "x.yaml"})
    assert (done["campaign"], done["experiment"]) == (None, "x.yaml")
