"""A designed experiment: cameras by their data sheets, a rig by rule, stations by heights and tilts or distances.

Rendered and detected like a campaign, without photographs: what a rig would see before it is built.
"""

import itertools
import math
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Literal

import numpy as np
import pandas as pd
from pydantic import Field, ValidationError, model_validator

from inputs.campaign import (
    LARGEST_PX,
    NAME,
    POSE,
    ROUNDED,
    NominalCamera,
    Reflectance,
    Strict,
    inside,
    is_name,
)
from inputs.safe_yaml import load_yaml, validation_message
from markers.contract import count_of, least_plate
from rig.errors import InputError
from rig.geometry import place_name, split_pose, station_pose

FOV_AGREES = 0.02  # stated field of view and focal length may differ by this share


class CameraSheet(Strict):
    """A camera by its data sheet. fx, fy, cx, cy follow from the field of view."""

    width: int = Field(ge=8, le=LARGEST_PX, description="pixels")
    height: int = Field(ge=8, le=LARGEST_PX, description="pixels")
    fov_deg: float = Field(gt=1, lt=170, description="stated field of view, degrees")
    fov_axis: Literal["horizontal", "vertical", "diagonal"] = Field(description="which field of view is stated")
    focal_mm: float | None = Field(None, gt=0, lt=1000, description="focal length; checked with sensor_width_mm")
    sensor_width_mm: float | None = Field(None, gt=0, lt=500, description="width of the sensor's image area")

    @property
    def focal_px(self):
        """Focal length in pixels from the field of view."""
        extent = {
            "horizontal": self.width,
            "vertical": self.height,
            "diagonal": math.hypot(self.width, self.height),
        }[self.fov_axis]
        return extent / 2 / math.tan(math.radians(self.fov_deg) / 2)

    @model_validator(mode="after")
    def agrees(self):
        """Refuse a field of view that disagrees with the focal length and the sensor."""
        if self.focal_mm is not None and self.sensor_width_mm is not None:
            by_sensor = self.focal_mm / self.sensor_width_mm * self.width
            if abs(by_sensor / self.focal_px - 1) > FOV_AGREES:
                allowed = math.degrees(2 * math.atan(self.width / 2 / by_sensor))
                raise ValueError(
                    f"fov_deg {self.fov_deg:g} ({self.fov_axis}) means a focal length of {self.focal_px:.0f} px, but "
                    f"focal_mm {self.focal_mm:g} on sensor_width_mm {self.sensor_width_mm:g} means {by_sensor:.0f} px "
                    f"(horizontally {allowed:.1f} degrees); they may differ by {FOV_AGREES:.0%}"
                )
        return self

    def nominal(self):
        """Return the NominalCamera."""
        f = self.focal_px
        return NominalCamera(
            width=self.width, height=self.height, fx=f, fy=f, cx=(self.width - 1) / 2, cy=(self.height - 1) / 2
        )


def _check_markers(rig, plates):
    """Raise ValueError where a ladder's or board's plates are too small for their markers, or its family has too few ids."""
    if rig.code_m > rig.plate_m:
        raise ValueError(f"code_m {rig.code_m:g} is larger than plate_m {rig.plate_m:g}")
    try:
        known = count_of(rig.dictionary)
    except InputError as error:
        raise ValueError(f"dictionary: {error}") from None
    if rig.first_id + plates > known:
        raise ValueError(f"ids {rig.first_id}..{rig.first_id + plates - 1}; {rig.dictionary} has {known}")
    needed = least_plate(rig.dictionary, rig.first_id)
    if rig.code_m * needed > rig.plate_m * (1 + ROUNDED):
        raise ValueError(
            f"plate_m {rig.plate_m:g} is less than {needed:g} times code_m {rig.code_m:g}, so far {rig.dictionary} reaches"
        )


