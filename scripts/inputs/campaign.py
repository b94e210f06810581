"""A campaign folder: the models of campaign.yaml and board.yaml, the two tables, every row checked.

Campaigns are untrusted input: nothing outside their folder is read, and the first departure from
docs/campaign-format.md is said in one message that names file, row, column and value.
"""

import math
import re
from dataclasses import dataclass
from pathlib import Path
from typing import Literal

import pandas as pd
from pydantic import BaseModel, ConfigDict, Field, ValidationError, field_validator, model_validator

from calibrations.formats import read_calibration
from inputs.rows import number, read_rows
from inputs.safe_yaml import LONGEST_SHOWN, load_yaml, validation_message
from inputs.videos import check_is_no_file
from markers.contract import count_of, least_plate
from rig.board_markers import board_markers
from rig.errors import InputError
from rig.plates import aruco_dictionary

NAME = r"^[A-Za-z0-9_-]+$"
LARGEST_PX = 20_000
ROUNDED = 1e-6  # by which lengths may be off that were rounded when they were written
# What photographs may leave open: the word for it, what the twin then assumes, what else may be written.
OPEN = {
    "light": ("unknown", "even", "the word even"),
    "exposure": ("auto", 1.0, "a number above 0 and up to 100"),
    "white_balance": ("auto", "neutral", "the word neutral"),
    "reflectance": ("unknown", {}, "a mapping of white, black, ground, background"),
}
TOLERANCE_WORDS = {"exact": {"position_m": 0.0, "angle_deg": 0.0}, "unknown": None}
POSE = ("rx", "ry", "rz", "tx", "ty", "tz")
MARKER_ERRORS = ("se_x", "se_y", "se_z", "se_rx", "se_ry", "se_rz")


def is_name(text, longest):
    """Return whether a text may name files and folders."""
    return len(text) <= longest and re.fullmatch(NAME.strip("^$"), text) is not None


class Strict(BaseModel):
    """No unknown keys, no silent conversions, no NaN."""

    model_config = ConfigDict(extra="forbid", allow_inf_nan=False, strict=True)


class NominalCamera(Strict):
    """The nominal pinhole, pixels; the four null where nothing is known."""

    width: int = Field(ge=8, le=LARGEST_PX)
    height: int = Field(ge=8, le=LARGEST_PX)
    fx: float | None = Field(default=None, gt=0)
    fy: float | None = Field(default=None, gt=0)
    cx: float | None = None
    cy: float | None = None
    intrinsics: str | None = Field(default=None, min_length=1, max_length=1000)

    @model_validator(mode="after")
    def all_or_none(self):
        """Intrinsics are known or unknown together."""
        known = [v is not None for v in (self.fx, self.fy, self.cx, self.cy)]
        if any(known) and not all(known):
            raise ValueError("give fx, fy, cx and cy together, or all four null")
        if any(known) and self.intrinsics is not None:
            raise ValueError("give fx, fy, cx and cy, or the file that has them as intrinsics, not both")
        return self


class Reflectance(Strict):
    """Nominal linear reflectances, 0 to 1; background is the radiance above the horizon."""

    white: float = Field(default=0.8, ge=0, le=1)
    black: float = Field(default=0.05, ge=0, le=1)
    ground: float = Field(default=0.35, ge=0, le=1)
    background: float = Field(default=0.3, ge=0, le=1)

    @model_validator(mode="after")
    def white_is_brighter(self):
        """A print without contrast can't be seen."""
        if self.white <= self.black:
            raise ValueError("white must reflect more than black")
        return self


class Tolerance(Strict):
    """How well a pose is known, one standard deviation per axis."""

    position_m: float = Field(ge=0, le=1)
    angle_deg: float = Field(ge=0, le=45)


