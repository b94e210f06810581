"""A rule's folder of files, whole or not there at all: it is made aside and takes its place when it is complete."""

import contextlib
import os
import shutil
from pathlib import Path

from job import UNFINISHED


@contextlib.contextmanager
def whole_folder(out):
    """Yield a new folder (Path) beside ``out``, which takes the place of ``out`` when the block ends without error.

    What an earlier, killed process left beside ``out`` is removed: should it still be at work, it fails and mixes nothing in.
    """
    out = Path(out)
    for left in out.parent.glob(f"{UNFINISHED}{out.name}.*"):
        shutil.rmtree(left, ignore_errors=True)
    aside = out.with_name(f"{UNFINISHED}{out.name}.{os.getpid()}")
    aside.mkdir(parents=True)
    try:
        yield aside
    except BaseException as error:
        shutil.rmtree(aside, ignore_errors=True)
        if isinstance(error, OSError) and error.filename is None:
            error.filename = str(out)  # a full disk is told by the folder that it has no room for
        raise
    shutil.rmtree(out, ignore_errors=True)
    aside.rename(out)