class PlateRow(Strict):
    """A ladder of plates on the ground along y, alternating between two columns."""

    dictionary: str = Field(description="OpenCV's name of the dictionary")
    first_id: int = Field(0, ge=0, description="ids count up from here")
    plates: int = Field(20, ge=1, le=1000, description="number of plates")
    columns_x_m: Annotated[list[float], Field(min_length=1, max_length=20)] = Field(description="x of the columns, m")
    first_y_m: float = Field(description="y of the first plate, m")
    step_y_m: float = Field(gt=0, description="y from plate to plate, m")
    code_m: float = Field(0.07, gt=0, description="side of the code, m")
    plate_m: float = Field(0.10, gt=0, description="side of the plate, m")

    @model_validator(mode="after")
    def fits(self):
        """The code must fit its plate, the ids their dictionary."""
        _check_markers(self, self.plates)
        return self

    def rows(self):
        """Return the plates' rows of the markers' table."""
        x = self.columns_x_m
        return [
            [self.dictionary, self.first_id + i, self.code_m, self.plate_m, x[i % len(x)],
             self.first_y_m + i * self.step_y_m, 0.0, 0.0, 0.0, 0.0]
            for i in range(self.plates)
        ]  # fmt: skip


class MarkerPanel(Strict):
    """An upright board of markers on a carriage: columns x rows plates facing the camera (towards -y)."""

    dictionary: str = Field(description="OpenCV's name of the dictionary")
    first_id: int = Field(0, ge=0, description="ids count up from here, row by row from the top left")
    columns: int = Field(5, ge=1, le=100, description="plates side by side")
    rows: int = Field(4, ge=1, le=100, description="plates above each other")
    pitch_m: float = Field(0.12, gt=0, description="from plate to plate, m")
    centre_z_m: float = Field(0.3, description="height of the board's centre, m")
    code_m: float = Field(0.07, gt=0, description="side of the code, m")
    plate_m: float = Field(0.10, gt=0, description="side of the plate, m")

    @model_validator(mode="after")
    def fits(self):
        """The code must fit its plate, the plate its pitch."""
        if self.code_m > self.plate_m or self.plate_m > self.pitch_m:
            raise ValueError(
                f"code_m {self.code_m:g} <= plate_m {self.plate_m:g} <= pitch_m {self.pitch_m:g} does not hold"
            )
        _check_markers(self, self.columns * self.rows)
        return self

    def plate_rows(self):
        """Return the plates' rows of the markers' table, the board at y = 0."""
        made = []
        for j in range(self.rows):
            for i in range(self.columns):
                x = (i - (self.columns - 1) / 2) * self.pitch_m
                z = self.centre_z_m + ((self.rows - 1) / 2 - j) * self.pitch_m
                marker = self.first_id + j * self.columns + i
                # turned a quarter about x: the plate's y is up, its z looks towards -y
                made.append([self.dictionary, marker, self.code_m, self.plate_m, x, 0.0, z, math.pi / 2, 0.0, 0.0])
        return made


class Experiment(Strict):
    """config/experiments/*.yaml: stations are all combinations of heights, tilts and distances."""

    name: str = Field(pattern=NAME, max_length=64, description="names the results' folder")
    cameras: dict[str, str] = Field(min_length=1, description="name: file below config/cameras")
    rig: str = Field(description="file below config/rigs")
    heights_m: list[Annotated[float, Field(gt=0, le=100)]] = Field(
        min_length=1, max_length=1000, description="heights of the cameras, m"
    )
    tilts_deg: list[Annotated[float, Field(ge=-90, le=90)]] = Field(
        min_length=1, max_length=1000, description="tilts below the horizontal, degrees"
    )
    distances_m: list[Annotated[float, Field(ge=0, le=100)]] = Field(
        default_factory=lambda: [0.0],
        min_length=1,
        max_length=1000,
        description="how far the rig moves away from the camera, m: a carriage",
    )
    reflectance: Reflectance = Field(default_factory=Reflectance, description="linear reflectances")
    noise_dn: float = Field(1.0, ge=0, le=100, description="temporal noise, grey levels")

    @model_validator(mode="after")
    def names(self):
        """Cameras name files."""
        for camera in self.cameras:
            if not is_name(camera, 64):
                raise ValueError(f"camera {camera!r}: letters, digits, - and _ only, at most 64")
        return self