class CalibrationBoard(Strict):
    """One calibration board, metres."""

    type: Literal["charuco", "chessboard", "aruco_grid", "apriltag_grid"]
    dictionary: str | None = None
    columns: int = Field(ge=2, le=200)
    rows: int = Field(ge=2, le=200)
    square_m: float | None = Field(default=None, gt=0, le=10)
    marker_m: float | None = Field(default=None, gt=0, le=10)
    gap_m: float | None = Field(default=None, ge=0, le=10)
    legacy_pattern: bool = False

    @model_validator(mode="after")
    def complete(self):
        """Each kind of board needs its own lengths."""
        needs = {
            "charuco": ("dictionary", "square_m", "marker_m"),
            "chessboard": ("square_m",),
            "aruco_grid": ("dictionary", "marker_m", "gap_m"),
            "apriltag_grid": ("dictionary", "marker_m", "gap_m"),
        }[self.type]
        for key in needs:
            if getattr(self, key) is None:
                raise ValueError(f"a {self.type} needs {key}")
        if self.dictionary is not None:
            known = len(aruco_dictionary(self.dictionary).bytesList)
            markers = self.columns * self.rows // (2 if self.type == "charuco" else 1)
            if self.type != "chessboard" and markers > known:
                raise ValueError(f"{self.columns} x {self.rows} needs {markers} markers; {self.dictionary} has {known}")
        if self.type == "charuco" and self.marker_m >= self.square_m:
            raise ValueError("marker_m must be less than square_m")
        return self


class CampaignFile(Strict):
    """campaign.yaml"""

    schema_: Literal[1] = Field(alias="schema")
    name: str = Field(pattern=NAME, max_length=64)
    origin: Literal["camera", "simulated"]
    markers: str | None = None
    target: CalibrationBoard | None = None
    captures: str
    cameras: dict[str, NominalCamera] = Field(min_length=1)
    light: Literal["even"] | None
    exposure: float | None = Field(gt=0, le=100)
    white_balance: Literal["neutral"] | None
    reflectance: Reflectance | None
    encoding: Literal["srgb", "linear"] = "srgb"
    noise_dn: float = Field(default=0.0, ge=0, le=100)
    tolerance: Tolerance | None = None

    @model_validator(mode="before")
    @classmethod
    def open_or_nominal(cls, data):
        """Leave open what is not written of a board's photographs; of other campaigns it is nominal."""
        of_board = isinstance(data, dict) and data.get("target") is not None
        defaults = {key: word if of_board else nominal for key, (word, nominal, _) in OPEN.items()}
        return defaults | data if isinstance(data, dict) else data

    @field_validator(*OPEN, mode="before")
    @classmethod
    def left_open_by_a_word(cls, value, info):
        """Take the word that leaves something open for None."""
        word, nominal, allowed = OPEN[info.field_name]
        if value == word:
            return None
        kinds = (int, float) if isinstance(nominal, float) else (type(nominal),)
        if type(value) not in kinds or (isinstance(value, str) and value != nominal):
            raise ValueError(f"allowed are {allowed}, and {word}")
        return value

    @field_validator("tolerance", mode="before")
    @classmethod
    def words(cls, value):
        """Take ``exact`` for zeros and ``unknown`` for None."""
        if isinstance(value, str) and value not in TOLERANCE_WORDS:
            raise ValueError("a mapping of position_m and angle_deg is allowed, or one of the words exact, unknown")
        return TOLERANCE_WORDS[value] if isinstance(value, str) else value

    @model_validator(mode="after")
    def one_rig(self):
        """A rig is either a table of markers or one board."""
        if (self.markers is None) == (self.target is None):
            raise ValueError("give either markers or target")
        for camera in self.cameras:
            if not is_name(camera, 64):
                raise ValueError(f"camera {camera!r}: letters, digits, - and _ only, at most 64")
        return self

    @property
    def left_open(self):
        """Return the names of what the captures' own light and camera decide: nobody has declared them."""
        return [key for key in OPEN if getattr(self, key) is None]

    def assumed(self, key):
        """Return what the ideal twin takes light, exposure, white_balance or reflectance for, declared or not."""
        value = getattr(self, key)
        nominal = Reflectance() if key == "reflectance" else OPEN[key][1]
        return nominal if value is None else value


@dataclass(frozen=True)
class Campaign:
    """A checked campaign: its folder, campaign.yaml, and the tables of markers (a board's among them) and captures."""

    folder: Path
    file: CampaignFile
    markers: pd.DataFrame
    captures: pd.DataFrame


