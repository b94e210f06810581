"""Whether photographs show the board that is described, and if not, what they show instead: said in one line."""

import cv2
import numpy as np

from register import board_counts, boards, chessboard_counts
from register.calibration import MIN_VIEWS, matrix_of
from register.registration import pose_from_plane
from rig.board_markers import board_markers
from rig.errors import InputError

MIN_PHOTOGRAPHS = 6  # for a verdict: half of them judge what the others have fitted
MAX_OFF_SQUARES = 0.5  # a wide lens moves corners of the right board by up to 0.2, another layout by more than 1
MIN_TILT_DEG, MAX_FOCAL_SE = 5.0, 0.05  # of the most tilted view; standard error over focal length
MAX_TRIED, MAX_SIDE_PX, MIN_MARKERS, MAX_NAMES = 3, 2000, 4, 5
MAX_COUNTED = 24  # photographs in which a board's markers are counted
MAX_EDGE_PX, WINDOW_PX = 4.5, 31  # sharp photographs have 2 to 2.5; a Gaussian of sigma px has 2.5 sigma
FAMILIES = (
    "DICT_4X4", "DICT_5X5", "DICT_6X6", "DICT_7X7", "DICT_ARUCO_ORIGINAL", "DICT_ARUCO_MIP_36h12", "DICT_APRILTAG_16h5",
    "DICT_APRILTAG_25h9", "DICT_APRILTAG_36h10", "DICT_APRILTAG_36h11",
)  # fmt: skip
SIZES = (50, 100, 250, 1000)  # of those that are named by their bits; the smaller are the beginning of the larger


def fits(points, board):
    """Return whether BoardPoints are enough, and lie as on one plane that shows an inputs.campaign.CalibrationBoard."""
    if len(points.image) < boards.MIN_POINTS:
        return False
    side = board.square_m or board.marker_m + board.gap_m
    flat = points.board[:, :2]
    H, _ = cv2.findHomography(points.image, flat)  # metres, so that a square counts the same near and far
    if H is None:
        return False
    off = cv2.perspectiveTransform(points.image[None], H)[0] - flat
    return bool(np.median(np.linalg.norm(off, axis=1)) < MAX_OFF_SQUARES * side)


def only_fitting(found, board, messages):
    """Return {name: BoardPoints} with those emptied whose markers lie otherwise than on the board."""
    wrong = [name for name, v in found.items() if len(v.image) >= boards.MIN_POINTS and not fits(v, board)]
    if wrong:
        messages.append(f"the markers lie otherwise than on the described board in {listed(wrong)}: not used")
    return {name: boards.nothing_found(v.markers) if name in wrong else v for name, v in found.items()}


def listed(names):
    """Return the first of some names, and how many more there are."""
    more = f" and {len(names) - MAX_NAMES} more" if len(names) > MAX_NAMES else ""
    return ", ".join(names[:MAX_NAMES]) + more


def check_photographs(found, board, open_image, where, least=MIN_PHOTOGRAPHS):
    """Raise InputError where fewer than ``least`` show the board, or all show one of other rows or markers of another size; it
    says what they show instead.

    found       {name: BoardPoints}
    open_image  function of a name that returns the image
    where       file and key of the board's description, for messages
    """
    without = [name for name, v in found.items() if not fits(v, board)]
    usable = len(found) - len(without)
    if usable >= least:
        shown = {name: v for name, v in found.items() if name not in without}
        if board.type == "chessboard":
            check_squares(shown, board, open_image, where)
        else:
            check_markers(list(shown), board, open_image, where)
        return
    images = [_searchable(open_image(name)) for name in without[:MAX_TRIED]]
    why = what_is_shown(images, board) if images else None
    if why:
        raise InputError(f"{where}: {why}")
    count = f"{usable} of {len(found)} photographs show the board" if without else f"{usable} photographs"
    missing = f" (not found in {listed(without)})" if usable and without else ""
    other_print = (
        f"compare the print with the description, {_in_words(board)}, and look whether it is sharp and in view"
    )
    advice = None if usable else other_print
    raise InputError(f"{where}: {count}{missing}, and {what_it_takes(usable, least, advice)}")


