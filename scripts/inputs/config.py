"""The workflow's configuration: these models are its only source.

The commented default (config/config.default.yaml), the JSON schema and the table in config/README.md are generated
from them by ``python scripts/generate_config.py``.
"""

from typing import Annotated, Literal

from pydantic import BaseModel, BeforeValidator, ConfigDict, Field, ValidationError
from ruamel.yaml.error import YAMLError

from inputs.safe_yaml import reader, validation_message
from rig.errors import InputError


def _null(value):
    return None if value in ("null", "None", "") else value


# The command line's `--config campaign=null` arrives as text.
MaybePath = Annotated[str | None, BeforeValidator(_null)]


def _as_in_a_file(value):
    """Return a value with texts such as ``false`` and ``2`` read as a YAML file's: --config hands texts over."""
    if isinstance(value, dict):
        return {key: _as_in_a_file(v) for key, v in value.items()}
    if isinstance(value, list):
        return [_as_in_a_file(v) for v in value]
    if not isinstance(value, str):
        return value
    try:
        read = reader().load(value)
    except (YAMLError, ValueError):
        return value
    return read if read is None or isinstance(read, bool | int | float) else value


def _chosen(detectors):
    """Return the detectors without those that are null: Snakemake merges settings, so there is no other way out."""
    detectors = _as_in_a_file(detectors)
    if not isinstance(detectors, dict):
        return detectors
    return {name: parameters for name, parameters in detectors.items() if parameters is not None}


Detectors = Annotated[dict[str, dict], BeforeValidator(_chosen)]


class Settings(BaseModel):
    """No unknown keys, no NaN. Text is read as numbers where they are meant: so values of --config arrive."""

    model_config = ConfigDict(extra="forbid", allow_inf_nan=False, coerce_numbers_to_str=True)


# by default: which of them run, the rig's markers decide
DETECTORS = "aruco aruco_subpix aruco3 aruco_apriltag bart apriltag locus rapidtag stag".split()


class Render(Settings):
    """Blender: linear radiance of every station."""

    device: Literal["cpu", "gpu"] = Field("cpu", description="gpu is used where Blender finds one, else the CPU")
    edge_samples: int = Field(
        256, ge=16, le=16384, description="samples in pixels that an edge crosses; fewer are faster and noisier"
    )
    overscan: float = Field(
        0.12, ge=0, le=1, description="margin on each side, share of the longer side; a strongly bent lens needs more"
    )
    threads: int = Field(1, ge=1, le=256, description="threads of one render job")


class Aggregate(Settings):
    """Tables 1 and 2."""

    reference_detector: str = Field("aruco", description="whose detections Table 1 counts")


class Diagnose(Settings):
    """Which effect is missing."""

    candidates: list[str] = Field(
        default_factory=list, description="effects that compete; empty: all in scripts/effects", max_length=200
    )
    budget: int = Field(
        60_000,
        ge=100,
        le=10_000_000,
        description="predictions of one capture that a diagnosis may take; some 20 ms each",
    )
    cells: bool = Field(
        True,
        description="look at a board's cells (blur, noise, colour) besides its points: one to three minutes",
    )


class Explore(Settings):
    """The page to explore."""

    captures: int = Field(
        9,
        ge=0,
        le=1_000_000,
        description="captures of a camera that are shown with every twin of the ladder at full size, some 0.5 s and 1.3 MB each",
    )


class BlindTrials(Settings):
    """Campaigns with a hidden effect, for `snakemake blind_trials`: how many of each kind (docs/blind-trials.md)."""

    single: int = Field(29, ge=0, le=10_000, description="one effect of the library; 29 hide each once")
    pair: int = Field(10, ge=0, le=10_000, description="two effects")
    none: int = Field(10, ge=0, le=10_000, description="nothing")
    outside: int = Field(10, ge=0, le=10_000, description="an effect that the library lacks; 10 hide each once")
    power: int = Field(0, ge=0, le=10_000, description="strengths 0.25, 0.5, 1 of an effect; 87 try each once")
    whole: int = Field(0, ge=0, le=10_000, description="a whole camera: four to nine effects of the library at once")
    real: int = Field(
        0, ge=0, le=10_000, description="photographs of boards, one effect laid on or, of every third, none"
    )
    photographs: MaybePath = Field(None, description="folder of campaigns of boards, for real")
    size: Literal["standard", "small", "tiny", "few", "near"] = Field(
        "standard",
        description="standard: 20 captures of half a megapixel; small: 8; tiny: 4; few, near: other rigs (docs/blind-trials.md)",
    )
    seed: str = Field("trials", max_length=64, description="another name gives other trials")


