"""What photographs show: a calibration board, the plates of a known rig, or markers that nobody has described."""

from collections import Counter
from dataclasses import dataclass, field
from pathlib import Path

import cv2
import numpy as np
import pandas as pd
from pydantic import ValidationError

from inputs.campaign import Board
from inputs.experiment import rig_markers
from register.boards import find_board
from rig.errors import InputError
from start.markers import (
    FITTING_SHARE,
    LEAST_MARKERS,
    SAMPLES,
    agreeing,
    best_layout,
    dictionaries_seen,
    smallest_dictionary,
)

GUESSED_SQUARE_M = 0.025
NICE_RATIOS = (0.5, 0.6, 2 / 3, 0.7, 0.75, 0.8, 0.85, 0.9)  # of marker and square: what generators offer
NEAR = 0.015
FEWEST_SQUARES = (3, 3)
CHECKED = 4  # photographs in which a chessboard's size is checked by another finder
ENOUGH_PX = 1000  # longer side, at which a chessboard's squares are counted
LEAST_PHOTOGRAPHS = 3  # that show a chessboard alike: patterns without ids are found where there are none


@dataclass(frozen=True)
class Pattern:
    """What was found.

    board    inputs.campaign.Board, or None
    markers  the markers' table of a known rig, or None; rig is its file
    guesses  {key of the board, or "square": why it is what it is}
    seen     one bool a photograph: whether it shows enough of it
    """

    board: object
    markers: pd.DataFrame | None
    guesses: dict = field(default_factory=dict)
    seen: tuple = ()
    rig: str = ""


def find_pattern(images, square_m, rigs):
    """Return the Pattern in grey images, uint8.

    square_m  printed side of a square (of a grid: of a marker), None where it is not known
    rigs      files of rigs whose printed plates are known
    Raises InputError where nothing is found, or nothing that can be described.
    """
    found = dictionaries_seen(images)
    for rig in rigs:  # before boards: a ladder of plates lies as a ChArUco board of two columns
        pattern = _plates(found, rig)
        if pattern is not None:
            return pattern
    for name, seen in found.items():
        layout = best_layout(seen)
        pattern = None if layout is None else _board(name, layout, square_m)
        if pattern is not None:
            return pattern
    pattern = _chessboard(images, square_m)
    if pattern is not None:
        return pattern
    if found:
        names = ", ".join(f"{n} ({len(set().union(*(set(s.ids) for s in seen)))} ids)" for n, seen in found.items())
        raise InputError(
            f"there are markers, {names}, which lie neither as on a board nor as on a rig of config/rigs: measure where "
            "they lie and write markers.csv (docs/campaign-format.md)"
        )
    raise InputError(
        "no photograph shows a chessboard, a ChArUco board, a grid of markers or printed plates: is the board whole, flat "
        "and sharp? `make board` prints one"
    )


def _board(dictionary, layout, square_m):
    """Return the Pattern of a board whose markers' layout is known; None where no print is like that."""
    charuco = layout.kind == "charuco"
    rows, ratio = layout.rows(), layout.ratio
    nice = min(NICE_RATIOS, key=lambda r: abs(r - ratio))
    ratio = nice if abs(nice - ratio) < NEAR else round(ratio, 3)
    side = square_m or GUESSED_SQUARE_M
    markers = layout.columns * rows // (2 if charuco else 1)
    markers = max(markers, max(layout.inliers) + 1)
    given = {
        "dictionary": smallest_dictionary(dictionary, markers), "columns": layout.columns, "rows": rows,
        "legacy_pattern": layout.marker_at_corner,
    }  # fmt: skip
    guesses = {
        "dictionary": "the smallest of its family that has so many markers",
        "rows": f"the lowest row that was seen, by id {max(layout.inliers)}",
    }
    if charuco:
        given |= {"type": "charuco", "square_m": side, "marker_m": round(side * ratio, 6)}
        guesses["marker_m"] = f"measured in the photographs: {layout.ratio:.3f} of a square"
    else:
        kind = "apriltag_grid" if "APRILTAG" in dictionary else "aruco_grid"
        given |= {"type": kind, "marker_m": side, "gap_m": round(side * (1 / layout.ratio - 1), 5)}
        guesses["gap_m"] = f"measured in the photographs: {1 / layout.ratio - 1:.3f} of a marker"
    if square_m is None:
        guesses["square_m" if charuco else "marker_m"] = "GUESSED: measure it on the print"
    if not charuco or rows % 2:
        del given["legacy_pattern"]
    try:
        board = Board.model_validate(given)
    except ValidationError:
        return None
    return Pattern(board, None, guesses, layout.shown)


