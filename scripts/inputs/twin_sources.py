"""What is known of a camera's twin: its nominal pinhole, its effects, and where these are from."""

import json
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from effects import library, pipeline
from effects.base import View
from inputs.campaign import read_description
from inputs.twins import load_twin
from rig.errors import InputError
from rig.geometry import camera_matrix


@dataclass(frozen=True)
class CameraTwin:
    """A camera and its effects [(name, {parameter: value})], in physical order; ``source`` says where they are from."""

    campaign: str
    camera: str
    K: np.ndarray
    width: int
    height: int
    exposure: float
    encoding: str
    noise_dn: float
    effects: list
    source: str

    def view(self, margin=0):
        """Return the effects.base.View of a camera that looks down from 1 m."""
        pose = np.eye(4)
        pose[2, 3] = 1.0
        return View(
            self.K, self.width, self.height, margin, pose, self.camera, "export", "export",
            self.exposure, self.encoding, self.noise_dn,
        )  # fmt: skip


def camera_twin(campaign, folder, camera, verdict=None):
    """Return the CameraTwin of a campaign's camera: config/twins/..., or the verdict where there is no such file.

    campaign, folder  name, and folder with campaign.yaml
    verdict           diagnosis (dict) whose effects are taken, whatever the file says; None: the file's
    Raises InputError where the campaign has no such camera, or its pinhole is not known yet.
    """
    described = read_description(folder)
    if camera not in described.cameras:
        raise InputError(f"{folder}/campaign.yaml: no camera {camera!r}; there are {', '.join(described.cameras)}")
    nominal = described.cameras[camera]
    path = Path(f"config/twins/{campaign}/{camera}.yaml")
    effects = load_twin(path).effects if verdict is None else effects_of(verdict)
    source = str(path) if verdict is None else f"verdict {verdict['verdict']!r} of {campaign}/{camera}"
    return CameraTwin(
        campaign, camera, _matrix(campaign, camera, nominal), nominal.width, nominal.height, described.assumed("exposure"),
        described.encoding, described.noise_dn, effects, source,
    )  # fmt: skip


def effects_of(diagnosis):
    """Return the effects [(name, {parameter: value})] after a diagnosis's last step, of a board's photographs the whole lens."""
    chosen = {e["effect"]: dict(e["parameters"]) for e in diagnosis.get("configured") or []}
    for found in (*diagnosis["steps"], *diagnosis.get("whole_lens", {}).get("effects", [])):
        chosen[found["effect"]] = {k: v["value"] for k, v in found["parameters"].items()}
    known = library.available_effects()
    for name, parameters in chosen.items():
        if name not in known or set(parameters) - set(known[name].PARAMETERS):
            raise InputError(f"the diagnosis names {name!r} {sorted(parameters)}, which this version does not have")
    return pipeline.in_order(list(chosen.items()))


def _matrix(campaign, camera, nominal):
    """Return the 3 x 3 matrix of the ideal twin: nominal, or as registered where nothing nominal is known."""
    keys = ("fx", "fy", "cx", "cy")
    if nominal.fx is not None:
        return camera_matrix(*(getattr(nominal, k) for k in keys))
    path = Path(f"results/{campaign}/register/{camera}.json")
    if not path.is_file():
        raise InputError(f"{path}: no such file, and campaign.yaml has no fx; run `snakemake --cores 2 diagnose` first")
    registered = json.loads(path.read_text())
    return camera_matrix(*(registered[k] for k in keys))