class RigFile(Strict):
    """config/rigs/*.yaml: ladders on the ground or a board on a carriage."""

    ladders: list[PlateRow] = Field(default_factory=list, description="plates on the ground")
    boards: list[MarkerPanel] = Field(default_factory=list, description="upright boards, moved by distances_m")


@dataclass(frozen=True)
class _Facts:
    name: str
    cameras: dict
    reflectance: Reflectance
    noise_dn: float
    origin: str = "simulated"
    light: str = "even"
    exposure: float = 1.0
    white_balance: str = "neutral"
    left_open: tuple = ()
    encoding: str = "srgb"
    tolerance: None = None
    target: None = None
    markers: str = "markers.csv"

    def assumed(self, key):
        """Return light, exposure, white_balance or reflectance: a design declares all of them."""
        return getattr(self, key)


@dataclass(frozen=True)
class DesignedCampaign:
    """What inputs.campaign.Campaign is for measurements: ``captures`` has one row a station."""

    file: _Facts
    markers: pd.DataFrame
    captures: pd.DataFrame


def _model(kind, path):
    try:
        return kind.model_validate(load_yaml(path))
    except ValidationError as error:
        raise InputError(validation_message(path, error, kind)) from None


def rig_markers(path):
    """Return the markers' table of a rig's file; InputError where it has no plate or one id twice."""
    rig = _model(RigFile, path)
    rows = [row for ladder in rig.ladders for row in ladder.rows()]
    rows += [row for board in rig.boards for row in board.plate_rows()]
    markers = pd.DataFrame(rows, columns=["dictionary", "id", "code_m", "plate_m", "x", "y", "z", "rx", "ry", "rz"])
    doubled = markers[markers.duplicated(["dictionary", "id"])]
    if len(doubled):
        raise InputError(f"{path}: {doubled.iloc[0].dictionary} {doubled.iloc[0].id} stands twice")
    if not len(markers):
        raise InputError(f"{path}: no plates; give ladders, boards or both")
    return markers


def load_experiment(path):
    """Return the DesignedCampaign of an experiment's file; camera and rig files lie beside its folder."""
    path = Path(path)
    experiment = _model(Experiment, path)
    config = path.parent.parent
    cameras = {
        name: _model(CameraSheet, inside(config / "cameras", file, f"{path}: cameras.{name}")).nominal()
        for name, file in experiment.cameras.items()
    }
    markers = rig_markers(inside(config / "rigs", experiment.rig, f"{path}: rig"))
    facts = _Facts(experiment.name, cameras, experiment.reflectance, experiment.noise_dn)
    return DesignedCampaign(facts, markers, _stations(experiment))


def _stations(experiment):
    """Return one row a camera and station: all combinations of distances, heights and tilts."""
    places = itertools.product(experiment.cameras, experiment.distances_m, experiment.heights_m, experiment.tilts_deg)
    return pd.DataFrame([_station(*place) for place in places]).drop_duplicates("capture")


def _station(camera, distance_m, height_m, tilt_deg):
    """Return a row of the captures' table; a rig that moved away is a camera that stepped back."""
    row = {"camera": camera, "trial": 0, "image": "", "sequence": "", "frame": None, "t_s": math.nan}
    row |= dict.fromkeys(POSE, math.nan)
    name = place_name(height_m, tilt_deg)
    if not distance_m:
        return row | {"capture": f"{camera}_{name}", "height_m": height_m, "tilt_deg": tilt_deg}
    step_back = np.eye(4)
    step_back[1, 3] = distance_m
    rvec, tvec = split_pose(station_pose(height_m, tilt_deg) @ step_back)
    row |= dict(zip(POSE, [*rvec, *tvec], strict=True)) | {"height_m": math.nan, "tilt_deg": math.nan}
    return row | {"capture": f"{camera}_{name}_d{1000 * distance_m:04.10g}".replace(".", "p")}
