"""Find test files that lie beside the repository in ``../shared``; skip in words where they are not."""

from pathlib import Path

import pytest

SHARED = Path(__file__).resolve().parents[2] / "shared"


def shared(path):
    """Return the Path of ``../shared/<path>``, or skip the test that asked for it."""
    found = SHARED / path
    if not found.exists():
        pytest.skip(f"needs ../shared/{path}, which is not beside this repository")
    return found
