"""Make a PDF to print, A4 and letter: a calibration board, or the plates of a rig, at true scale and with a ruler.

    python scripts/print_board.py charuco --columns 7 --rows 10 --square-mm 25 --out prints/board.pdf
    python scripts/print_board.py chessboard --columns 6 --rows 9 --square-mm 25     (inner corners)
    python scripts/print_board.py aruco_grid --columns 4 --rows 5 --marker-mm 35 --gap-mm 5
    python scripts/print_board.py rig config/rigs/ladders.yaml --out prints/plates.pdf
    python scripts/print_board.py markers FOLDER/markers.csv

Writes OUT_a4.pdf and OUT_letter.pdf; --paper chooses one.
"""

import argparse
import logging
from pathlib import Path

from pydantic import ValidationError

import job
from inputs.campaign import CalibrationBoard, read_markers
from inputs.experiment import rig_markers
from inputs.safe_yaml import validation_message
from markers.contract import marker_plate
from print_pages import PAPERS, board_pages, plate_pages
from rig.errors import InputError
from rig.targets import target_plate

log = logging.getLogger("twingap")

BOARDS = ("charuco", "chessboard", "aruco_grid", "apriltag_grid")
DEFAULTS = {
    "charuco": {"dictionary": "DICT_5X5_100", "columns": 7, "rows": 10, "square_mm": 25.0},
    "chessboard": {"columns": 6, "rows": 9, "square_mm": 25.0},
    "aruco_grid": {"dictionary": "DICT_5X5_100", "columns": 4, "rows": 5, "marker_mm": 38.0, "gap_mm": 8.0},
    "apriltag_grid": {"dictionary": "DICT_APRILTAG_36h11", "columns": 4, "rows": 5, "marker_mm": 38.0, "gap_mm": 8.0},
}
MARKER_SHARE = 0.75  # of a ChArUco board's square


def board_of(kind, given):
    """Return the inputs.campaign.CalibrationBoard of a kind with what was given (dict, None where nothing was)."""
    values = DEFAULTS[kind] | {k: v for k, v in given.items() if v is not None}
    if kind == "charuco":
        values.setdefault("marker_mm", MARKER_SHARE * values["square_mm"])
    lengths = {k.replace("_mm", "_m"): round(v / 1000, 9) for k, v in values.items() if k.endswith("_mm")}
    others = {k: v for k, v in values.items() if not k.endswith("_mm")}
    try:
        return CalibrationBoard.model_validate({"type": kind} | others | lengths)
    except ValidationError as error:
        raise InputError(validation_message(kind, error, CalibrationBoard)) from None
    except ValueError as error:
        raise InputError(f"{kind}: {error}") from None


def described(board):
    """Return what a board is, in one sentence."""
    mm = {k: f"{1000 * v:g} mm" for k, v in board.model_dump().items() if k.endswith("_m") and v is not None}
    counts = f"{board.columns} x {board.rows}"
    if board.type == "chessboard":
        return f"Chessboard, {counts} inner corners, squares {mm['square_m']}."
    if board.type == "charuco":
        legacy = ", legacy pattern" if board.legacy_pattern else ""
        return f"ChArUco, {board.dictionary}, {counts} squares of {mm['square_m']}, markers {mm['marker_m']}{legacy}."
    return f"{board.type}, {board.dictionary}, {counts} markers of {mm['marker_m']}, gaps {mm['gap_m']}."


def size_of(board):
    """Return the (width, height) of a board's print, millimetres, without the white round it."""
    if board.type == "chessboard":
        return 1000 * board.square_m * (board.columns + 1), 1000 * board.square_m * (board.rows + 1)
    if board.type == "charuco":
        return 1000 * board.square_m * board.columns, 1000 * board.square_m * board.rows
    pitch = board.marker_m + board.gap_m
    return tuple(1000 * (n * pitch - board.gap_m) for n in (board.columns, board.rows))


def print_board(board, out, papers):
    """Write an inputs.campaign.CalibrationBoard to OUT_PAPER.pdf of each paper."""
    plate = target_plate(board)
    _write({paper: board_pages(plate, size_of(board), described(board), paper) for paper in papers}, out)


def print_markers(markers, title, out, papers):
    """Write the plates of a markers' table, to be cut out, to OUT_PAPER.pdf of each paper."""
    sizes = sorted({round(1000 * size, 6) for size in markers.plate_m})
    plates = []
    for marker in markers.itertuples():
        flat = marker._replace(**dict.fromkeys(("x", "y", "z", "rx", "ry", "rz"), 0.0))
        plates.append((marker_plate(flat), f"{marker.dictionary} {marker.id}, code {1000 * marker.code_m:g} mm"))
    dictionaries = ", ".join(dict.fromkeys(markers.dictionary))
    description = f"{title}: {len(plates)} plates of {' and '.join(f'{s:g}' for s in sizes)} mm, {dictionaries}."
    _write({paper: plate_pages(plates, sizes[-1], description, paper) for paper in papers}, out)


def _write(documents, out):
    out = Path(out)
    if out.suffix.lower() != ".pdf":
        raise InputError(f"--out {out}: a name that ends in .pdf is needed")
    for paper, data in documents.items():
        path = out.with_name(f"{out.stem}_{paper}.pdf")
        with job.write_atomically(path, "wb") as file:
            file.write(data)
        log.info("%s", path)


def main(arguments=None):
    """Read the command line."""
    parser = argparse.ArgumentParser(description="Make a PDF to print: a calibration board or a rig's plates.")
    kinds = parser.add_subparsers(dest="kind", required=True)
    for kind in BOARDS:
        one = kinds.add_parser(kind)
        for name, type_ in (("columns", int), ("rows", int)):
            one.add_argument(f"--{name}", type=type_)
        lengths = {"charuco": ("square", "marker"), "chessboard": ("square",)}.get(kind, ("marker", "gap"))
        for name in lengths:
            one.add_argument(f"--{name}-mm", type=float)
        if kind != "chessboard":
            one.add_argument("--dictionary", help="OpenCV's name")
        if kind == "charuco":
            one.add_argument("--legacy-pattern", action="store_true", default=None, help="as before OpenCV 4.6")
    for kind, what in (("rig", "a rig's file (config/rigs)"), ("markers", "a campaign's markers.csv")):
        kinds.add_parser(kind).add_argument("file", help=what)
    for one in kinds.choices.values():
        one.add_argument("--out", default="prints/board.pdf", help="OUT_a4.pdf and OUT_letter.pdf are written")
        one.add_argument("--paper", choices=PAPERS, help="only this one")
    given = vars(parser.parse_args(arguments))
    kind, out, paper = (given.pop(key) for key in ("kind", "out", "paper"))
    papers = [paper] if paper else list(PAPERS)
    job.set_up_log()
    with job.one_message():
        if kind in BOARDS:
            print_board(board_of(kind, given), out, papers)
        else:
            read = rig_markers if kind == "rig" else read_markers
            title = Path(given["file"]).stem.encode("utf-8", "backslashreplace").decode()  # names need not be UTF-8
            print_markers(read(Path(given["file"])), title, out, papers)


if __name__ == "__main__":
    main()
