"""What comes out of the printer is what the twin takes it for: rendered to pixels, detectors read it, lengths are true."""

import os
import re

import cv2
import numpy as np
import pypdfium2
import pytest

import print_board
from detectors import contract
from inputs.experiment import rig_markers
from print_pages import PAPERS, RIM_MM, RULER_MM
from register.boards import find_board
from tiny_campaign import MARKERS

DPI = 254  # ten pixels a millimetre
PX_PER_MM = DPI / 25.4
KINDS = {
    "charuco": [],
    "chessboard": [],
    "aruco_grid": [],
    "apriltag_grid": [],
    "charuco 8": ["--columns", "8", "--rows", "8", "--square-mm", "22.5", "--legacy-pattern"],
}


def pages(path):
    """Return the pages of a PDF as grey images, ten pixels a millimetre."""
    with pypdfium2.PdfDocument(path) as document:
        found = [page.render(scale=DPI / 72).to_numpy() for page in document]
    return [cv2.cvtColor(page, cv2.COLOR_BGR2GRAY) for page in found]


@pytest.mark.parametrize("paper", PAPERS)
@pytest.mark.parametrize("kind", KINDS)
def test_a_board_is_read_and_its_lengths_are_true(tmp_path, kind, paper):
    """Fails if a page is scaled, a board mirrored, or a cell of another colour than the twin's."""
    name = kind.split()[0]
    print_board.main([name, *KINDS[kind], "--out", str(tmp_path / "b.pdf")])
    (page,) = pages(tmp_path / f"b_{paper}.pdf")
    np.testing.assert_allclose(np.array(page.shape[::-1]) / PX_PER_MM, PAPERS[paper], atol=0.2)
    options = dict(zip(KINDS[kind][::2], KINDS[kind][1::2], strict=False))
    given = {k.removeprefix("--").replace("-", "_"): v for k, v in options.items()}
    given = {k: float(v) if k.endswith("mm") else int(v) for k, v in given.items()}
    board = print_board.board_of(name, given | {"legacy_pattern": True} if kind == "charuco 8" else given)
    found = find_board(page, board)
    expected = (board.columns - 1) * (board.rows - 1) if name == "charuco" else board.columns * board.rows
    assert len(found.image) == (4 if name.endswith("grid") else 1) * expected and not found.inverted
    # rigid: printed millimetres, y down, are the board's, y up, but for where they lie
    px_per_mm = np.array(page.shape[::-1]) / PAPERS[paper]  # a page is drawn on whole pixels
    printed = found.image * (1, -1) / px_per_mm
    moved = printed - printed.mean(axis=0)
    own = 1000 * (found.board[:, :2] - found.board[:, :2].mean(axis=0))
    assert np.abs(moved - own).max() < 0.06  # half a pixel; markers' corners are found to no more
    assert (moved * own).sum() / (own * own).sum() == pytest.approx(1, abs=1e-4)


def test_the_rulers_hundred_millimetres_are_a_hundred(tmp_path):
    """Fails if the ruler is not to the scale of the board: it is all that tells a fitted page from a true one."""
    print_board.main(["charuco", "--out", str(tmp_path / "b.pdf"), "--paper", "letter"])
    (page,) = pages(tmp_path / "b_letter.pdf")
    row = page[-round((RIM_MM + 2 + 3.5) * PX_PER_MM)]  # only whole centimetres are so long
    dark = np.flatnonzero(row[: round(130 * PX_PER_MM)] < 160)
    ticks = np.array([group.mean() for group in np.split(dark, np.flatnonzero(np.diff(dark) > 1) + 1)])
    np.testing.assert_allclose(np.diff(ticks) / PX_PER_MM, RULER_MM / 10, atol=0.11)
    assert (ticks[-1] - ticks[0]) / PX_PER_MM == pytest.approx(RULER_MM, abs=0.11)


