"""What a detector is, which there are, which markers they read, and what all of them share: parameters, image check, poses.

A detector is a module or package in this folder with ``PARAMETERS`` (dict of defaults) and
``make_detector(dictionaries, **parameters)``, whose result has ``detect(image) -> list[Detection]``.
Names that begin with ``_`` and this file are no detectors. Optional are ``reads(family) -> bool``, which families of markers it
reads (without it: all that have an OpenCV dictionary), and ``NEEDS``, {module: package} that are to be installed; a package is
imported in ``make_detector``, so that the rest is known without it. A detector that follows markers through sequences is a
package with a module ``tracker``: ``TRACKER_PARAMETERS``, defaults beside the detector's own (``budget_ms`` among them
where a frame's time can be bounded), and ``Tracker(dictionaries, K=..., code_m=..., **parameters)``.
"""

import importlib
import importlib.util
import math
import pkgutil
from dataclasses import dataclass
from pathlib import Path

import cv2
import numpy as np

from markers.contract import opencv_dictionary
from rig.errors import InputError
from rig.plates import marker_corners_plate

DEFAULT_DICTIONARIES = ("DICT_5X5_1000", "DICT_ARUCO_ORIGINAL")


@dataclass(frozen=True, eq=False)
class Detection:
    """One marker in one image.

    dictionary  the marker's family, such as OpenCV's ``DICT_5X5_1000``
    id          int
    corners     float64 (4, 2), pixels: of the code's square (of an ArUco marker the black frame's outer corners), top left,
                top right, bottom right, bottom left of the marker; the centre of the top-left pixel is (0, 0)
    """

    dictionary: str
    id: int
    corners: np.ndarray


def available():
    """Return the sorted names of the detectors in this folder."""
    names = (m.name for m in pkgutil.iter_modules([str(Path(__file__).parent)]))
    return sorted(n for n in names if not n.startswith("_") and n != "contract")


def load(name):
    """Return the detector's module; InputError where there is none, or where it lacks a package it needs."""
    if name not in available():
        raise InputError(f"unknown detector {name!r}; allowed are {', '.join(available())}")
    return importlib.import_module(f"detectors.{name}")


def needs_of(name):
    """Return {module: package} that a detector needs besides what every installation has."""
    return getattr(load(name), "NEEDS", {})


def check_packages(name, where):
    """Raise InputError where a package that a detector needs is not installed; ``where`` names the detector's place."""
    for module, package in needs_of(name).items():
        if importlib.util.find_spec(module) is None:
            raise InputError(
                f"{where}: detector {name} needs the package {package}: install the optional extra 'trackers', or leave "
                "the detector out"
            )


def reads(name, family):
    """Return whether a detector reads a family of markers; InputError for a family that no marker type knows."""
    module = load(name)
    if hasattr(module, "reads"):
        return bool(module.reads(family))
    return opencv_dictionary(family) is not None


def readers(names, families, where):
    """Return those of some detectors' ``names`` that read at least one of the families, all where there is no family.

    Raises InputError for a family that none of them reads, saying who does.
    """
    for family in families:
        try:
            opencv_dictionary(family)
        except InputError as error:
            raise InputError(f"{where}: {error}") from None
        if not any(reads(name, family) for name in names):
            others = [name for name in available() if reads(name, family)]
            hint = f"; {', '.join(others)} would" if others else ""
            raise InputError(f"{where}: none of {', '.join(names)} reads markers of {family}{hint}")
    return [name for name in names if not families or any(reads(name, family) for family in families)]


def finders_of(families):
    """Return {family: name of a detector} of the families that have no OpenCV dictionary.

    By it registration and diagnosis find them, whatever is configured: the first by name that reads a family and has its
    packages. Raises InputError where there is none.
    """
    found = {}
    for family in sorted(set(families)):
        if opencv_dictionary(family) is None:
            able = [name for name in available() if reads(name, family)]
            ready = [name for name in able if all(map(importlib.util.find_spec, needs_of(name)))]
            if not ready:
                hint = f": install the optional extra 'trackers' ({', '.join(able)})" if able else ""
                raise InputError(f"no detector here reads markers of {family}{hint}")
            found[family] = ready[0]
    return found


def tracker_of(name):
    """Return the module of a detector's tracker; None where it has none and takes sequences frame by frame."""
    if not (Path(__file__).parent / name / "tracker.py").is_file():
        return None
    return importlib.import_module(f"detectors.{name}.tracker")


def check_parameters(name, parameters, where="parameters"):
    """Return the detector's defaults updated by ``parameters``.

    where  the file or key that the parameters come from, for the message
    Raises InputError for a name that the detector does not know and for a value of another kind.
    """
    defaults = load(name).PARAMETERS
    for key, value in (parameters or {}).items():
        if key not in defaults:
            allowed = ", ".join(sorted(defaults)) or "none"
            raise InputError(f"{where}: detector {name} has no parameter {key!r}; allowed are {allowed}")
        if defaults[key] is not None and not _same_kind(value, defaults[key]):
            wanted = type(defaults[key]).__name__
            raise InputError(f"{where}: {name}.{key} is {value!r}; wanted is {wanted}, as in {defaults[key]!r}")
    return {**defaults, **(parameters or {})}