def _plates(found, rig):
    """Return the Pattern of a known rig's plates where most of the markers seen are its and lie as it says."""
    table = rig_markers(rig)
    names = {s: n for n in set(table.dictionary) for s in found if _family(n) == _family(s)}
    if not names or len(set(names.values())) < table.dictionary.nunique():
        return None
    lying = total = 0
    shown = np.zeros(len(next(iter(found.values()))), int)
    for name, own in names.items():
        places = table[table.dictionary == own].set_index("id")[["x", "y"]]
        for k, seen in enumerate(found[name]):
            known = np.isin(seen.ids, places.index)
            total += len(seen.ids)
            mine = type(seen)(seen.ids[known], seen.quads[known])
            inliers, _ = agreeing(mine, places.loc[mine.ids].to_numpy() * (1, -1))
            lying, shown[k] = lying + len(inliers), shown[k] + len(inliers)
    if total == 0 or lying < FITTING_SHARE * total:
        return None
    guesses = {"markers": f"the plates of {Path(rig).name}, as `python scripts/print_board.py rig {rig}` prints them"}
    return Pattern(None, table, guesses, tuple(shown >= LEAST_MARKERS), str(rig))


def _family(dictionary):
    head, _, size = dictionary.rpartition("_")
    return head if size.isdigit() else dictionary


def _chessboard(images, square_m):
    """Return the Pattern of the chessboard that most images show whole; None where none does."""
    step = max(1, len(images) // SAMPLES)
    if not any(chessboard_size(image)[0] for image in images[::step]):
        return None
    found = [tuple(sorted(chessboard_size(image))) for image in images]
    sizes = Counter(size for size in found if size[0])
    # more squares than there are is not seen, fewer is: of a board's parts the whole one counts
    rows, columns = max(sizes, key=lambda s: sizes[s] * s[0] * s[1], default=(0, 0))
    if sizes[rows, columns] < LEAST_PHOTOGRAPHS:
        return None
    seen_so = sizes[rows, columns]
    with_it = [image for image, size in zip(images, found, strict=True) if size == (rows, columns)]
    rows, columns = _whole(with_it, rows, columns)
    board = Board(type="chessboard", columns=columns, rows=rows, square_m=square_m or GUESSED_SQUARE_M)
    guesses = {"columns": f"inner corners, as {seen_so} of {len(images)} photographs show them"}
    if square_m is None:
        guesses["square_m"] = "GUESSED: measure it on the print"
    pairs = zip(found, images, strict=True)
    shown = (size == (rows, columns) or len(find_board(image, board).image) > 0 for size, image in pairs)
    return Pattern(board, None, guesses, tuple(shown))


def _whole(images, rows, columns):
    """Return (rows, columns) of the whole board of which images show so much: counting may stop a row before the edge."""
    step = max(1, len(images) // CHECKED)
    sizes = [(rows + more, columns + wider) for more in (0, 1) for wider in (0, 1)]
    counts = {}
    for height, width in sizes:
        board = Board(type="chessboard", columns=width, rows=height, square_m=GUESSED_SQUARE_M)
        counts[height, width] = sum(len(find_board(image, board).image) > 0 for image in images[::step])
    enough = max(counts.values()) / 2
    return max((s for s in sizes if counts[s] >= enough), key=lambda s: s[0] * s[1]) if enough else (rows, columns)


def chessboard_size(grey):
    """Return (rows, columns) of inner corners of the largest chessboard in an image, (0, 0) where there is none."""
    scale = ENOUGH_PX / max(grey.shape)
    if scale < 1:  # clutter takes long at full size
        grey = cv2.resize(grey, None, fx=scale, fy=scale, interpolation=cv2.INTER_AREA)
    flags = cv2.CALIB_CB_LARGER | cv2.CALIB_CB_NORMALIZE_IMAGE
    found, _, meta = cv2.findChessboardCornersSBWithMeta(grey, FEWEST_SQUARES, flags)
    return meta.shape[:2] if found else (0, 0)
