"""How many columns and rows a board has by the markers that photographs show, and how large its markers are."""

from collections import Counter
from dataclasses import dataclass

import cv2
import numpy as np

from register import boards
from rig.board_markers import board_markers
from rig.plates import aruco_dictionary

MAX_COLUMNS, MORE_ROWS = 24, 10  # tried; the rows an even number: a legacy pattern begins with white or black by it
IN_PLACE = 0.3  # of a pitch, from a marker's place; a wide lens moves centres by 0.2, another layout by 0.5 and more
MAX_DRAWS = 200  # of four markers: enough where a third of them lie right
AROUND = 0.6  # of a pitch round a place: with its marker's margin
MIN_IN_PLACE, SHARE_IN_PLACE = 6, 0.6  # of the markers that one photograph shows, for a layout that nobody described
MIN_SEEN = 4  # markers that tell a homography
MIN_VIEWS, SHARE_MISSING = 4, 1 / 3  # photographs of a row that is missing
MAX_SHARE_OFF = 0.06  # relative, of a marker's side in pitches: prints as described are within 0.02
MAX_SIDE_OFF_PX = 4.0  # by which a shaken camera makes small markers smaller

UPRIGHT = np.array([[-1, -1], [1, -1], [1, 1], [-1, 1]])  # corners of a marker from its centre, down from the top left


@dataclass
class Layout:
    """Where the markers of a board have their centres.

    places  {id: (column, row)} in pitches from the top left, integers; row and column of the square of a ChArUco board
    """

    board: object
    places: dict


def pitch_m(board):
    """Return the distance between neighbouring places, metres: of squares, or of a grid's markers."""
    return board.square_m or board.marker_m + board.gap_m


def layout(board):
    """Return the Layout of a board with markers (inputs.campaign.CalibrationBoard), None where its dictionary has too few."""
    count = board.columns * board.rows // (2 if board.type == "charuco" else 1)
    if count > len(aruco_dictionary(board.dictionary).bytesList):
        return None
    table, pitch = board_markers(board), pitch_m(board)
    edge = pitch / 2 if board.type == "charuco" else board.marker_m / 2
    columns = np.round((table.x - edge) / pitch).astype(int)
    rows = board.rows - 1 - np.round((table.y - edge) / pitch).astype(int)
    return Layout(board, dict(zip(table.id, zip(columns, rows, strict=True), strict=True)))


def seen_markers(image, dictionary):
    """Return {id: corners (4, 2) in pixels} of an image; ids that are seen twice are left out."""
    quads, ids, _ = boards.aruco_detector(dictionary).detectMarkers(image)
    ids = [] if ids is None else [int(i) for i in np.ravel(ids)]
    count = Counter(ids)
    return {i: quad.reshape(4, 2).astype(float) for i, quad in zip(ids, quads, strict=True) if count[i] == 1}


def views_of(images, dictionary):
    """Return [({id: corners (4, 2)}, (height, width))] of grey images, uint8."""
    return [(seen_markers(image, dictionary), image.shape) for image in images]


def centre(quad):
    """Return where the diagonals of corners (4, 2) meet: a square's centre in any perspective."""
    a, b, c, d = quad
    t = np.linalg.solve(np.stack([c - a, b - d], axis=1), b - a)[0]
    return a + t * (c - a)


def placed(seen, lay):
    """Return (H (3, 3) from pixels to places, {id: how far its centre is from its place, in pitches}) of one photograph.

    H is None where too few markers, or those of one row or column, are seen.
    """
    ids = [i for i in seen if i in lay.places]
    places = np.array([lay.places[i] for i in ids], float).reshape(-1, 2)
    if len(ids) < MIN_SEEN or min(len(set(c)) for c in places.T) < 2:
        return None, {}
    centres = np.array([centre(seen[i]) for i in ids])
    H, _ = cv2.findHomography(centres, places, cv2.RANSAC, IN_PLACE, maxIters=MAX_DRAWS)
    if H is None:
        return None, {}
    off = np.linalg.norm(cv2.perspectiveTransform(centres[None], H)[0] - places, axis=1)
    return H, dict(zip(ids, off, strict=True))


def in_place(seen, lay):
    """Return the ids of the markers of one photograph that lie where a Layout has them."""
    return {i for i, off in placed(seen, lay)[1].items() if off < IN_PLACE}


def rows_shown(views, board):
    """Return the rows that photographs show of a board whose columns are right: the described number where nothing else is
    seen, more where markers go on below it, fewer where a last row is in view and nowhere seen.

    views  [({id: corners (4, 2)}, image's (height, width))]
    """
    taller = [board.model_copy(update={"rows": board.rows + more}) for more in range(MORE_ROWS, -1, -2)]
    lay = next(filter(None, map(layout, taller)))
    found = [(seen, size, placed(seen, lay)[0], in_place(seen, lay)) for seen, size in views]
    found = [f for f in found if f[2] is not None]
    if not found:
        return board.rows
    rows = [{lay.places[i][1] for i in ids} for *_, ids in found]
    last = max((r for r in set().union(*rows) if sum(r in one for one in rows) > len(rows) / 2), default=board.rows - 1)
    if last >= board.rows - 1 or max(max(one, default=0) for one in rows) >= board.rows - 1:
        return max(last + 1, board.rows)
    missing = sum(_row_is_missing(f, lay, last + 1) for f in found)
    return last + 1 if missing >= max(MIN_VIEWS, SHARE_MISSING * len(found)) else board.rows


