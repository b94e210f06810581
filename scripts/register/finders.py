"""What images show of a rig: its markers, or the points of its board by the finder to trust."""

from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from functools import partial

import cv2
import numpy as np

from detectors import contract
from markers.contract import marker_corners_world, opencv_dictionary
from register import boards, calibration
from register.board_checks import only_fitting

USUAL, SECTORS = 0, 1  # places of finders
SECTORS_ARE_BETTER = 0.6  # the usual chessboard finder stays unless the other nearly halves the residual
MAX_COMPARED = 8  # photographs in which both look: that of sectors takes twenty times as long


@dataclass
class Markers:
    """The rig's markers in one image: corners (n, 4, 3) in the world and (n, 4, 2) in pixels, sides (n,) in m."""

    world: np.ndarray
    pixels: np.ndarray
    sides_m: np.ndarray

    def __len__(self):
        """Return the number of markers."""
        return len(self.sides_m)

    def select(self, which):
        """Return some of the markers, by a bool array."""
        return Markers(self.world[which], self.pixels[which], self.sides_m[which])


def marker_finder(markers):
    """Return a function of an image that returns the Markers of the rig's table seen in it.

    OpenCV, sub-pixel; families that it does not read by the detectors of detectors.contract.finders_of.
    """
    parameters = cv2.aruco.DetectorParameters()
    parameters.cornerRefinementMethod = cv2.aruco.CORNER_REFINE_SUBPIX
    others = contract.finders_of(markers.dictionary)
    rigs = []
    for name, rows in markers.groupby("dictionary", sort=True):
        if name in others:
            see = _by_contract(contract.make(others[name], [name]))
        else:
            see = _by_opencv(cv2.aruco.ArucoDetector(opencv_dictionary(name), parameters))
        rigs.append((see, {m.id: m for m in rows.itertuples()}))

    def find(image):
        grey = boards.grey_8bit(image)
        world, pixels, sides = [], [], []
        for see, known in rigs:
            for quad, marker in see(grey):
                if marker in known:
                    world.append(marker_corners_world(known[marker]))
                    pixels.append(quad.reshape(4, 2))
                    sides.append(known[marker].code_m)
        return Markers(np.reshape(world, (-1, 4, 3)), np.reshape(pixels, (-1, 4, 2)).astype(float), np.array(sides))

    return find


def _by_opencv(detector):
    """Return a function of a grey image that returns [(corners (4, 2), id)] by a cv2.aruco.ArucoDetector."""

    def see(grey):
        quads, ids, _ = detector.detectMarkers(grey)
        return list(zip(quads, [] if ids is None else np.ravel(ids), strict=True))

    return see


def _by_contract(detector):
    """Return a function of a grey image that returns [(corners (4, 2), id)] by a detector of detectors.contract."""
    return lambda grey: [(d.corners, d.id) for d in detector.detect(grey)]


def board_finders(board):
    """Return functions of an image that return its BoardPoints: one, for a chessboard two, in USUAL's and SECTORS' places."""
    finders = [boards.find_board]
    if board.type == "chessboard":
        finders.append(boards.find_chessboard_by_sectors)
    return [partial(find, board=board) for find in finders]


def first_look(names, board):
    """Return a function of a name and its image that returns BoardPoints by each finder: in MAX_COMPARED of the names,
    spread over them, in the others by the usual one alone.
    """
    usual, *others = board_finders(board)
    places = np.linspace(0, len(names) - 1, min(len(names), MAX_COMPARED)).round().astype(int)
    compared = {names[k] for k in places}
    return lambda name, image: [usual(image), *(find(image) for find in others if name in compared)]


