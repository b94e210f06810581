"""A campaign folder: the models of campaign.yaml and board.yaml, the two tables, every row checked.

Campaigns come from strangers: nothing outside their folder is read, and the first departure from
docs/campaign-format.md is said in one message that names file, row, column and value.
"""

import csv
import math
import re
from dataclasses import dataclass
from pathlib import Path
from typing import Literal

import pandas as pd
from pydantic import BaseModel, ConfigDict, Field, ValidationError, field_validator, model_validator

from rig.errors import InputError
from rig.plates import aruco_dictionary
from rig.safe_yaml import load_yaml, validation_message

NAME = r"^[A-Za-z0-9_-]+$"
NUMBER = r"[+-]?(\d+\.?\d*|\.\d+)([eE][+-]?\d+)?"
LARGEST_PX = 20_000
LARGEST_ROWS = 200_000
LARGEST_TABLE_BYTES = 64_000_000
TOLERANCE_WORDS = {"exact": {"position_m": 0.0, "angle_deg": 0.0}, "unknown": None}
POSE = ("rx", "ry", "rz", "tx", "ty", "tz")


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

    @model_validator(mode="after")
    def all_or_none(self):
        """Intrinsics are known or unknown together."""
        known = [v is not None for v in (self.fx, self.fy, self.cx, self.cy)]
        if any(known) and not all(known):
            raise ValueError("give fx, fy, cx and cy together, or all four null")
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


class Board(Strict):
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
    target: Board | None = None
    captures: str
    cameras: dict[str, NominalCamera] = Field(min_length=1)
    reflectance: Reflectance = Reflectance()
    exposure: float = Field(default=1.0, gt=0, le=100)
    encoding: Literal["srgb", "linear"] = "srgb"
    noise_dn: float = Field(default=0.0, ge=0, le=100)
    tolerance: Tolerance | None = None

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


@dataclass(frozen=True)
class Campaign:
    """A checked campaign: its folder, campaign.yaml, and the tables of markers and captures."""

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
    if not full.resolve().is_relative_to(Path(folder).resolve()):
        raise InputError(f"{where} is {relative!r}: it leaves the campaign's folder")
    return full


def read_rows(path, required, optional=()):
    """Return a CSV's rows as dicts of text; raise InputError for missing, unknown or doubled columns, ragged rows."""
    if not path.is_file():
        raise InputError(f"{path}: no such file")
    if path.stat().st_size > LARGEST_TABLE_BYTES:
        raise InputError(f"{path}: {path.stat().st_size} bytes; at most {LARGEST_TABLE_BYTES} are read")
    try:
        with open(path, newline="", encoding="utf-8-sig") as file:
            reader = csv.reader(file, strict=True)
            header = next(reader, [])
            for name in required:
                if name not in header:
                    raise InputError(f"{path}, row 1: column {name!r} is missing")
            for name in header:
                if name not in (*required, *optional):
                    raise InputError(
                        f"{path}, row 1: unknown column {name!r}; known: {', '.join((*required, *optional))}"
                    )
                if header.count(name) > 1:
                    raise InputError(f"{path}, row 1: column {name!r} stands twice")
            rows = []
            for number, row in enumerate(reader, start=2):
                if not row:
                    continue
                if len(row) != len(header):
                    raise InputError(f"{path}, row {number}: {len(row)} values for {len(header)} columns")
                if len(rows) >= LARGEST_ROWS:
                    raise InputError(f"{path}: more than {LARGEST_ROWS} rows")
                rows.append(dict(zip(header, row, strict=True)) | {"row": number})
    except (UnicodeDecodeError, csv.Error) as error:
        raise InputError(f"{path}: not a CSV table in UTF-8 ({error})") from None
    return rows


def number(path, row, column, low=-math.inf, high=math.inf, whole=False):
    """Return a row's number within [low, high]; raise InputError naming file, row, column and value."""
    text = row.get(column, "").strip()
    good = re.fullmatch(r"[+-]?\d{1,18}" if whole else NUMBER, text, re.ASCII) is not None
    if good:
        value = int(text) if whole else float(text)
        good = math.isfinite(value) and low <= value <= high
    if not good:
        kind = "a whole number" if whole else "a number"
        limits = "" if (low, high) == (-math.inf, math.inf) else f" from {low:g} to {high:g}"
        raise InputError(f"{path}, row {row['row']}, column {column}: {text!r} is not {kind}{limits}")
    return value


def read_markers(path):
    """Return the checked table of markers."""
    metres = ("x", "y", "z")
    columns = ("dictionary", "id", "code_m", "plate_m", *metres, "rx", "ry", "rz")
    made, seen = [], {}
    for row in read_rows(path, columns):
        dictionary = row["dictionary"].strip()
        try:
            last_id = len(aruco_dictionary(dictionary).bytesList) - 1
        except ValueError:
            raise InputError(
                f"{path}, row {row['row']}, column dictionary: {dictionary!r} is no dictionary of OpenCV's"
            ) from None
        values = {"dictionary": dictionary, "id": number(path, row, "id", 0, last_id, whole=True)}
        values |= {k: number(path, row, k, 1e-4, 10) for k in ("code_m", "plate_m")}
        values |= {k: number(path, row, k, -1000, 1000) for k in metres}
        values |= {k: number(path, row, k, -10, 10) for k in ("rx", "ry", "rz")}
        if values["code_m"] > values["plate_m"]:
            raise InputError(
                f"{path}, row {row['row']}, column code_m: {row['code_m']} is larger than plate_m {row['plate_m']}"
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


def place_name(height_m, tilt_deg):
    """Return the name of a station: millimetres and degrees, as in ``h0300_t22p5``."""
    return f"h{1000 * height_m:04.10g}_t{tilt_deg:.10g}".replace("-", "m").replace("+", "").replace(".", "p")


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


def load_campaign(folder):
    """Return the Campaign in a folder; raises InputError at the first departure from the format."""
    folder = Path(folder)
    if re.search(r"[{}\n\r]", str(folder)):
        raise InputError(f"{str(folder)!r}: braces and line ends are not allowed in a campaign's path")
    if not folder.is_dir():
        raise InputError(f"{folder}: no such campaign folder{_dvc_hint(folder)}")
    path = inside(folder, "campaign.yaml", f"{folder}: campaign.yaml")
    described = load_yaml(path)
    try:
        file = CampaignFile.model_validate(described)
    except ValidationError as error:
        raise InputError(validation_message(path, error, CampaignFile)) from None
    captures = read_captures(inside(folder, file.captures, f"{path}: captures"), folder, file.cameras)
    check_tolerance(path, described.get("tolerance"), captures)
    markers = pd.DataFrame(columns=["dictionary", "id", "code_m", "plate_m", "x", "y", "z", "rx", "ry", "rz"])
    if file.markers:
        markers = read_markers(inside(folder, file.markers, f"{path}: markers"))
    return Campaign(folder, file, markers, captures)
