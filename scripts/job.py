"""What every script shares: atomic writes, seeds from names, the log, and an end without a traceback for bad input."""

import contextlib
import hashlib
import logging
import os
import sys
import tempfile
from pathlib import Path

from rig.errors import InputError

log = logging.getLogger("twingap")


def seed_of(*names):
    """Return a 64-bit seed that depends on the names alone."""
    return int.from_bytes(hashlib.sha256("\x1f".join(map(str, names)).encode()).digest()[:8], "big")


@contextlib.contextmanager
def write_atomically(path, mode="w", **kwargs):
    """Open a temporary file beside ``path`` for writing; rename it to ``path`` when the block ends without error."""
    path = Path(path)
    path.parent.mkdir(parents=True, exist_ok=True)
    if "b" not in mode:
        kwargs = {"encoding": "utf-8", "newline": "\n"} | kwargs
    fd, temporary = tempfile.mkstemp(dir=path.parent, prefix=f".{path.name}.", suffix=path.suffix)
    try:
        with os.fdopen(fd, mode, **kwargs) as file:
            yield file
        umask = os.umask(0)
        os.umask(umask)
        os.chmod(temporary, 0o666 & ~umask)
        os.replace(temporary, path)
    except BaseException:
        with contextlib.suppress(FileNotFoundError):
            os.unlink(temporary)
        raise


def set_up_log(log_file=None):
    """Send the program's log to stderr and, where given, to ``log_file``."""
    handlers = [logging.StreamHandler(sys.stderr)]
    if log_file:
        Path(log_file).parent.mkdir(parents=True, exist_ok=True)
        handlers.append(logging.FileHandler(log_file, mode="w"))
    logging.basicConfig(level=logging.INFO, format="%(message)s", handlers=handlers, force=True)


@contextlib.contextmanager
def one_message():
    """Turn bad input and a full disk into one logged line and exit status 1; let true bugs keep their traceback."""
    try:
        yield
    except InputError as error:
        log.error("error: %s", error)
        raise SystemExit(1) from None
    except OSError as error:
        if error.errno is None:
            raise
        log.error("error: %s: %s", error.filename or "file system", error.strerror)
        raise SystemExit(1) from None


def run(function, snakemake, **arguments):
    """Run a rule's function with the rule's log and the one-message ending."""
    set_up_log(snakemake.log[0] if snakemake.log else None)
    with one_message():
        function(**arguments)
