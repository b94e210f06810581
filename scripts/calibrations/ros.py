"""ROS camera_info YAML, as camera_calibration writes and camera_info_manager reads it.

Source: sensor_msgs/CameraInfo: plumb_bob (k1 k2 t1 t2 k3), rational_polynomial (8), equidistant (k1 to k4).
"""

import re

from calibrations.lens import Calibration, entry, numbers
from inputs.safe_yaml import plain_data
from rig.errors import InputError

TITLE, SUFFIX = "ROS camera_info", ".yaml"
HOLDS = (("opencv", 5), ("opencv", 8), ("fisheye", 4))
MODELS = {"plumb_bob": "opencv", "rational_polynomial": "opencv", "equidistant": "fisheye", "fisheye": "fisheye"}


def is_one(text):
    """Return whether a text has the keys of a camera_info file."""
    return bool(re.search(r"^\s*distortion_model\s*:", text, re.M) and re.search(r"^\s*camera_matrix\s*:", text, re.M))


def read(text, where):
    """Return {name: Calibration} of a file."""
    data = plain_data(text, where)
    model = entry(where, data, "distortion_model", str)
    if model not in MODELS:
        raise InputError(f"{where}: distortion_model is {model[:40]!r}; read are {', '.join(MODELS)}")
    matrix = entry(where, entry(where, data, "camera_matrix", dict), "data")
    fx, skew, cx, _, fy, cy, *_ = numbers(f"{where}: camera_matrix", matrix, 9)
    if fx == 0:
        raise InputError(f"{where}: camera_matrix begins with 0, which says that the camera is not calibrated")
    if skew:
        raise InputError(f"{where}: camera_matrix has a skew of {skew:g}; only cameras without are read")
    distortion = entry(where, entry(where, data, "distortion_coefficients", dict), "data")
    width, height = (entry(where, data, key, int) for key in ("image_width", "image_height"))
    coefficients = numbers(f"{where}: distortion_coefficients", distortion)
    name = str(data.get("camera_name", "camera"))
    return {name: Calibration(width, height, fx, fy, cx, cy, MODELS[model], coefficients)}


def write(name, calibration):
    """Return the text of a file; rectification is the identity, projection the camera matrix."""
    c = calibration
    model = "equidistant" if c.lens == "fisheye" else "plumb_bob" if len(c.coefficients) == 5 else "rational_polynomial"
    K = [c.fx, 0.0, c.cx, 0.0, c.fy, c.cy, 0.0, 0.0, 1.0]
    P = [c.fx, 0.0, c.cx, 0.0, 0.0, c.fy, c.cy, 0.0, 0.0, 0.0, 1.0, 0.0]
    identity = [1.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 1.0]

    def matrix(key, rows, columns, values):
        return f"{key}:\n  rows: {rows}\n  cols: {columns}\n  data: [{', '.join(map(repr, map(float, values)))}]\n"

    return (
        f"image_width: {c.width}\nimage_height: {c.height}\ncamera_name: {name}\n"
        + matrix("camera_matrix", 3, 3, K)
        + f"distortion_model: {model}\n"
        + matrix("distortion_coefficients", 1, len(c.coefficients), c.coefficients)
        + matrix("rectification_matrix", 3, 3, identity)
        + matrix("projection_matrix", 3, 4, P)
    )