def what_it_takes(usable, least, advice=None):
    """Return how many photographs are needed, ``least``, and what to do where fewer are usable, more of them where not told."""
    purpose = {MIN_PHOTOGRAPHS: "a verdict", MIN_VIEWS: "a calibration"}.get(least, "a comparison")
    more = f"take {least - usable} more, sharp, with the whole board in view and from different sides"
    return f"{purpose} takes {least}: {advice or more}"


def check_markers(names, board, open_image, where):
    """Raise InputError where photographs that show a board's points show more or fewer rows of markers, or other markers.

    names  of the photographs; open_image and where as of ``check_photographs``
    """
    some = names[:: -(-len(names) // MAX_COUNTED)]
    views = board_counts.views_of(map(open_searchable(open_image), some), board.dictionary)
    why = _wrong_size(views, board) or _wrong_rows(views, board)
    if why and len(some) < len(names):  # what is covered in some may be seen in others
        views = board_counts.views_of(map(open_searchable(open_image), names), board.dictionary)
        why = _wrong_size(views, board) or _wrong_rows(views, board)
    if why:
        raise InputError(f"{where}: {why}")


def check_squares(found, board, open_image, where):
    """Raise InputError where a chessboard has more squares than described, or markers in its squares.

    found  {name: BoardPoints} of photographs that show the described corners; others as of ``check_photographs``
    """
    some = list(found)[:MIN_PHOTOGRAPHS]
    columns, rows = chessboard_counts.more_squares(
        [(boards.grey_8bit(open_image(name)), found[name]) for name in some], board
    )
    images = list(map(open_searchable(open_image), some[:MAX_TRIED]))
    why = _markers_in_squares(images, board)
    if not why and columns + rows:
        why = (
            f"the chessboard goes on beyond {board.columns} columns and {board.rows} rows of inner corners: count them again, "
            f"there are at least {board.columns + columns} columns and {board.rows + rows} rows"
        )
    if why:
        raise InputError(f"{where}: {why}")


def _markers_in_squares(images, board):
    """Return that grey images of a described chessboard show a board of markers, None where not."""
    for name in map(_largest, FAMILIES):
        views = board_counts.views_of(images, name)
        if sum(len(seen) for seen, _ in views) >= MIN_MARKERS * len(images):
            other = board_counts.other_layout(views, board.model_copy(update={"dictionary": name}))
            if other:
                last = max(board_counts.layout(other).places)
                return _other_board(other.model_copy(update={"dictionary": _smallest(name, last)}), board)
    return None


def open_searchable(open_image):
    """Return a function of a name that returns its image, grey and not too large for finders."""
    return lambda name: _searchable(open_image(name))


def _wrong_rows(views, board):
    """Return that photographs (as of register.board_counts) show other rows of markers than described, None where not."""
    rows = board_counts.rows_shown(views, board)
    if rows > board.rows:
        return f"the board's markers go on below the last of the described {board.rows} rows: write rows: {rows}"
    if rows < board.rows:
        return (
            f"no photograph shows a marker below row {rows}, though the place of row {rows + 1} is in view: write "
            f"rows: {rows}, or uncover the board's other rows, as all {board.rows} are compared with the photographs"
        )
    return None


def _wrong_size(views, board):
    """Return that the markers of photographs (as of register.board_counts) have another size or shape than described."""
    described, found = board.marker_m / board_counts.pitch_m(board), board_counts.marker_share(views, board)
    if found is None:
        return None
    shown, side_px = found
    if (np.abs(shown / described - 1) < max(board_counts.MAX_SHARE_OFF, board_counts.MAX_SIDE_OFF_PX / side_px)).all():
        return None
    if max(shown) > 1.2 * min(shown):
        other = board_counts.other_layout(views[:MAX_TRIED], board)
        return (other and _other_board(other, board)) or (
            f"the photographs show markers {shown[0]:.2f} of their distance wide and {shown[1]:.2f} high, and the description "
            f"({_in_words(board)}) means squares: compare its type, columns and rows with the print"
        )
    share, key = shown.mean(), "square_m" if board.type == "charuco" else "gap_m"
    pitch_m = board.marker_m / share
    fits_marker = pitch_m if key == "square_m" else pitch_m - board.marker_m
    return (
        f"a marker's side is {share:.2f} of the distance from one {'square' if key == 'square_m' else 'marker'} to the next in "
        f"the photographs, and {described:.2f} in the description: measure both on the print; if marker_m: {board.marker_m:g} "
        f"is right, {key} is {max(fits_marker, 0):.3g}"
    )


def _other_board(other, board):
    """Return what photographs show, a board of other counts, type or pattern, and what to write; None if it is the same."""
    write = f"write columns: {other.columns}, rows: {other.rows}"
    if other.type != board.type and {other.type, board.type} & {"charuco", "chessboard"}:
        kind = "a ChArUco board" if other.type == "charuco" else "a grid of markers"
        pattern = f", legacy_pattern: {_yaml(other)}" if other.type == "charuco" else ""
        lengths = "square_m and marker_m" if other.type == "charuco" else "marker_m and gap_m"
        return (
            f"the photographs show {kind}: write type: {other.type}, dictionary: {other.dictionary}, "
            f"columns: {other.columns}, rows: {other.rows}{pattern}, and {lengths} as measured on the print"
        )
    if other.legacy_pattern != board.legacy_pattern and other.rows % 2 == 0:
        return f"the photographs show another board: {write}, legacy_pattern: {_yaml(other)}"
    if (other.columns, other.rows) == (board.columns, board.rows):
        return None
    if (other.columns, other.rows) == (board.rows, board.columns):
        return f"the photographs show the board with columns and rows swapped: {write}"
    if board.type == "charuco" and (other.columns, other.rows) == (board.columns + 1, board.rows + 1):
        return f"a ChArUco board's columns and rows count its squares, not inner corners: {write}"
    shown = f"the photographs show a board of {other.columns} columns and {other.rows} rows"
    return f"{shown}, not {board.columns} and {board.rows}: {write}"


def check_tilt(views, fit, where, focal_px=None):
    """Raise InputError where views ({name: BoardPoints}) are all from one side, so that the focal length can't be told.

    A flat board seen straight on is as large from half the distance with half the focal length.
    fit       calibration of the views with distortion, as of register.calibration.calibrate
    focal_px  what the photographs' EXIF says, or None
    """
    K, focal = matrix_of(fit), fit["parameters"]["fx"]
    if focal > 0:
        normals = [pose_from_plane(v.board, v.image, K)[2, 2] for v in views.values()]
        tilt_deg = float(np.degrees(np.arccos(np.clip(np.abs(normals), 0, 1))).max())
        if tilt_deg >= MIN_TILT_DEG and fit["se"]["fx"] < MAX_FOCAL_SE * focal:
            return
    hint = f" (EXIF means fx = fy = {focal_px:.0f})" if focal_px else ""
    raise InputError(
        f"{where}: all photographs are from one side, straight on, so that the focal length can't be told; take some with "
        f"the board tilted by 20 to 45 degrees, to either side and up and down, or write fx, fy, cx and cy{hint}"
    )


def _in_words(board):
    kind = f"{board.type}, {board.columns} columns, {board.rows} rows"
    return kind if board.type == "chessboard" else f"{kind}, {board.dictionary}"


def _searchable(image):
    """Return a grey image (H, W) uint8, large ones shrunk: finders that find nothing take long."""
    grey = boards.grey_8bit(image)
    factor = MAX_SIDE_PX / max(grey.shape)
    return cv2.resize(grey, None, fx=factor, fy=factor, interpolation=cv2.INTER_AREA) if factor < 1 else grey


def what_is_shown(images, board):
    """Return what grey images show in place of the board, and what to do; None where that is not known."""
    if board.type == "chessboard":
        why = _markers_in_squares(images, board) or _other_squares(images, board)
    else:
        other = board_counts.other_layout(board_counts.views_of(images, board.dictionary), board)
        why = (other and _other_board(other, board)) or _mirrored(images, board)
    if why:
        return why
    width = float(np.median([edge_width_px(image) for image in images]))
    if MAX_EDGE_PX < width < np.inf:
        return (
            f"the photographs are too blurred: even their sharpest edges are {width:.0f} pixels wide; hold the camera still, "
            "let it focus, and give it light"
        )
    return None if board.type == "chessboard" else _other_markers(images, board)


def _most_fit(found, board):
    """Return whether more than half of BoardPoints show a board."""
    return 2 * sum(fits(points, board) for points in found) > len(found)


def _other_squares(images, board):
    """Return that grey images show a chessboard of other counts than described, and what to write; None where not."""
    for columns, rows in chessboard_counts.counts_shown(images, board):
        other = board.model_copy(update={"columns": columns, "rows": rows})
        if not _most_fit([boards.find_board(image, other) for image in images], other):
            continue
        write = f"write columns: {columns}, rows: {rows}"
        if (columns + 1, rows + 1) == (board.columns, board.rows):
            return f"a chessboard's columns and rows count its inner corners, not its squares: {write}"
        shown = f"the photographs show a chessboard of {columns} columns and {rows} rows of inner corners"
        return f"{shown}, not {board.columns} and {board.rows}: {write}"
    return None


def _mirrored(images, board):
    """Return that grey images show a board with markers mirrored, and what to do; None where not."""
    if not _most_fit([boards.find_board(np.ascontiguousarray(image[:, ::-1]), board) for image in images], board):
        return None
    mirrored = "the board is mirrored: printed from a flipped file, shown by a mirror or flipped by a program"
    return f"{mirrored}; print it again, or photograph it without any of that"


def _yaml(board):
    return str(board.legacy_pattern).lower()


def edge_width_px(grey):
    """Return how many pixels the sharpest edges of a grey image (H, W) take from black to white, in the worse direction.

    Contrast over the steepest slope, of the sharpest tenth of the windows that hold half the image's contrast; infinite
    where there is none.
    """
    grey, window = grey.astype(np.float32), np.ones((WINDOW_PX, WINDOW_PX), np.uint8)
    contrast = cv2.dilate(grey, window) - cv2.erode(grey, window)
    rich = contrast > max(np.subtract(*np.percentile(grey, (99, 1))) / 2, 1)
    if not rich.any():
        return np.inf
    slopes = [np.abs(cv2.Sobel(grey, cv2.CV_32F, *along, scale=1 / 8)) for along in ((1, 0), (0, 1))]
    widths = [contrast[rich] / np.maximum(cv2.dilate(slope, window)[rich], 1e-3) for slope in slopes]
    return max(float(np.percentile(width, 10)) for width in widths)


def _other_markers(images, board):
    """Return which markers images show that the board does not have, and what to do; None where there are few."""
    seen = {name: _ids(images, name) for name in map(_largest, FAMILIES)}
    name = max(seen, key=lambda n: len(seen[n]))
    ids, count = sorted(set(seen[name])), len(board_markers(board))
    if len(seen[name]) < MIN_MARKERS * len(images):
        return None
    if _largest(_family(board.dictionary)) != name:
        name = _smallest(name, max(ids))
        return f"the photographs show markers of {name}, not of {board.dictionary}: write dictionary: {name}"
    if ids[0] >= count:
        shown = f"the photographs show markers {ids[0]} to {ids[-1]}, but the board has 0 to {count - 1}"
        return f"{shown}: print the board that is described"
    return (
        f"the photographs show markers {ids[0]} to {ids[-1]} of the board's dictionary, but not where the description "
        f"({_in_words(board)}) has them: count columns and rows again"
    )


def _ids(images, dictionary):
    """Return the ids of all markers that some images show, one by one."""
    found = [boards.aruco_detector(dictionary).detectMarkers(image)[1] for image in images]
    return [int(i) for ids in found if ids is not None for i in np.ravel(ids)]


def _family(dictionary):
    return next((f for f in FAMILIES if dictionary.startswith(f)), dictionary)


def _largest(family):
    return f"{family}_{SIZES[-1]}" if family[-1].isdigit() and family[-2] == "X" else family


def _smallest(dictionary, last_id):
    """Return the smallest dictionary of the same codes that has an id."""
    family = _family(dictionary)
    return dictionary if _largest(family) == family else f"{family}_{next(n for n in SIZES if n > last_id)}"
