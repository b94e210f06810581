"""Kalibr's camchain YAML: pinhole-radtan (k1 k2 r1 r2: no k3) and pinhole-equi. Source: Kalibr's wiki, "Yaml formats"."""

import re

from calibrations.lens import Calibration, entry, numbers
from inputs.safe_yaml import plain_data
from rig.errors import InputError

TITLE, SUFFIX = "Kalibr camchain", ".yaml"
HOLDS = (("opencv", 0), ("opencv", 4), ("fisheye", 4))
MODELS = {"none": ("opencv", 0), "radtan": ("opencv", 4), "equidistant": ("fisheye", 4)}


def is_one(text):
    """Return whether a text describes cameras cam0, cam1 and so on."""
    return bool(re.search(r"^cam\d+\s*:", text, re.M) and "camera_model" in text)


def read(text, where):
    """Return {cam0: Calibration, ...} of a file."""
    data = plain_data(text, where)
    return {name: _camera(f"{where}: {name}", data[name]) for name in data if re.fullmatch(r"cam\d+", str(name))}


def _camera(where, data):
    kind = entry(where, data, "camera_model", str)
    if kind != "pinhole":
        raise InputError(f"{where}: camera_model is {kind[:40]!r}; only pinhole is read, as no other format has it")
    model = entry(where, data, "distortion_model", str)
    if model not in MODELS:
        raise InputError(f"{where}: distortion_model is {model[:40]!r}; read are {', '.join(MODELS)}")
    lens, count = MODELS[model]
    fx, fy, cx, cy = numbers(f"{where}: intrinsics", entry(where, data, "intrinsics"), 4)
    coefficients = numbers(f"{where}: distortion_coeffs", data.get("distortion_coeffs") or [], count)
    size = entry(where, data, "resolution")
    numbers(f"{where}: resolution", size, 2)
    return Calibration(*size, fx, fy, cx, cy, lens, coefficients)


def write(name, calibration):
    """Return the text of a chain of one camera, cam0."""
    c = calibration
    model = next(m for m, known in MODELS.items() if known == (c.lens, len(c.coefficients)))
    return (
        f"# {name}\ncam0:\n  camera_model: pinhole\n"
        f"  intrinsics: [{', '.join(map(repr, map(float, (c.fx, c.fy, c.cx, c.cy))))}]\n"
        f"  distortion_model: {model}\n"
        f"  distortion_coeffs: [{', '.join(map(repr, map(float, c.coefficients)))}]\n"
        f"  resolution: [{c.width}, {c.height}]\n"
    )