class IdStudy(Settings):
    """All ids of some families through the same views, for `snakemake id_study` (docs/markers.md)."""

    families: list[str] = Field(
        default_factory=lambda: ["DICT_ARUCO_ORIGINAL", "DICT_5X5_1000"],
        min_length=1,
        max_length=50,
        description="families of markers; all of them are sought in every image",
    )
    ids: int | None = Field(None, ge=1, le=1_000_000, description="ids of a family, evenly spread; null: all")
    views: int = Field(20, ge=1, le=1000, description="views that every id goes through")
    batch: int = Field(128, ge=1, le=1_000_000, description="ids that one job looks at")


class PosesStudy(Settings):
    """One marker in all six degrees of freedom before a camera, for `snakemake poses_study` (docs/markers.md)."""

    families: list[str] = Field(
        default_factory=lambda: ["DICT_5X5_1000"],
        min_length=1,
        max_length=50,
        description="families of markers, one after the other in the same poses; all of them are sought in every image",
    )
    id: int = Field(0, ge=0, le=1_000_000, description="the marker's id in each family")
    poses: int = Field(2000, ge=1, le=100_000, description="poses, evenly spread over six degrees of freedom")
    draws: int = Field(5, ge=2, le=1000, description="images of a pose, each with noise of its own")
    nearest_m: float = Field(0.4, ge=0.3, le=1000, description="least distance of the camera from the print of 7 cm")
    farthest_m: float = Field(4.0, ge=0.3, le=1000, description="greatest distance; at 4 m the print is 9.7 px wide")
    steepest_deg: float = Field(
        80.0, gt=0, le=88, description="greatest angle between line of sight and marker's normal"
    )
    trackers: Detectors = Field(
        default_factory=dict, description="detectors that look besides those of detectors, with their parameters"
    )
    batch: int = Field(250, ge=1, le=1_000_000, description="poses that one job looks at")


class Config(Settings):
    """config.yaml"""

    campaign: MaybePath = Field("data/raw/frame", description="folder of measurements; see docs/campaign-format.md")
    baseline: MaybePath = Field(
        None,
        description="an earlier campaign of the same cameras; a diagnosis then says what has changed since",
    )
    experiment: MaybePath = Field(
        None,
        description="a designed experiment without photographs, in the campaign's place (config/experiments)",
    )
    seed: str = Field("twingap", max_length=64, description="enters every random number, together with names")
    detectors: Detectors = Field(
        default_factory=lambda: {name: {} for name in DETECTORS},
        description="detectors that run where they read the rig's markers, each with parameters that differ from its "
        "defaults; null takes one out",
    )
    batch: int = Field(
        500,
        ge=1,
        le=1_000_000,
        description="captures of a camera that one job detects in or observes; a camera with more is divided among jobs",
    )
    render: Render = Field(default_factory=Render, description="how Blender renders")
    aggregate: Aggregate = Field(default_factory=Aggregate, description="how detections are counted")
    diagnose: Diagnose = Field(default_factory=Diagnose, description="how the missing effect is searched")
    explore: Explore = Field(default_factory=Explore, description="the page to explore, report/explore.html")
    id_study: IdStudy = Field(default_factory=IdStudy, description="which ids of a family are safe")
    poses_study: PosesStudy = Field(default_factory=PosesStudy, description="where the pose of a marker can be trusted")
    blind_trials: BlindTrials = Field(default_factory=BlindTrials, description="how the search itself is put to trial")


def check_config(data):
    """Return the configuration (dict) with defaults filled in; an experiment takes the campaign's place.

    Raises InputError naming key, value and what is allowed.
    """
    try:
        config = Config.model_validate(data)
    except ValidationError as error:
        raise InputError(validation_message("configuration", error, Config)) from None
    if config.experiment:
        config.campaign = None
    elif not config.campaign:
        raise InputError("configuration: neither campaign nor experiment names a folder or file")
    study = config.poses_study
    if not study.nearest_m < study.farthest_m:
        raise InputError(
            f"configuration: poses_study.nearest_m: {study.nearest_m:g} is not below poses_study.farthest_m, {study.farthest_m:g}"
        )
    check_choice("aggregate.reference_detector", [config.aggregate.reference_detector], config.detectors)
    return config.model_dump()


def check_choice(key, chosen, allowed):
    """Raise InputError for the first chosen name that is not allowed."""
    for name in chosen:
        if name not in allowed:
            raise InputError(f"configuration: {key}: {name!r} does not exist; allowed are {', '.join(allowed)}")