def by_trusted_finder(found, open_image, board, size, messages, threads=1):
    """Return (number of the finder to trust, {name: BoardPoints} by it) of what ``first_look`` found, {name: [BoardPoints]}.

    open_image is a function of a name: where that of sectors seems better it looks at the other images as well.
    """
    finders = board_finders(board)
    compared = {name: points for name, points in found.items() if len(points) == len(finders)}
    if len(finders) == 1 or trusted_finder(compared, size, []) == USUAL:
        return USUAL, by_finder(found, USUAL)
    rest = [name for name in found if name not in compared]
    with ThreadPoolExecutor(threads) as pool:
        seen = dict(zip(rest, pool.map(lambda name: finders[SECTORS](open_image(name)), rest), strict=True))
    every = {name: compared.get(name) or [points[USUAL], seen[name]] for name, points in found.items()}
    number = trusted_finder(every, size, messages)
    return number, by_finder(every, number)


def usable_views(found):
    """Return the BoardPoints of {name: BoardPoints} with enough points to be a view."""
    return {k: v for k, v in found.items() if len(v.image) >= boards.MIN_POINTS}


def views_of_markers(seen):
    """Return {capture: BoardPoints} of {capture: Markers}, for the fit of unknown intrinsics."""
    return usable_views(
        {k: boards.BoardPoints(m.world.reshape(-1, 3), m.pixels.reshape(-1, 2), len(m)) for k, m in seen.items()}
    )


def trusted_finder(found, size, messages):
    """Return the number of the finder to trust, USUAL or SECTORS, of {name: [BoardPoints by each finder]}.

    The sector-based chessboard finder is taken where it sees as many boards and nearly halves the residual, or the usual one sees
    too few for one.
    """
    views = [usable_views(by_finder(found, k)) for k in (USUAL, SECTORS)]
    seen = [len(v) for v in views]
    if seen[SECTORS] < max(seen[USUAL], calibration.MIN_VIEWS):
        return USUAL
    if seen[USUAL] < calibration.MIN_VIEWS:
        messages.append(f"sector-based chessboard finder: it sees {seen[SECTORS]} boards, the usual one {seen[USUAL]}")
        return SECTORS
    rms = [calibration.calibrate(v, size, calibration.MODELS["5"])["rms_px"] for v in views]
    if rms[SECTORS] >= SECTORS_ARE_BETTER * rms[USUAL]:
        return USUAL
    messages.append(f"sector-based chessboard finder: residual {rms[SECTORS]:.3f} px instead of {rms[USUAL]:.3f} px")
    return SECTORS


def by_finder(found, number):
    """Return {name: BoardPoints} of one finder, from {name: [BoardPoints by each finder]}."""
    return {name: points[number] for name, points in found.items()}


def board_views(found, board, images, where, messages):
    """Return {name: BoardPoints} without those that lie otherwise than on the board; wrong colours are said, a wrong legacy
    flag raises InputError.

    images  iterable over the images, opened again only where no board is found
    where   file and key of the board's description, for messages
    """
    points = only_fitting(found, board, messages)
    views = usable_views(points)
    if not views:
        boards.check_legacy_pattern(images, board, where)
        messages.append(f"{where}: no image shows the board")
    inverted = sum(v.inverted for v in views.values())
    if inverted:
        messages.append(
            f"{where}: black and white are swapped in {inverted} of {len(views)} images, whichever way the board is turned"
        )
    return points


def is_inverted(views):
    """Return whether most of the BoardPoints {name: BoardPoints} show black and white swapped."""
    return 2 * sum(v.inverted for v in views.values()) > len(views)


def save_points(file, found, finder):
    """Write the BoardPoints of captures, in order, to an open npz file; NaN where a point is not seen.

    ``finder`` is the number of the finder that found them.
    """
    points, index = np.unique(np.concatenate([v.board for v in found]).round(9), axis=0, return_inverse=True)
    pixels = np.full((len(found), len(points), 2), np.nan)
    first = 0
    for k, view in enumerate(found):
        pixels[k, index.ravel()[first : first + len(view.image)]] = view.image
        first += len(view.image)
    np.savez_compressed(file, points=points, pixels=pixels, finder=finder)