def test_a_rigs_plates_are_all_there_and_of_their_size(tmp_path):
    """Fails if a plate is left out at a page's end, or a code is as large as its plate."""
    print_board.main(["rig", "config/rigs/ladders.yaml", "--out", str(tmp_path / "p.pdf"), "--paper", "a4"])
    table, found = rig_markers("config/rigs/ladders.yaml"), []
    for page in pages(tmp_path / "p_a4.pdf"):
        for name in table.dictionary.unique():
            dictionary = cv2.aruco.getPredefinedDictionary(getattr(cv2.aruco, name))
            quads, ids, _ = cv2.aruco.ArucoDetector(dictionary).detectMarkers(page)
            for quad, marker in zip(quads, [] if ids is None else ids.ravel(), strict=True):
                found.append((name, int(marker)))
                sides = np.linalg.norm(np.diff(quad[0], axis=0, append=quad[0][:1]), axis=1) / PX_PER_MM
                np.testing.assert_allclose(sides, 70, atol=0.3)
    wanted = set(zip(table.dictionary, table.id, strict=True))
    assert wanted <= set(found) and len([f for f in found if f in wanted]) == len(wanted)


def test_equal_boards_are_equal_files(tmp_path):
    """Fails if a date is written into the file: a board under version control would change at each make."""
    for name in ("a", "b"):
        print_board.main(["chessboard", "--out", str(tmp_path / f"{name}.pdf"), "--paper", "a4"])
    assert (tmp_path / "a_a4.pdf").read_bytes() == (tmp_path / "b_a4.pdf").read_bytes()


@pytest.mark.parametrize(("arguments", "message"), [
    (["charuco", "--square-mm", "30"], r"lengths of at most 0\.\d\d times as much fit"),
    (["charuco", "--dictionary", "DICT_9X9"], "unknown dictionary 'DICT_9X9'"),
    (["charuco", "--columns", "1"], "columns is '1'"),
    (["charuco", "--marker-mm", "30"], "marker_m must be less than square_m"),
    (["chessboard", "--out", "board.png"], "ends in .pdf"),
    (["rig", "none.yaml"], "no such file"),
    (["markers", "none.csv"], "no such file"),
])  # fmt: skip
def test_what_can_t_be_printed_is_one_line(tmp_path, capfd, arguments, message):
    """Fails if a user sees a traceback, or a page is left half-written."""
    if "--out" not in arguments:
        arguments = [*arguments, "--out", str(tmp_path / "b.pdf")]
    with pytest.raises(SystemExit) as end:
        print_board.main(arguments)
    said = capfd.readouterr().err
    assert end.value.code == 1 and said.count("\n") == 1
    assert re.search(message, said), said
    assert list(tmp_path.iterdir()) == []


@pytest.mark.parametrize(
    "name", ["a$b\\frac$.csv", "<script>&amp;.csv", "日本's.csv", os.fsdecode(b"\xff.csv"), "a\x1b[31m.csv"]
)
def test_a_table_of_any_name_is_printed(tmp_path, name):
    """Fails if a file's name is set as a formula, or one that is no UTF-8 ends in a traceback."""
    (tmp_path / name).write_text(MARKERS)
    print_board.main(["markers", str(tmp_path / name), "--out", str(tmp_path / "out.pdf"), "--paper", "a4"])
    assert (tmp_path / "out_a4.pdf").read_bytes().startswith(b"%PDF")


def test_plates_of_any_type_are_printed_as_they_are_drawn(tmp_path):
    """Fails if discs are left out of the print, or lie elsewhere than the tracker that reads them finds their square."""
    pytest.importorskip("stag", reason="optional extra 'trackers' is not installed")
    rows = {"STAG_HD21": ("stag", 0.07), "CIRCLES_4X11_60": ("opencv_circles", 0.08)}
    ladders = [
        f"{{dictionary: {family}, plates: 1, columns_x_m: [0.0], first_y_m: 0.3, step_y_m: 0.2, code_m: {code_m}}}"
        for family, (_, code_m) in rows.items()
    ]
    (tmp_path / "rig.yaml").write_text("ladders:\n" + "".join(f"  - {ladder}\n" for ladder in ladders))
    print_board.main(["rig", str(tmp_path / "rig.yaml"), "--out", str(tmp_path / "p.pdf"), "--paper", "a4"])
    (page,) = pages(tmp_path / "p_a4.pdf")
    for family, (tracker, code_m) in rows.items():
        (found,) = contract.make(tracker, [family]).detect(page)
        sides = np.linalg.norm(found.corners - np.roll(found.corners, 1, axis=0), axis=1)
        np.testing.assert_allclose(sides, 1000 * code_m * PX_PER_MM, rtol=0.005)
