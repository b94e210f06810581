"""A calibrated camera as other programs know it, and where its lens takes rays.

Pixels: the centre of the top-left pixel is (0, 0), as everywhere in the project; formats that count otherwise are
converted where they are read and written.
"""

import math
from dataclasses import dataclass

import cv2
import numpy as np

from rig.errors import InputError

LARGEST_PX = 20_000
COUNTS = {  # numbers of coefficients that a lens model can have
    "opencv": (0, 4, 5, 8, 12, 14),  # k1 k2 p1 p2 [k3 [k4 k5 k6 [s1 s2 s3 s4 [tx ty]]]]
    "fisheye": (4,),  # k1 k2 k3 k4 of the angle (Kannala and Brandt 2006)
    "poly5": (2,),  # lensfun's, which also has the two below
    "poly3": (1,),
    "ptlens": (3,),
}


@dataclass(frozen=True)
class Calibration:
    """A pinhole, pixels, and the lens before it.

    width, height  of the image
    lens           a key of COUNTS
    coefficients   tuple of numbers, in the lens model's order
    focal_mm, crop focal length and crop factor (full frame: 1) where the format has them, else None
    red, blue      magnification of red and blue over green's
    falloff        k1, k2, k3 of the light 1 + k1 r^2 + k2 r^4 + k3 r^6 that is left at r, in half diagonals
    """

    width: int
    height: int
    fx: float
    fy: float
    cx: float
    cy: float
    lens: str = "opencv"
    coefficients: tuple = ()
    focal_mm: float | None = None
    crop: float | None = None
    red: float = 1.0
    blue: float = 1.0
    falloff: tuple = (0.0, 0.0, 0.0)

    @property
    def K(self):
        """The 3 x 3 intrinsic matrix, pixels."""
        return np.array([[self.fx, 0, self.cx], [0, self.fy, self.cy], [0, 0, 1]], float)


def checked(where, calibration):
    """Return a Calibration that was read; raise InputError naming ``where`` for a number that can't be."""
    c = calibration
    for name, value in (("width", c.width), ("height", c.height)):
        if isinstance(value, bool) or not isinstance(value, int) or not 8 <= value <= LARGEST_PX:
            raise InputError(f"{where}: {name} is {value!r}; a whole number of pixels from 8 to {LARGEST_PX} is needed")
    for name, value in (("fx", c.fx), ("fy", c.fy)):
        if not (math.isfinite(value) and 1e-3 < value < 1e7):
            raise InputError(f"{where}: {name} is {value!r}; a focal length in pixels is needed (0: not calibrated)")
    for name, value in (
        ("cx", c.cx),
        ("cy", c.cy),
        *((f"coefficient {n + 1}", v) for n, v in enumerate(c.coefficients)),
    ):
        if not (math.isfinite(value) and abs(value) < 1e7):
            raise InputError(f"{where}: {name} is {value!r}; a number is needed")
    if len(c.coefficients) not in COUNTS[c.lens]:
        allowed = ", ".join(map(str, COUNTS[c.lens]))
        raise InputError(f"{where}: {len(c.coefficients)} coefficients; {c.lens} has {allowed}")
    return c


def numbers(where, values, count=None):
    """Return a list of numbers as a tuple of floats; raise InputError for anything else, or another ``count``."""
    good = isinstance(values, list | tuple) and all(
        isinstance(v, int | float) and not isinstance(v, bool) and abs(v) < 1e300 for v in values
    )
    if not good or (count is not None and len(values) != count):
        raise InputError(
            f"{where}: {'' if count is None else f'{count} '}numbers are needed, found {str(values)[:80]!r}"
        )
    return tuple(map(float, values))


def entry(where, mapping, key, kind=None):
    """Return what a mapping has under a key, of a type; raise InputError where it is missing or another."""
    if not isinstance(mapping, dict) or key not in mapping:
        raise InputError(f"{where}: {key} is missing")
    value = mapping[key]
    if kind is not None and (not isinstance(value, kind) or isinstance(value, bool)):
        raise InputError(f"{where}: {key} is {str(value)[:80]!r}")
    return value


def project(calibration, rays):
    """Return the pixels (n, 2) of rays (n, 2), x / z and y / z in the camera's frame."""
    rays = np.asarray(rays, float)
    if calibration.lens in ("opencv", "fisheye"):
        points = np.concatenate([rays, np.ones((len(rays), 1))], axis=1)[:, None]
        none = np.zeros(3)
        coefficients = np.array(calibration.coefficients, float)
        if calibration.lens == "fisheye":
            return cv2.fisheye.projectPoints(points, none, none, calibration.K, coefficients)[0].reshape(-1, 2)
        pixels, _ = cv2.projectPoints(points, none, none, calibration.K, coefficients)
        return pixels.reshape(-1, 2)
    focal, centre = np.array([calibration.fx, calibration.fy]), np.array([calibration.cx, calibration.cy])
    size = half_short_edge_px(calibration.width, calibration.height)
    u = rays * focal / size
    return centre + size * u * _radial_factor(calibration, np.linalg.norm(u, axis=1, keepdims=True))


def half_short_edge_px(width, height):
    """Return the radius that is 1 to lensfun: half the short edge between the outer pixels' centres."""
    return (min(width, height) - 1) / 2


def _radial_factor(calibration, r):
    """Return distorted over undistorted radius r, in half short edges (lensfun's reference of its models)."""
    k = calibration.coefficients
    if calibration.lens == "poly3":
        return 1 - k[0] + k[0] * r**2
    if calibration.lens == "poly5":
        return 1 + k[0] * r**2 + k[1] * r**4
    return k[0] * r**3 + k[1] * r**2 + k[2] * r + 1 - sum(k)
