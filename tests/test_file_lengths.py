"""No file of Python or of rules is too long to be read in one go."""

import pytest

from workflow_runs import PROJECT

MAX_LINES = 400


def too_long(project):
    """Return the files (relative paths) of Python in scripts/, notebooks/ and tests/, and of rules, of over MAX_LINES lines."""
    files = [path for folder in ("scripts", "notebooks", "tests") for path in (project / folder).rglob("*.py")]
    files += [project / "Snakefile", *(project / "rules").rglob("*.smk")]
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
    """Fails if lines are miscounted by one, or a folder or the Snakefile is left out."""
    files = ("scripts/gap/long.py", "notebooks/long.py", "tests/rig/long.py", "rules/long.smk", "Snakefile")
    for file in files:
        (tmp_path / file).parent.mkdir(parents=True, exist_ok=True)
        (tmp_path / file).write_text("pass\n" * lines)
    assert too_long(tmp_path) == (set() if lines == MAX_LINES else set(files))
