"""OpenCV's YAML, spelt as its functions' arguments are: cameraMatrix, distCoeffs."""

from calibrations import _opencv_yaml
from calibrations._opencv_yaml import HOLDS, is_one, read

TITLE, SUFFIX = "OpenCV YAML (cameraMatrix)", ".yaml"
SPELLING = {
    "width": "imageWidth", "height": "imageHeight", "matrix": "cameraMatrix", "distortion": "distCoeffs",
    "fisheye": "fisheyeModel",
}  # fmt: skip
__all__ = ["HOLDS", "SUFFIX", "TITLE", "is_one", "read", "write"]


def write(name, calibration):
    """Return the text of a file."""
    return _opencv_yaml.written(name, calibration, SPELLING)
