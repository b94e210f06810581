"""A study of twins, config/studies/*.yaml: which stations of an experiment are looked at, and choices tried one at a time."""

from pathlib import Path

from pydantic import Field, ValidationError

from effects import library
from inputs.campaign import Strict
from inputs.safe_yaml import load_yaml, validation_message
from inputs.twins import read_effect
from rig.errors import InputError

Values = dict[str, dict[str, float]]


class Choice(Strict):
    """One choice where something is left open: the cameras' twins with other values."""

    open: str = Field(min_length=1, max_length=100, description="what is left open")
    choice: str = Field(min_length=1, max_length=200, description="what is chosen, in words")
    cameras: list[str] = Field(default_factory=list, description="cameras of the experiment; empty: all")
    effects: Values = Field(
        default_factory=dict, description="values that take the place of the twin's: effect, parameter, value"
    )
    times: Values = Field(
        default_factory=dict, description="factors of the twin's values; what its twin lacks leaves a camera out"
    )


class TwinStudy(Strict):
    """config/studies/NAME.yaml, NAME that of the experiment."""

    heights_m: list[float] = Field(min_length=1, description="stations: those of the experiment at these heights, m")
    detectors: list[str] = Field(min_length=1, description="detectors; their parameters are the configuration's")
    published_pct: dict[str, float] = Field(
        default_factory=dict, description="coverage of the real images that was published, per camera, %"
    )
    choices: list[Choice] = Field(default_factory=list, description="tried one at a time")


def load_study(path, experiment, detectors):
    """Return the TwinStudy in a file.

    experiment  DesignedCampaign that it is of; detectors those of the configuration
    Raises InputError naming the file and what the experiment, the configuration or the effects do not have.
    """
    if not Path(path).is_file():
        raise InputError(f"{path}: no such file: a study of the experiment {experiment.file.name} would be there")
    try:
        study = TwinStudy.model_validate(load_yaml(path))
    except ValidationError as error:
        raise InputError(validation_message(path, error, TwinStudy)) from None
    known = set(experiment.captures.height_m)
    _check(path, "heights_m", study.heights_m, sorted(h for h in known if h == h))
    _check(path, "detectors", study.detectors, detectors)
    _check(path, "published_pct", study.published_pct, experiment.file.cameras)
    for k, choice in enumerate(study.choices):
        where = f"{path}: choices, entry {k + 1}"
        _check(where, "cameras", choice.cameras, experiment.file.cameras)
        for name, values in choice.effects.items():
            read_effect(where, {"effect": name, "parameters": values})
        for name, factors in choice.times.items():
            read_effect(where, {"effect": name})
            _check(where, f"times.{name}", factors, library.parameters_of(name))
    return study


def _check(where, key, given, allowed):
    """Raise InputError for the first of ``given`` that is not allowed."""
    for value in given:
        if value not in allowed:
            raise InputError(f"{where}: {key}: {value!r} is not there; allowed are {', '.join(map(str, allowed))}")