def _row_is_missing(view, lay, row):
    """Return whether a photograph shows all markers of the row above, and has half of this row's places well in view."""
    _, (height, width), H, ids = view
    above, these = ([i for i, place in lay.places.items() if place[1] == r] for r in (row - 1, row))
    places = np.array([lay.places[i] for i in these], float)
    beyond = np.stack([places + [dx, dy] for dx in (-AROUND, AROUND) for dy in (-AROUND, AROUND)], axis=1)
    pixels = cv2.perspectiveTransform(beyond.reshape(1, -1, 2), np.linalg.inv(H)).reshape(beyond.shape)
    in_view = ((pixels > 0) & (pixels < [width, height])).all(axis=(1, 2))
    return set(above) <= ids and 2 * in_view.sum() >= len(these)


def other_layout(views, board):
    """Return the CalibrationBoard whose markers lie where photographs show them, of other columns, rows, pattern or type.

    None where no such layout fits. Its lengths are the described ones, or ratios where the type is another; views as of
    ``rows_shown``.
    """
    ids = Counter(i for seen, _ in views for i in seen)
    highest = max((i for i, n in ids.items() if 2 * n > len(views)), default=0)
    best, most = None, 0
    for lay in filter(None, map(layout, _layouts(board, highest))):
        rows = [_rows_in_place(seen, lay) for seen, _ in views]
        count = sum(map(len, rows))
        if 2 * sum(map(bool, rows)) > len(views) and count > most:
            best, most = lay.board.model_copy(update={"rows": max(map(max, filter(None, rows))) + 1}), count
    return best


def _rows_in_place(seen, lay):
    """Return the rows of the markers of a photograph that are in place; none where they are not most of those seen."""
    H, off = placed(seen, lay)
    ids = [i for i, d in off.items() if d < IN_PLACE and _is_upright(seen[i], H)]
    enough = len(ids) >= max(MIN_IN_PLACE, SHARE_IN_PLACE * len(seen))
    return [lay.places[i][1] for i in ids] if enough else []


def _is_upright(quad, H):
    """Return whether a marker's corners (4, 2), pixels, begin at the top left where H takes them: stray ones need not."""
    square = cv2.perspectiveTransform(quad[None], H)[0]
    return bool(((square - square.mean(axis=0)) * UPRIGHT > 0).all())


def _layouts(board, highest):
    """Yield Boards as described but of other columns, type and pattern, with as many rows as hold an id; likely ones first."""
    likely = [board.columns, board.rows, *range(2, MAX_COLUMNS + 1)]
    kinds = ("charuco", "aruco_grid") if board.type in ("charuco", "chessboard") else ("aruco_grid", "charuco")
    for kind in kinds:
        for columns in dict.fromkeys(likely):
            rows = -(-(highest + 1) * (2 if kind == "charuco" else 1) // columns) + 1
            for legacy in (board.legacy_pattern, not board.legacy_pattern) if kind == "charuco" else (False,):
                counts = {
                    "columns": columns,
                    "rows": max(2, rows + (rows % 2 if legacy else 0)),
                    "legacy_pattern": legacy,
                }
                yield board.model_copy(update=_lengths(board, kind) | counts)


def _lengths(board, kind):
    """Return the keys of a type's lengths: as described where they are of that type, else of a pitch of 1."""
    if (kind == "charuco") == (board.type == "charuco") and board.type != "chessboard":
        return {}
    if kind == "charuco":
        return {"type": kind, "square_m": 1.0, "marker_m": 0.75, "gap_m": None}
    return {"type": kind, "square_m": None, "marker_m": 0.8, "gap_m": 0.2}


def marker_share(views, board):
    """Return (a marker's side over the pitch as photographs show it, across and down (2,), that side in pixels); None where too
    few tell it.

    views as of ``rows_shown``
    """
    lay, sides, sides_px = layout(board), [], []
    for seen, _ in views:
        H, off = placed(seen, lay)
        for quad in (seen[i] for i, d in off.items() if d < IN_PLACE):
            a, b, c, d = cv2.perspectiveTransform(quad[None], H)[0]
            sides.append([np.linalg.norm([b - a, c - d], axis=1).mean(), np.linalg.norm([d - a, c - b], axis=1).mean()])
            sides_px.append(np.linalg.norm(quad - np.roll(quad, 1, axis=0), axis=1).mean())
    return (np.median(sides, axis=0), np.median(sides_px)) if len(sides) >= MIN_IN_PLACE else None
