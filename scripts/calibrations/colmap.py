"""COLMAP's cameras.txt. The top-left pixel's corner is (0, 0) there, its centre (0.5, 0.5).

Source: COLMAP's "Output format" and its models' header; FULL_OPENCV is k1 k2 p1 p2 k3 k4 k5 k6.
"""

import re

from calibrations.lens import Calibration
from rig.errors import InputError

TITLE, SUFFIX = "COLMAP cameras.txt", ".txt"
HOLDS = (("opencv", 0), ("opencv", 4), ("opencv", 8), ("fisheye", 4))
HALF_A_PIXEL = 0.5
MODELS = {  # focal lengths, lens model, number of parameters that follow the centre, of coefficients they become
    "SIMPLE_PINHOLE": (1, "opencv", 0, 0),
    "PINHOLE": (2, "opencv", 0, 0),
    "SIMPLE_RADIAL": (1, "opencv", 1, 4),
    "RADIAL": (1, "opencv", 2, 4),
    "OPENCV": (2, "opencv", 4, 4),
    "FULL_OPENCV": (2, "opencv", 8, 8),
    "SIMPLE_RADIAL_FISHEYE": (1, "fisheye", 1, 4),
    "RADIAL_FISHEYE": (1, "fisheye", 2, 4),
    "OPENCV_FISHEYE": (2, "fisheye", 4, 4),
}
WRITTEN = ("PINHOLE", "OPENCV", "FULL_OPENCV", "OPENCV_FISHEYE")


def is_one(text):
    """Return whether a text's first line that says something is a camera."""
    lines = (line for line in text.splitlines() if line.strip() and not line.startswith("#"))
    return re.match(r"\d+ +[A-Z_]+ +\d+ +\d+ ", next(lines, "")) is not None


def read(text, where):
    """Return {id: Calibration} of a file."""
    cameras = {}
    for number, line in enumerate(text.splitlines(), start=1):
        if not line.strip() or line.startswith("#"):
            continue
        name, model, width, height, *values = [*line.split(), *[""] * 4]
        here = f"{where}, line {number}"
        if model not in MODELS:
            raise InputError(f"{here}: model {model[:40]!r}; read are {', '.join(MODELS)}")
        focals, lens, given, count = MODELS[model]
        values = [v for v in values if v]
        if len(values) != focals + 2 + given:
            raise InputError(f"{here}: {len(values)} parameters; {model} has {focals + 2 + given}")
        try:
            size, values = (int(width), int(height)), [float(v) for v in values]
        except ValueError as error:
            raise InputError(f"{here}: {error}") from None
        fx, fy, (cx, cy) = values[0], values[focals - 1], values[focals : focals + 2]
        coefficients = (*values[focals + 2 :], *[0.0] * (count - given))
        cameras[name] = Calibration(*size, fx, fy, cx - HALF_A_PIXEL, cy - HALF_A_PIXEL, lens, coefficients)
    return cameras


def write(name, calibration):
    """Return the text of a file with one camera, 1."""
    c = calibration
    model = next(m for m in WRITTEN if MODELS[m][1::2] == (c.lens, len(c.coefficients)))
    values = (c.fx, c.fy, c.cx + HALF_A_PIXEL, c.cy + HALF_A_PIXEL, *c.coefficients)
    return (
        f"# {name}\n# CAMERA_ID, MODEL, WIDTH, HEIGHT, PARAMS[]\n"
        f"1 {model} {c.width} {c.height} {' '.join(map(repr, map(float, values)))}\n"
    )
