"""OpenCV's YAML, spelt as its calibration sample does: camera_matrix, distortion_coefficients."""

from calibrations import _opencv_yaml
from calibrations._opencv_yaml import HOLDS, KEYS, is_one, read

TITLE, SUFFIX = "OpenCV YAML (camera_matrix)", ".yaml"
__all__ = ["HOLDS", "SUFFIX", "TITLE", "is_one", "read", "write"]


def write(name, calibration):
    """Return the text of a file."""
    return _opencv_yaml.written(name, calibration, {what: keys[0] for what, keys in KEYS.items()})
