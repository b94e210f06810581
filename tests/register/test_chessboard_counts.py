"""Chessboards that have more squares than described, and boards of markers described as chessboards."""

import pytest

from register import boards, chessboard_counts
from register.board_checks import check_photographs
from seen_boards import photographs, refused
from shared_files import shared


@pytest.mark.parametrize(
    ("folder", "change", "words"),
    [
        ("chess_opencv_left", {"columns": 8}, "at least 9 columns and 6 rows"),
        (
            "chess_picam_640",
            {"rows": 6},
            "beyond 7 columns and 6 rows of inner corners: count them again, there are at least 7",
        ),
        (
            "charuco_lifecam_480",
            {"type": "chessboard", "columns": 7, "rows": 7},
            "type: charuco, dictionary: DICT_4X4_50",
        ),
        ("charuco_lifecam_480", {"type": "chessboard", "columns": 8, "rows": 8}, "DICT_4X4_50, columns: 8, rows: 8"),
    ],
)
def test_a_part_of_a_board_is_no_board(folder, change, words):
    """Fails if a chessboard within the board that was photographed passes, or one whose squares hold markers."""
    images, board = photographs(shared(f"real/{folder}"), 8)
    assert words in refused(images, board.model_copy(update=change))


@pytest.mark.parametrize("folder", ["chess_opencv_left", "chess_picam_640"])
def test_chessboards_as_described_pass(folder):
    """Fails if a margin or what lies round a board is taken for squares."""
    images, board = photographs(shared(f"real/{folder}"), 8)
    found = {name: boards.find_board(image, board) for name, image in images.items()}
    check_photographs(found, board, images.get, "here")
    views = [(boards.grey_8bit(images[name]), points) for name, points in found.items() if len(points.image)]
    assert chessboard_counts.more_squares(views, board) == (0, 0)


@pytest.mark.parametrize(
    ("folder", "change", "words"),
    [
        (
            "chess_opencv_left",
            {"rows": 7},
            "9 columns and 6 rows of inner corners, not 9 and 7: write columns: 9, rows: 6",
        ),
        ("chess_opencv_left", {"columns": 12, "rows": 11}, "not 12 and 11: write columns: 9, rows: 6"),
        ("chess_picam_640", {"columns": 4, "rows": 9}, "not 4 and 9: write columns: 7, rows: 7"),
        ("chess_gloworm_960", {"columns": 9, "rows": 7}, "inner corners, not its squares: write columns: 8, rows: 6"),
    ],
)
def test_squares_are_counted_where_none_are_found_as_described(folder, change, words):
    """Fails if counts that are far off end in a general line, or if a part of the board is counted for the whole."""
    images, board = photographs(shared(f"real/{folder}"), 8)
    assert words in refused(images, board.model_copy(update=change))
