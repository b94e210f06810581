"""A moving experiment: one rig, one camera on trajectories, how frames are exposed, an object that passes.

Its files lie in config/moving; docs/moving.md says what is made of them.
"""

from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Literal

import numpy as np
import pandas as pd
from pydantic import Field, ValidationError, model_validator

from inputs.campaign import NAME, Reflectance, Strict, inside, is_name
from inputs.experiment import CameraSheet, rig_markers
from inputs.safe_yaml import load_yaml, validation_message
from rig.errors import InputError
from rig.geometry import camera_matrix

Place = Annotated[list[Annotated[float, Field(ge=-100, le=100)]], Field(min_length=3, max_length=3)]


class Occluder(Strict):
    """A striped upright box that crosses the view along x, between camera and plates."""

    start_x_m: float = Field(ge=-100, le=100, description="x of its middle at the first frame, m")
    y_m: float = Field(ge=-100, le=100, description="y of its middle, m")
    speed_m_s: float = Field(ge=-100, le=100, description="speed along x, m/s")
    width_m: float = Field(gt=0, le=10, description="extent along x, m")
    height_m: float = Field(1.5, gt=0, le=10, description="extent upwards from the ground, m")
    thickness_m: float = Field(0.02, gt=0, le=1, description="extent along y, m")


class Motion(Strict):
    """What all trajectories share."""

    camera_m: Place = Field(description="x, y, z of the optical centre that the motion starts from or is about, m")
    look_at_m: Place = Field(description="x, y, z of the point on the optical axis there, m")
    occluder: Occluder | None = Field(None, description="what passes between camera and plates")

    @model_validator(mode="after")
    def looks_somewhere(self):
        """The direction of sight must exist, and a level camera too."""
        if np.hypot(self.look_at_m[0] - self.camera_m[0], self.look_at_m[1] - self.camera_m[1]) < 1e-6:
            raise ValueError("look_at_m lies at, straight above or straight below camera_m")
        return self


class AtRest(Motion):
    """The camera stands still: what changes from frame to frame is noise."""

    kind: Literal["at_rest"]


class HandHeldSway(Motion):
    """Hands that try to keep still: random, smooth, about one place."""

    kind: Literal["hand_held_sway"]
    sway_m: float = Field(0.008, ge=0, le=1, description="standard deviation of the place along each axis, m")
    turn_deg: float = Field(0.8, ge=0, le=20, description="standard deviation of the turn about each axis, degrees")
    fastest_hz: float = Field(2.0, gt=0, le=20, description="highest frequency of the motion, Hz")


class Pan(Motion):
    """One even sweep to the side over the whole sequence; at its middle the camera looks at look_at_m."""

    kind: Literal["pan"]
    pan_deg: float = Field(ge=-180, le=180, description="how far the camera turns, degrees; positive to the left")


class HeadTurn(Motion):
    """A quick turn of the head to the side, a stay, and back; the eyes lie before the axis of the neck."""

    kind: Literal["head_turn"]
    turn_deg: float = Field(ge=-120, le=120, description="how far the head turns, degrees; positive to the left")
    turn_s: float = Field(0.4, ge=0.05, le=10, description="how long one turn takes, s")
    start_s: float = Field(0.3, ge=0, le=100, description="when it starts to turn, s")
    stay_s: float = Field(0.3, ge=0, le=100, description="how long it stays turned, s")
    neck_m: float = Field(0.1, ge=0, le=1, description="distance from the neck's axis to the optical centre, m")


class Approach(Motion):
    """The camera goes towards look_at_m over the whole sequence."""

    kind: Literal["approach"]
    way_m: float = Field(ge=-100, le=100, description="how far it goes, m; negative: it moves away")


Trajectory = Annotated[AtRest | HandHeldSway | Pan | HeadTurn | Approach, Field(discriminator="kind")]


class MovingExperiment(Strict):
    """config/moving/*.yaml"""

    name: str = Field(pattern=NAME, max_length=64, description="names the experiment in seeds")
    seed: str = Field("twingap", max_length=64, description="enters every random number, together with names")
    rig: str = Field(description="file below config/rigs")
    camera: CameraSheet = Field(description="the camera by its data sheet")
    frames: int = Field(60, ge=2, le=100_000, description="frames of each trajectory")
    fps: float = Field(30.0, gt=0, le=10_000, description="frames a second")
    exposure_s: float = Field(gt=0, le=1, description="how long each row is exposed, s")
    readout_s: float = Field(
        ge=0, le=1, description="from the first row's exposure to the end of the last, s; 0: global"
    )
    samples: int = Field(64, ge=1, le=16384, description="samples of a pixel that an edge crosses in the exposure")
    threads: int = Field(1, ge=1, le=256, description="threads of one render job")
    noise_dn: float = Field(1.0, ge=0, le=100, description="temporal noise, grey levels")
    budget_ms: float = Field(15.0, gt=0, le=1000, description="time a frame may take where a detector keeps a budget")
    reflectance: Reflectance = Field(default_factory=Reflectance, description="linear reflectances")
    detectors: dict[str, dict] = Field(min_length=1, description="detectors that run, each with its parameters")
    trajectories: dict[str, Trajectory] = Field(min_length=1, max_length=100, description="name: motion")

    @model_validator(mode="after")
    def frames_follow_each_other(self):
        """Names become files; a sensor reads one frame before it starts on the next."""
        for name in self.trajectories:
            if not is_name(name, 64):
                raise ValueError(f"trajectory {name!r}: letters, digits, - and _ only, at most 64")
        if self.exposure_s + self.readout_s > 1 / self.fps:
            raise ValueError(
                f"exposure_s {self.exposure_s:g} and readout_s {self.readout_s:g} together last longer than "
                f"a frame at fps {self.fps:g}, {1 / self.fps:.4g} s"
            )
        return self


@dataclass(frozen=True)
class Moving:
    """A checked moving experiment: its file, markers (rows of the markers' table) and intrinsics K (3 x 3, pixels)."""

    file: MovingExperiment
    markers: pd.DataFrame
    K: np.ndarray

    @property
    def times_s(self):
        """Return the times (frames,) at which the middle row of each frame is half exposed."""
        return np.arange(self.file.frames) / self.file.fps

    @property
    def shape(self):
        """Return (rows, columns) of a frame."""
        return self.file.camera.height, self.file.camera.width


def load_moving(path):
    """Return the Moving of a file; its rig lies in the folder ``rigs`` beside the file's own folder.

    Raises InputError naming file, key and value. Whether its detectors exist is not asked here.
    """
    path = Path(path)
    try:
        file = MovingExperiment.model_validate(load_yaml(path))
    except ValidationError as error:
        raise InputError(validation_message(path, error, MovingExperiment)) from None
    markers = rig_markers(rig_path(path, file))
    c = file.camera.nominal()
    return Moving(file, markers, camera_matrix(c.fx, c.fy, c.cx, c.cy))


def rig_path(path, file):
    """Return the path of an experiment's rig."""
    return inside(Path(path).parent.parent / "rigs", file.rig, f"{path}: rig")