def inside(folder, relative, where):
    """Return folder / relative, which must stay inside the folder, links followed; ``where`` names the place."""
    path = Path(relative)
    if not relative or path.is_absolute() or ".." in path.parts or "\\" in relative or "\0" in relative:
        raise InputError(f"{where} is {relative!r}: a path relative to the campaign and inside it is needed")
    if re.search(r"[{}\n\r]", relative):
        raise InputError(f"{where} is {relative!r}: braces and line ends are not allowed")
    full = Path(folder) / path
    try:
        full.is_file()
        stays = full.resolve().is_relative_to(Path(folder).resolve())
    except (OSError, RuntimeError, ValueError) as error:  # a name that is too long, links in a circle
        raise InputError(
            f"{where} is {relative[:LONGEST_SHOWN]!r}: {getattr(error, 'strerror', None) or error}"
        ) from None
    if not stays:
        raise InputError(f"{where} is {relative!r}: it leaves the campaign's folder")
    return full


def read_markers(path):
    """Return the checked table of markers; standard errors of places, where they are given, are checked and left there."""
    metres = ("x", "y", "z")
    columns = ("dictionary", "id", "code_m", "plate_m", *metres, "rx", "ry", "rz")
    made, seen = [], {}
    for row in read_rows(path, columns, MARKER_ERRORS):
        for k in MARKER_ERRORS:
            if row.get(k, "").strip():
                number(path, row, k, 0, 1000)
        dictionary = row["dictionary"].strip()
        try:
            last_id = count_of(dictionary) - 1
        except InputError as error:
            raise InputError(f"{path}, row {row['row']}, column dictionary: {error}") from None
        values = {"dictionary": dictionary, "id": number(path, row, "id", 0, last_id, whole=True)}
        values |= {k: number(path, row, k, 1e-4, 10) for k in ("code_m", "plate_m")}
        values |= {k: number(path, row, k, -1000, 1000) for k in metres}
        values |= {k: number(path, row, k, -10, 10) for k in ("rx", "ry", "rz")}
        if values["code_m"] > values["plate_m"]:
            raise InputError(
                f"{path}, row {row['row']}, column code_m: {row['code_m']} is larger than plate_m {row['plate_m']}"
            )
        needed = least_plate(dictionary, values["id"])
        if values["code_m"] * needed > values["plate_m"] * (1 + ROUNDED):
            raise InputError(
                f"{path}, row {row['row']}, column plate_m: {row['plate_m']} is less than {needed:g} times code_m "
                f"{row['code_m']}, so far {dictionary} reaches"
            )
        key = dictionary, values["id"]
        if key in seen:
            raise InputError(
                f"{path}, row {row['row']}, column id: {dictionary} {key[1]} stands in row {seen[key]} too"
            )
        seen[key] = row["row"]
        made.append(values)
    if not made:
        raise InputError(f"{path}: no markers")
    return pd.DataFrame(made, columns=columns)


def read_captures(path, folder, cameras):
    """Return the checked table of captures; height_m and tilt_deg are NaN where a pose or nothing is given."""
    required = ("capture", "camera", "image")
    optional = ("height_m", "tilt_deg", "trial", "sequence", "frame", "t_s", *POSE)
    made, names, images = [], {}, {}
    for row in read_rows(path, required, optional):
        where = f"{path}, row {row['row']}"
        name, camera, image = row["capture"].strip(), row["camera"].strip(), row["image"].strip()
        if not is_name(name, 128):
            raise InputError(f"{where}, column capture: {name!r}: letters, digits, - and _ only, at most 128")
        if name in names:
            raise InputError(f"{where}, column capture: {name!r} stands in row {names[name]} too")
        if camera not in cameras:
            raise InputError(
                f"{where}, column camera: {camera!r} is not in campaign.yaml, which has {', '.join(cameras)}"
            )
        file = inside(folder, image, f"{where}, column image")
        if not file.is_file():
            raise InputError(f"{where}, column image: {image!r}: no such file{_dvc_hint(folder)}")
        if file.resolve() in images:
            raise InputError(f"{where}, column image: {image!r} stands in row {images[file.resolve()]} too")
        names[name], images[file.resolve()] = row["row"], row["row"]
        values = {"capture": name, "camera": camera, "image": image}
        values |= _place(path, row)
        values["trial"] = number(path, row, "trial", 0, 1e6, whole=True) if row.get("trial", "").strip() else 0
        values["sequence"] = row.get("sequence", "").strip()
        values["frame"] = number(path, row, "frame", 0, 1e9, whole=True) if row.get("frame", "").strip() else None
        values["t_s"] = number(path, row, "t_s", -1e9, 1e9) if row.get("t_s", "").strip() else math.nan
        made.append(values)
    if not made:
        raise InputError(f"{path}: no captures")
    return pd.DataFrame(made)


