"""No Python file is too long to be read in one go."""

import pytest

from workflow_runs import PROJECT

MAX_LINES = 400


def too_long(project):
    """Return the Python files (relative paths) of scripts/, notebooks/ and tests/ with more than MAX_LINES lines."""
    files = [path for folder in ("scripts", "notebooks", "tests") for path in (project / folder).rglob("*.py")]
    return {
        path.relative_to(project).as_posix()
        for path in files
        if len(path.read_text(encoding="utf-8").splitlines()) > MAX_LINES
    }


def test_no_file_has_more_lines_than_one_can_read():
    """Fails if a file grows beyond the limit instead of being split by what it is about."""
    assert too_long(PROJECT) == set()


@pytest.mark.parametrize("lines", [MAX_LINES, MAX_LINES + 1])
def test_a_file_is_too_long_from_the_first_line_beyond_the_limit(tmp_path, lines):
    """Fails if lines are miscounted by one, or a folder is left out."""
    for folder in ("scripts/gap", "notebooks", "tests/rig"):
        (tmp_path / folder).mkdir(parents=True)
        (tmp_path / folder / "long.py").write_text("pass\n" * lines)
    assert len(too_long(tmp_path)) == (0 if lines == MAX_LINES else 3)
