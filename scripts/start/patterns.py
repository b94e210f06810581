"""What photographs show: a calibration board, the plates of a known rig, or markers that nobody has described."""

from collections import Counter
from dataclasses import dataclass, field
from itertools import combinations
from pathlib import Path

import cv2
import numpy as np
import pandas as pd
from pydantic import ValidationError

from inputs.campaign import CalibrationBoard
from inputs.experiment import rig_markers
from markers.contract import marker_corners_world
from register.boards import find_board
from rig.errors import InputError
from start.loose import place_loose_markers
from start.markers import (
    FITTING_SHARE,
    MIN_MARKERS,
    SAMPLES,
    agreeing,
    best_layout,
    dictionaries_seen,
    smallest_dictionary,
)
from start.paper import plate_over_code

GUESSED_SQUARE_M, GUESSED_MARKER_M = 0.025, 0.05
GUESSED_PLATE = 1.25  # side of a white plate over that of its code
NICE_RATIOS = (0.5, 0.6, 2 / 3, 0.7, 0.75, 0.8, 0.85, 0.9)  # of marker and square: what generators offer
NEAR = 0.015
FEWEST_SQUARES = (3, 3)
CHECKED = 4  # photographs in which a chessboard's size is checked by another finder
COUNTED_PX = 1000  # longer side, at which a chessboard's squares are counted
TOGETHER = 2  # markers, that tell how they lie to each other
MIN_PHOTOGRAPHS = 3  # that show a chessboard alike: patterns without ids are found where there are none


@dataclass(frozen=True)
class Pattern:
    """What was found.

    board    inputs.campaign.CalibrationBoard, or None
    markers  the markers' table of a known rig or of loose markers, or None; rig is the known one's file
    guesses  {key of the board, or "square": why it is what it is}
    seen     one bool a photograph: whether it shows enough of it
    left_out [(marker, why)] of markers that are not in the table
    focals   {camera number: (focal length, standard error)} in pixels of the images looked at, of loose markers
    """

    board: object
    markers: pd.DataFrame | None
    guesses: dict = field(default_factory=dict)
    seen: tuple = ()
    rig: str = ""
    left_out: tuple = ()
    focals: dict = field(default_factory=dict)


def find_pattern(images, square_m, marker_m, rigs, loose):
    """Return the Pattern in grey images, uint8.

    square_m, marker_m  printed sides of a square and of a marker, None where not known; of a grid, either is a marker's
    rigs      files of rigs whose printed plates are known
    loose     returns the Pattern of {dictionary: [Seen of each image]}, for markers that lie as on none of these
    Raises InputError where nothing is found, or nothing that can be described.
    """
    found = dictionaries_seen(images)
    for rig in rigs:  # before boards: a ladder of plates lies as a ChArUco board of two columns
        pattern = _plates(found, rig)
        if pattern is not None:
            return pattern
    for name, seen in found.items():
        layout = best_layout(seen)
        pattern = None if layout is None else _board(name, layout, square_m, marker_m)
        if pattern is not None:
            return pattern
    chessboard = _chessboard(images, square_m)
    # white plates with black markers between them look like squares too
    if chessboard is not None and not _in_most(found):
        return chessboard
    if found:
        names = ", ".join(f"{n} ({len(set().union(*(set(s.ids) for s in seen)))} ids)" for n, seen in found.items())
        try:
            return loose(found)
        except InputError as error:
            if chessboard is not None:
                return chessboard
            raise InputError(
                f"there are markers, {names}, which lie neither as on a board nor as on a rig of config/rigs, and where they "
                f"lie can't be told: {error}; take more photographs, or measure it and write markers.csv "
                "(docs/campaign-format.md)"
            ) from None
    raise InputError(
        "no photograph shows a chessboard, a ChArUco board, a grid of markers or printed plates: is the board whole, flat "
        "and sharp? `make board` prints one"
    )


def _in_most(found):
    """Return whether most photographs show two markers or more of one dictionary."""
    return any(sum(len(s.ids) >= TOGETHER for s in seen) > len(seen) / 2 for seen in found.values())


def _board(dictionary, layout, square_m, marker_m):
    """Return the Pattern of a board whose markers' layout is known; None where no print is like that."""
    charuco = layout.kind == "charuco"
    rows, ratio = layout.rows(), layout.ratio
    nice = min(NICE_RATIOS, key=lambda r: abs(r - ratio))
    ratio = nice if abs(nice - ratio) < NEAR else round(ratio, 3)
    known = square_m or (marker_m and marker_m / ratio) if charuco else marker_m or square_m
    side = known or GUESSED_SQUARE_M
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
        given |= {"type": "charuco", "square_m": round(side, 6), "marker_m": marker_m or round(side * ratio, 6)}
        if marker_m is None:
            guesses["marker_m"] = f"measured in the photographs: {layout.ratio:.3f} of a square"
        elif square_m is None:
            guesses["square_m"] = f"measured in the photographs: {1 / layout.ratio:.3f} of a marker"
    else:
        kind = "apriltag_grid" if "APRILTAG" in dictionary else "aruco_grid"
        given |= {"type": kind, "marker_m": side, "gap_m": round(side * (1 / layout.ratio - 1), 5)}
        guesses["gap_m"] = f"measured in the photographs: {1 / layout.ratio - 1:.3f} of a marker"
    if known is None:
        guesses["square_m" if charuco else "marker_m"] = "GUESSED: measure it on the print"
    if not charuco or rows % 2:
        del given["legacy_pattern"]
    try:
        board = CalibrationBoard.model_validate(given)
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
    return Pattern(None, table, guesses, tuple(shown >= MIN_MARKERS), str(rig))