def _dvc_hint(folder):
    """Return what to do where the images of a tracked campaign are missing."""
    dvc_file = Path(f"{folder}.dvc")
    return f"; `dvc pull {dvc_file}` fetches tracked captures" if dvc_file.is_file() else ""


def _place(path, row):
    """Return height, tilt and pose of a capture: a station, a pose in full, or nothing (unknown)."""
    place = dict.fromkeys(("height_m", "tilt_deg", *POSE), math.nan)
    station = [row.get(k, "").strip() != "" for k in ("height_m", "tilt_deg")]
    pose = [row.get(k, "").strip() != "" for k in POSE]
    if any(station) and any(pose):
        raise InputError(f"{path}, row {row['row']}: both a station (height_m, tilt_deg) and a pose (rx..tz)")
    if any(station):
        place["height_m"] = number(path, row, "height_m", -1000, 1000)
        place["tilt_deg"] = number(path, row, "tilt_deg", -180, 180)
    elif any(pose):
        for k in POSE:
            place[k] = number(path, row, k, -1e4, 1e4)
    return place


def check_tolerance(path, tolerance, captures):
    """Raise InputError where captures are at stations and campaign.yaml, at ``path``, does not say how well these are known.

    No default would do: taken for exact, a station that is off would pass for an effect; for unknown, none would be named.
    """
    stations = captures[captures.height_m.notna()]
    if tolerance is None and len(stations):
        raise InputError(
            f"{path}: tolerance is missing, but captures are at stations ({stations.capture.iloc[0]} is the first); write "
            "how well these are known, one standard deviation per axis, as `tolerance: {position_m: 0.002, angle_deg: "
            "0.2}`, or `tolerance: exact`, or `tolerance: unknown`"
        )


def read_description(folder):
    """Return the CampaignFile of a folder's campaign.yaml, intrinsics read where it names a calibration's file."""
    path = inside(folder, "campaign.yaml", f"{folder}: campaign.yaml")
    return _description(folder, path, load_yaml(path))


def _description(folder, path, described):
    try:
        file = CampaignFile.model_validate(described)
    except ValidationError as error:
        raise InputError(validation_message(path, error, CampaignFile)) from None
    read = {name: _with_intrinsics(folder, path, name, camera) for name, camera in file.cameras.items()}
    return file.model_copy(update={"cameras": read})


def _with_intrinsics(folder, path, name, camera):
    """Return the NominalCamera with the pinhole that its calibration file has; distortion there is not the nominal camera's."""
    if camera.intrinsics is None:
        return camera
    where = f"{path}: cameras.{name}.intrinsics"
    file, _, chosen = camera.intrinsics.partition("#")
    found = inside(folder, file, where)
    size = camera.width, camera.height
    calibration = read_calibration(f"{found}#{chosen}" if chosen else found, size)
    if (calibration.width, calibration.height) != size:
        raise InputError(
            f"{where}: {file} is of images of {calibration.width} x {calibration.height} pixels, the camera has "
            f"{size[0]} x {size[1]}"
        )
    return camera.model_copy(update={k: getattr(calibration, k) for k in ("fx", "fy", "cx", "cy")})


def load_campaign(folder):
    """Return the Campaign in a folder; raises InputError at the first departure from the format."""
    folder = Path(folder)
    if re.search(r"[{}\n\r]", str(folder)):
        raise InputError(f"{str(folder)!r}: braces and line ends are not allowed in a campaign's path")
    check_is_no_file(folder)
    if not folder.is_dir():
        raise InputError(f"{folder}: no such campaign folder{_dvc_hint(folder)}")
    path = inside(folder, "campaign.yaml", f"{folder}: campaign.yaml")
    described = load_yaml(path)
    file = _description(folder, path, described)
    captures = read_captures(inside(folder, file.captures, f"{path}: captures"), folder, file.cameras)
    check_tolerance(path, described.get("tolerance"), captures)
    if file.target:
        markers = board_markers(file.target)
    else:
        markers = read_markers(inside(folder, file.markers, f"{path}: markers"))
    return Campaign(folder, file, markers, captures)
