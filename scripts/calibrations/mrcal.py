"""mrcal's .cameramodel: a Python dict. Its OPENCV models follow OpenCV's order. Source: mrcal's "The .cameramodel file"."""

import ast

from calibrations.lens import Calibration, entry, numbers
from rig.errors import InputError

TITLE, SUFFIX = "mrcal .cameramodel", ".cameramodel"
COUNTS = {"LENSMODEL_PINHOLE": 0} | {f"LENSMODEL_OPENCV{n}": n for n in (4, 5, 8, 12)}
HOLDS = tuple(("opencv", count) for count in COUNTS.values())


def is_one(text):
    """Return whether a text is a Python dict with a lens model."""
    return "lensmodel" in text and "imagersize" in text and "intrinsics" in text


def read(text, where):
    """Return {name: Calibration} of a file; it is parsed as plain data, nothing in it is run."""
    try:
        data = ast.literal_eval(text)
    except (ValueError, SyntaxError, TypeError, MemoryError, RecursionError) as error:
        raise InputError(f"{where}: not the Python dict that mrcal writes ({str(error)[:80]})") from None
    model = entry(where, data, "lensmodel", str)
    if model not in COUNTS:
        raise InputError(f"{where}: lensmodel is {model[:60]!r}; read are {', '.join(COUNTS)}")
    values = numbers(f"{where}: intrinsics", entry(where, data, "intrinsics"), 4 + COUNTS[model])
    size = entry(where, data, "imagersize")
    numbers(f"{where}: imagersize", size, 2)
    return {"camera": Calibration(*size, *values[:4], "opencv", values[4:])}


def write(name, calibration):
    """Return the text of a file; the camera is at its frame's origin."""
    c = calibration
    model = next(m for m, count in COUNTS.items() if count == len(c.coefficients))
    values = ", ".join(map(repr, map(float, (c.fx, c.fy, c.cx, c.cy, *c.coefficients))))
    return (
        f"# {name}\n{{\n    'lensmodel': '{model}',\n    'intrinsics': [ {values},],\n"
        f"    'extrinsics': [ 0., 0., 0., 0., 0., 0.,],\n    'imagersize': [ {c.width}, {c.height},]\n}}\n"
    )