def loose_pattern(found, images, sizes, camera, side_m, focals):
    """Return the Pattern of markers that lie loose; places and their standard errors are estimated.

    found, sizes, camera, focals  as in start.loose.place_loose_markers; side_m is None where it is not known
    Raises InputError where too few are seen together.
    """
    guesses, side = {}, side_m or GUESSED_MARKER_M
    placed = place_loose_markers(found, sizes, camera, side, focals)
    table = placed.markers
    sightings = [(v, s.quads[k]) for seen in found.values() for v, s in enumerate(seen) for k in range(len(s.ids))]
    paper = plate_over_code(images, *map(list, zip(*sightings, strict=True)))
    room = room_for_plates(table) / side
    table["plate_m"] = np.round(side * min(paper or GUESSED_PLATE, room), 6)
    if not placed.flat:  # nothing lies under the ground
        table["z"] -= min(
            0.0, min(marker_corners_world(m._replace(code_m=m.plate_m))[:, 2].min() for m in table.itertuples())
        )
    first = table.iloc[0]
    error_mm = 1000 * np.sqrt((table[["se_x", "se_y", "se_z"]].iloc[1:] ** 2).sum(axis=1)).median()
    guesses["markers"] = (
        f"{len(table)} markers{', flat,' if placed.flat else ', not all in one plane,'} in the frame of "
        f"{first.dictionary}/{first.id}; places estimated from the photographs, standard error {error_mm:.2g} mm"
    )
    how = f"seen: {paper:.2f} of a code" if paper else f"GUESSED: {GUESSED_PLATE:g} of a code"
    if room < (paper or GUESSED_PLATE):
        how = f"{room:.2f} of a code: larger ones would overlap"
    guesses["plate_m"] = f"the white plates' side, the same for all; {how}"
    if side_m is None:
        guesses["code_m"] = f"GUESSED: all codes have sides of {1000 * side:g} mm, and all places are in proportion"
    return Pattern(None, table, guesses, placed.seen, "", tuple(placed.left_out), placed.focal_px)


def room_for_plates(markers):
    """Return the largest side, metres, that plates round the codes of a table can have without overlapping."""
    corners = [marker_corners_world(m) for m in markers.itertuples()]
    centres = [c.mean(axis=0) for c in corners]
    frames = [_axes(c) for c in corners]
    pairs = combinations(range(len(corners)), 2)
    return min((_room_between(frames[i], frames[j], centres[j] - centres[i]) for i, j in pairs), default=np.inf)


def _axes(corners):
    """Return the unit vectors (3, 3) along a marker's sides and out of its plane."""
    u, v = corners[1] - corners[0], corners[0] - corners[3]
    u, v = u / np.linalg.norm(u), v / np.linalg.norm(v)
    return np.stack([u, v, np.cross(u, v)])


def _room_between(one, other, apart):
    """Return the largest side of two equal squares with axes (3, 3), ``apart`` from each other, that some axis separates."""
    axes = np.concatenate([one, other])
    width = sum(np.abs(axes @ frame[:2].T).sum(axis=1) / 2 for frame in (one, other))
    free = width > 1e-6  # two planes that are parallel hold each other's whole squares
    sides = np.abs(axes @ apart)[free] / width[free]
    return np.inf if (np.abs(axes @ apart)[~free] > 1e-4).any() else sides.max()


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
    if sizes[rows, columns] < MIN_PHOTOGRAPHS:
        return None
    seen_so = sizes[rows, columns]
    with_it = [image for image, size in zip(images, found, strict=True) if size == (rows, columns)]
    rows, columns = _whole(with_it, rows, columns)
    board = CalibrationBoard(type="chessboard", columns=columns, rows=rows, square_m=square_m or GUESSED_SQUARE_M)
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
        board = CalibrationBoard(type="chessboard", columns=width, rows=height, square_m=GUESSED_SQUARE_M)
        counts[height, width] = sum(len(find_board(image, board).image) > 0 for image in images[::step])
    enough = max(counts.values()) / 2
    return max((s for s in sizes if counts[s] >= enough), key=lambda s: s[0] * s[1]) if enough else (rows, columns)


def chessboard_size(grey):
    """Return (rows, columns) of inner corners of the largest chessboard in an image, (0, 0) where there is none."""
    scale = COUNTED_PX / max(grey.shape)
    if scale < 1:  # clutter takes long at full size
        grey = cv2.resize(grey, None, fx=scale, fy=scale, interpolation=cv2.INTER_AREA)
    flags = cv2.CALIB_CB_LARGER | cv2.CALIB_CB_NORMALIZE_IMAGE
    found, _, meta = cv2.findChessboardCornersSBWithMeta(grey, FEWEST_SQUARES, flags)
    return meta.shape[:2] if found else (0, 0)
