"""What every script shares: atomic writes, seeds from names, the log, and an end without a traceback."""

import contextlib
import hashlib
import logging
import math
import os
import sys
import tempfile
from pathlib import Path

from rig.errors import InputError

log = logging.getLogger("twingap")

UNFINISHED = ".unfinished."  # begins the name of what is being written: a killed job may leave it


def seed_of(*names):
    """Return a 64-bit seed that depends on the names alone."""
    return int.from_bytes(hashlib.sha256("\x1f".join(map(str, names)).encode()).digest()[:8], "big")


def clean(value):
    """Return a value that JSON can hold: NaN and infinity become null."""
    if isinstance(value, float):
        return value if math.isfinite(value) else None
    if isinstance(value, dict):
        return {k: clean(v) for k, v in value.items()}
    if isinstance(value, list | tuple):
        return [clean(v) for v in value]
    return value


@contextlib.contextmanager
def write_atomically(path, mode="w", **kwargs):
    """Open a temporary file beside ``path`` for writing; rename it to ``path`` when the block ends without error."""
    path = Path(path)
    path.parent.mkdir(parents=True, exist_ok=True)
    if "b" not in mode:
        kwargs = {"encoding": "utf-8", "newline": "\n"} | kwargs
    temporary = None
    try:
        fd, temporary = tempfile.mkstemp(dir=path.parent, prefix=f"{UNFINISHED}{path.name}.", suffix=path.suffix)
        with os.fdopen(fd, mode, **kwargs) as file:
            yield file
        umask = os.umask(0)
        os.umask(umask)
        os.chmod(temporary, 0o666 & ~umask)
        os.replace(temporary, path)
    except BaseException as error:
        if temporary:
            with contextlib.suppress(FileNotFoundError):
                os.unlink(temporary)
        if isinstance(error, OSError) and (error.filename is None or UNFINISHED in str(error.filename)):
            error.filename = str(path)  # a full disk is told by the file that it has no room for
        raise


def set_up_log(log_file=None):
    """Send the program's log to stderr and, where given, to ``log_file``."""
    handlers = [logging.StreamHandler(sys.stderr)]
    if log_file:
        Path(log_file).parent.mkdir(parents=True, exist_ok=True)
        handlers.append(logging.FileHandler(log_file, mode="w"))
    logging.raiseExceptions = False  # a log that can't be written, on a full disk, is no reason for a traceback
    logging.basicConfig(level=logging.INFO, format="%(message)s", handlers=handlers, force=True)


@contextlib.contextmanager
def one_message():
    """Turn bad input, a full disk and a closed pipe into one logged line and exit status 1; true bugs keep their traceback."""
    try:
        yield
        sys.stdout.flush()
    except InputError as error:
        log.error("error: %s", error)
        raise SystemExit(1) from None
    except BrokenPipeError:
        log.error("error: standard output: what reads it has closed it")
        raise SystemExit(1) from None
    except OSError as error:
        if error.errno is None:
            raise
        log.error("error: %s: %s", error.filename or "file system", error.strerror)
        raise SystemExit(1) from None
    finally:
        drop_what_nobody_reads()


def drop_what_nobody_reads():
    """Empty standard output's buffer where its pipe is closed: the interpreter would flush it again, with a traceback."""
    try:
        sys.stdout.flush()
    except BrokenPipeError:
        nowhere = os.open(os.devnull, os.O_WRONLY)
        os.dup2(nowhere, sys.stdout.fileno())
        os.close(nowhere)


def run(function, snakemake, **arguments):
    """Run a rule's function with the rule's log and the one-message ending."""
    set_up_log(snakemake.log[0] if snakemake.log else None)
    with one_message():
        function(**arguments)
