"""Which formats there are, and reading a file in any of them.

A format is a module beside this one with
    TITLE                    what people call it
    SUFFIX                   of its files
    HOLDS                    ((lens model, number of coefficients), ...) that it can hold, the simplest first
    FIXED                    optional: names of what it can't hold ("aspect": fx is fy)
    SEPARATES_COLOURS, HAS_FALLOFF  optional: whether it holds magnification by colour, the fall-off of light
    is_one(text)             whether a text looks like its files
    read(text, where)        {name: Calibration}; raises InputError naming ``where``
    for_size(calibration, width, height)  optional: what ``read`` gave, in pixels, where a format has no size of images
    write(name, calibration) the text of a file
"""

import functools
import importlib
import pkgutil
from pathlib import Path

import calibrations
from calibrations.lens import checked
from rig.errors import InputError

LARGEST_BYTES = 20_000_000
SHARED_MODULES = ("formats", "lens", "refit", "twin_lens")


@functools.cache
def available_formats():
    """Return {name: module} of all formats."""
    names = sorted(m.name for m in pkgutil.iter_modules(calibrations.__path__))
    return {n: importlib.import_module(f"calibrations.{n}") for n in names if n not in SHARED_MODULES and n[0] != "_"}


def read_calibration(path, size=None):
    """Return the Calibration in a file of any format; ``FILE#NAME`` chooses one of several cameras.

    size  (width, height) of the images, for formats that have none
    Raises InputError naming file, what is wrong, and, of several cameras, their names.
    """
    path, _, wanted = str(path).partition("#")
    text = _text_of(Path(path))
    found = next((module for module in available_formats().values() if module.is_one(text)), None)
    if found is None:
        titles = ", ".join(module.TITLE for module in available_formats().values())
        raise InputError(f"{path}: no calibration in a known format; known: {titles}")
    cameras = found.read(text, path)
    if not wanted and len(cameras) > 1:
        raise InputError(f"{path}: has {', '.join(cameras)}; choose one: {path}#{next(iter(cameras))}")
    if wanted and wanted not in cameras:
        raise InputError(f"{path}: has no camera {wanted!r}; there are {', '.join(cameras)}")
    if not cameras:
        raise InputError(f"{path}: no camera in it")
    name = wanted or next(iter(cameras))
    where, calibration = f"{path}: {name}" if wanted else path, cameras[name]
    if hasattr(found, "for_size"):
        if size is None:
            raise InputError(f"{where}: {found.TITLE} has no size of images; give it (--size WIDTHxHEIGHT)")
        calibration = found.for_size(calibration, *size)
    return checked(where, calibration)


def _text_of(path):
    if not path.is_file():
        raise InputError(f"{path}: no such file")
    if path.stat().st_size > LARGEST_BYTES:
        raise InputError(f"{path}: {path.stat().st_size} bytes; at most {LARGEST_BYTES} are read")
    try:
        return path.read_text(encoding="utf-8-sig")
    except UnicodeDecodeError as error:
        raise InputError(f"{path}: not UTF-8 text ({error.reason})") from None
