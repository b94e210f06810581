"""What a marker type is, which there are, and a row of the markers' table as a plate.

A type is a module in this folder; names that begin with ``_`` and this file are none. It has
    FAMILIES          which families it knows, in words, for messages
    CORNERS           what lies at the corners of the code's square, in words, for readers
    ids(family)       how many ids the family has, counted from 0; None where the family is not this type's
    draw(family, id)  the ``Drawing`` of a marker
    opencv_dictionary(family)  optional: the cv2.aruco.Dictionary by which a tracker of square codes reads it

Lengths are in sides of the code's *square*: the square of side ``code_m`` about the marker's centre, whose corners (top
left, top right, bottom right, bottom left) are what trackers report and poses are made of. What is printed may reach beyond
it. Which trackers read a family, trackers say (``detectors.contract``).
"""

import functools
import importlib
import pkgutil
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np

from rig.discs import no_discs
from rig.errors import InputError
from rig.geometry import make_pose, transform
from rig.plates import Plate, marker_corners_plate

FINDS_NEIGHBOURS = True  # for imports.py: what imports this depends on all types


@dataclass(frozen=True, eq=False)
class Drawing:
    """How a marker is printed on white paper; x right, y up, from the marker's centre, in sides of the code's square.

    white   bool (n, n), the cells; row 0 is the top
    lines   (n + 1,) increasing, the boundaries of the cells both ways; None: equal cells that fill the code's square
    discs   (k, 4): x, y, radius, 1 white or 0 black; painted in order, each wholly on ground of one colour
    """

    white: np.ndarray
    lines: np.ndarray | None = None
    discs: np.ndarray = field(default_factory=no_discs)

    @property
    def reach(self):
        """Half the side of the square that holds all that is printed."""
        cells = 0.5 if self.lines is None else float(np.abs(self.lines[[0, -1]]).max())
        discs = np.abs(self.discs[:, :2]).max(axis=1) + self.discs[:, 2]
        return max([cells, *discs])


def available():
    """Return the sorted names of the types in this folder."""
    names = (m.name for m in pkgutil.iter_modules([str(Path(__file__).parent)]))
    return sorted(n for n in names if not n.startswith("_") and n != "contract")


@functools.cache
def type_of(family):
    """Return the module of the type that knows a family; InputError that says which there are where none does."""
    types = [importlib.import_module(f"markers.{name}") for name in available()]
    for module in types:
        if module.ids(family) is not None:
            return module
    known = "; ".join(module.FAMILIES for module in types)
    raise InputError(f"{family!r} is no family of markers; known are {known}")


def count_of(family):
    """Return how many ids a family has; InputError where no type knows it."""
    return type_of(family).ids(family)


@functools.lru_cache(maxsize=4096)
def drawing_of(family, number):
    """Return the Drawing of a marker; InputError for a family that no type knows and an id outside it."""
    count = count_of(family)
    if not 0 <= number < count:
        raise InputError(f"{family} has the ids 0 to {count - 1}, not {number}")
    return type_of(family).draw(family, int(number))


def opencv_dictionary(family):
    """Return the cv2.aruco.Dictionary of a family, None where it has none; InputError where no type knows it."""
    module = type_of(family)
    return module.opencv_dictionary(family) if hasattr(module, "opencv_dictionary") else None


def least_plate(family, number):
    """Return the side of the smallest plate that holds a marker, in sides of its code's square."""
    return 2 * drawing_of(family, number).reach


def marker_plate(marker):
    """Return the Plate of a row of the markers' table (dictionary, id, code_m, plate_m, x..z, rx..rz)."""
    drawing = drawing_of(marker.dictionary, int(marker.id))
    n = len(drawing.white)
    if drawing.lines is None:
        code = np.linspace(-marker.code_m / 2, marker.code_m / 2, n + 1)
    else:
        code = drawing.lines * marker.code_m
    half = marker.plate_m / 2
    lines = np.concatenate([[-half], code, [half]])
    white = np.ones((n + 2, n + 2), bool)
    white[1:-1, 1:-1] = drawing.white[::-1]
    T = make_pose([marker.rx, marker.ry, marker.rz], [marker.x, marker.y, marker.z])
    discs = drawing.discs * [marker.code_m, marker.code_m, marker.code_m, 1]
    return Plate(f"{marker.dictionary}/{int(marker.id)}", T, lines, lines, white, discs)


def marker_corners_world(marker):
    """Return the corners (4, 3) of a row of the markers' table in the world: of its code's square."""
    T = make_pose([marker.rx, marker.ry, marker.rz], [marker.x, marker.y, marker.z])
    return transform(T, marker_corners_plate(marker.code_m))
