"""What both spellings of OpenCV's YAML share. Source: samples/cpp/tutorial_code/calib3d/camera_calibration."""

import re

from calibrations.lens import Calibration, entry, numbers
from inputs.safe_yaml import plain_data
from rig.errors import InputError

KEYS = {  # what is read: spellings of the sample programs, old and new, and of what people write by hand
    "width": ("image_width", "image_Width", "imageWidth", "width"),
    "height": ("image_height", "image_Height", "imageHeight", "height"),
    "matrix": ("camera_matrix", "cameraMatrix", "Camera_Matrix"),
    "distortion": (
        "distortion_coefficients", "Distortion_Coefficients", "distCoeffs", "dist_coeffs", "distortionCoefficients"
    ),
    "fisheye": ("fisheye_model", "fisheyeModel"),
}  # fmt: skip
HOLDS = (*(("opencv", count) for count in (0, 4, 5, 8, 12, 14)), ("fisheye", 4))
MATRIX = """\
{key}: !!opencv-matrix
   rows: {rows}
   cols: {columns}
   dt: d
   data: [ {data} ]
"""


def is_one(text):
    """Return whether a text has a camera matrix as OpenCV writes one."""
    return "opencv-matrix" in text and any(re.search(rf"\b{key}\b", text) for key in KEYS["matrix"])


def read(text, where):
    """Return {name: Calibration} of a FileStorage file, YAML or JSON."""
    plain = re.sub(r"\A%YAML[^\n]*\n", "", text).replace("!!opencv-matrix", "")
    data = plain_data(plain, where)
    known = {name: next((k for k in keys if k in data), keys[0]) for name, keys in KEYS.items()}
    width, height = (entry(where, data, known[k], int | float) for k in ("width", "height"))
    fx, skew, cx, _, fy, cy, *_ = _matrix(where, data, known["matrix"], 9)
    if skew:
        raise InputError(f"{where}: {known['matrix']} has a skew of {skew:g}; only cameras without are read")
    coefficients = _matrix(where, data, known["distortion"]) if known["distortion"] in data else ()
    lens = "fisheye" if data.get(known["fisheye"]) else "opencv"
    return {"camera": Calibration(_whole(width), _whole(height), fx, fy, cx, cy, lens, coefficients)}


def _whole(value):
    return int(value) if isinstance(value, float) and value.is_integer() else value


def _matrix(where, data, key, count=None):
    return numbers(f"{where}: {key}", entry(where, entry(where, data, key, dict), "data"), count)


def written(name, calibration, spelling):
    """Return the text of a file with the keys in ``spelling``: a dict like KEYS with one key each."""
    c = calibration

    def matrix(key, rows, columns, values):
        data = ", ".join(map(repr, values))
        return MATRIX.format(key=key, rows=rows, columns=columns, data=data)

    K = [c.fx, 0.0, c.cx, 0.0, c.fy, c.cy, 0.0, 0.0, 1.0]
    coefficients = list(c.coefficients) or [0.0] * 5
    return (
        f"%YAML:1.0\n---\n# {name}\n{spelling['width']}: {c.width}\n{spelling['height']}: {c.height}\n"
        f"{spelling['fisheye']}: {int(c.lens == 'fisheye')}\n"
        + matrix(spelling["matrix"], 3, 3, map(float, K))
        + matrix(spelling["distortion"], len(coefficients), 1, map(float, coefficients))
    )