def check_for_sequences(detectors, where):
    """Refuse, by InputError, detectors {name: parameters} that do not exist, and parameters that none of them, nor its
    tracker, knows; ``where`` is the file and key that they come from.
    """
    for name, parameters in detectors.items():
        if name not in available():
            raise InputError(f"{where}: {name!r} does not exist; allowed are {', '.join(available())}")
        tracker = tracker_of(name)
        known = tracker.TRACKER_PARAMETERS if tracker else {}
        check_parameters(name, {k: v for k, v in parameters.items() if k not in known}, f"{where}.{name}")


def _same_kind(value, default):
    if isinstance(default, bool) or isinstance(value, bool):
        return isinstance(value, bool) and isinstance(default, bool)
    if isinstance(default, float):
        return isinstance(value, int | float) and bool(np.isfinite(value))
    return isinstance(value, type(default))


def make(name, dictionaries=DEFAULT_DICTIONARIES, parameters=None, where="parameters"):
    """Return a detector for those of some families (``dictionaries``) that it reads.

    Raises InputError for an unknown name, family or parameter, a missing package, and families of which it reads none.
    """
    try:
        mine = tuple(family for family in dictionaries if reads(name, family))
    except InputError as error:
        raise InputError(f"{where}: {error}") from None
    if not mine:
        known = getattr(load(name), "FAMILIES", ())
        hint = f"; it reads {', '.join(known)}" if isinstance(known, dict) else ""
        raise InputError(f"{where}: detector {name} reads no markers of {', '.join(dictionaries)}{hint}")
    parameters = check_parameters(name, parameters, where)
    check_packages(name, where)
    try:
        return load(name).make_detector(mine, **parameters)
    except ValueError as error:
        raise InputError(f"{where}: detector {name}: {error}") from None


def grey_image(image):
    """Return the image as contiguous uint8 (rows, columns).

    Accepts uint8 and uint16 (full range, scaled to 8 bits), grey, BGR or BGRA, with any strides.
    Raises ValueError for an empty image, another shape, and other types: the range of floats is unknown.
    """
    if not isinstance(image, np.ndarray):
        raise ValueError(f"an image is a numpy array, not {type(image).__name__}")
    if image.dtype not in (np.uint8, np.uint16):
        raise ValueError(f"an image has 8 or 16 bits unsigned, not {image.dtype}")
    if image.ndim == 3 and image.shape[2] == 1:
        image = image[:, :, 0]
    if image.ndim != 2 and not (image.ndim == 3 and image.shape[2] in (3, 4)):
        raise ValueError(f"an image is grey, BGR or BGRA, not of shape {image.shape}")
    if image.size == 0:
        raise ValueError(f"the image is empty: shape {image.shape}")
    if image.dtype == np.uint16:
        image = ((image.astype(np.uint32) + 128) // 257).astype(np.uint8)
    image = np.ascontiguousarray(image)
    if image.ndim == 3:
        code = cv2.COLOR_BGR2GRAY if image.shape[2] == 3 else cv2.COLOR_BGRA2GRAY
        image = cv2.cvtColor(image, code)
    return image


def estimate_poses(corners, code_m, K, dist=None):
    """Return both poses of a square marker, the better first: a list of (rvec, tvec, reprojection RMS in pixels).

    corners  (4, 2) pixels, code_m side of the black frame in metres, K 3 x 3, dist OpenCV's coefficients.
    Poses are ``T_cam_marker`` (radians, metres). Infinitesimal plane-based pose estimation (Collins and Bartoli
    2014, OpenCV's SOLVEPNP_IPPE_SQUARE). Empty where the corners allow no pose.
    """
    corners = np.asarray(corners, float).reshape(4, 1, 2)
    if not (np.isfinite(corners).all() and code_m > 0):
        return []
    try:
        n, rvecs, tvecs, errors = cv2.solvePnPGeneric(
            marker_corners_plate(code_m), corners, np.asarray(K, float), dist, flags=cv2.SOLVEPNP_IPPE_SQUARE
        )
    except cv2.error:
        return []
    poses = []
    for rvec, tvec, error in zip(rvecs, tvecs, errors, strict=True) if n else ():
        rms = math.sqrt(2) * float(error[0])  # OpenCV's is that of one coordinate
        if math.isfinite(rms) and tvec[2, 0] > 0:
            poses.append((rvec.ravel(), tvec.ravel(), rms))
    return sorted(poses, key=lambda pose: pose[2])
