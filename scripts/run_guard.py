"""What is looked at before and after a run: can its results be written, are they of the captures that are there."""

import os
import shutil
from pathlib import Path

from job import UNFINISHED
from rig.errors import InputError

MAX_NAMES = 5


def check_writable(folder):
    """Raise InputError where a folder, one below it, or the one that it is to be made in can't be written to."""
    folder = Path(folder)
    first = next(p for p in (folder, *folder.absolute().parents) if p.exists())
    for path, _, _ in os.walk(first) if first == folder else [(first, [], [])]:
        if not os.access(path, os.W_OK | os.X_OK):
            raise InputError(f"{path}: can't be written to; make it writable, or run in another copy of the project")


def remove_unfinished(folder):
    """Remove what killed jobs left half written below a folder; nothing else may be at work there."""
    for path in Path(folder).rglob(f"{UNFINISHED}*"):
        shutil.rmtree(path, ignore_errors=True) if path.is_dir() else path.unlink(missing_ok=True)


def stamp(path):
    """Return what tells that a file was written: (bytes, nanoseconds); None where it is gone."""
    try:
        found = os.stat(path)
    except OSError:
        return None
    return found.st_size, found.st_mtime_ns


def check_unchanged(stamps):
    """Raise InputError naming the files of {path: stamp} that were written to, or are gone, since."""
    changed = [path for path, before in stamps.items() if stamp(path) != before]
    if changed:
        more = f" and {len(changed) - MAX_NAMES} more" if len(changed) > MAX_NAMES else ""
        raise InputError(
            f"{', '.join(changed[:MAX_NAMES])}{more}: written while the run was under way, so that results may mix old and "
            "new; run again with --forcerun register_captures"
        )
