"""Tables that stages hand each other, and that people edit: what is wrong with one is said in a line."""

import pytest

from inputs import tables
from rig.errors import InputError

POSES = tables.REGISTERED.select_columns(["capture", "station", "n_markers", "rms_px"])
HEAD, ROW = "capture,station,n_markers,rms_px\n", "a,h1,3,0.1\n"


@pytest.mark.parametrize(
    ("text", "said"),
    [
        (HEAD + 3 * "a,h1,x,3,b,0.1\n", "more values than there are columns"),  # pandas makes two of them names of rows
        (HEAD + ROW + "b,h1,3,0.1,7\n", "not a CSV table"),
        (HEAD + ROW + "b,h1,many,0.1\n", "n_markers"),
        (HEAD + 2 * ROW, "capture"),
        (HEAD.strip() * 400 + "\n" + ROW, "columns; there are 4"),  # would take minutes to check
        ("", "not a CSV table"),
    ],
)
def test_a_broken_table_is_named_in_a_line(text, said, tmp_path):
    """Fails if a table that is broken is read all the same, or ends in a traceback of what reads it."""
    path = tmp_path / "poses.csv"
    path.write_text(text)
    with pytest.raises(InputError, match=said) as refused:
        tables.read_table(path, POSES)
    assert str(refused.value).startswith(str(path)) and "\n" not in str(refused.value)


def test_a_sound_table_comes_back(tmp_path):
    """Fails if a whole table is refused."""
    path = tmp_path / "poses.csv"
    path.write_text(HEAD + ROW + "b,h1,0,\n")
    assert tables.read_table(path, POSES).capture.tolist() == ["a", "b"]
