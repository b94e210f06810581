"""numba's ``njit`` for all compiled code: what it keeps holds while the kernel's file *and all that it imports* are as they were.

numba itself looks at a kernel's own file alone: an edit of another file, whose kernels or numbers are compiled into it, would
go unseen, and results would be those of the code before. Of several processes that need a file's kernels at once, one
compiles them; others compile other files' meanwhile.
"""

import functools
import hashlib
import os
import re
from pathlib import Path

import numba
from filelock import FileLock
from numba.core import types
from numba.core.compiler_lock import global_compiler_lock

SCRIPTS = Path(__file__).parent
IMPORT = re.compile(r"^from ([\w.]+) import", re.MULTILINE)
LONGEST_WAIT_S = 120  # for another process that compiles: it may hang


def njit(**options):
    """Return the decorator ``numba.njit(**options)``; what it keeps on disk, where it does, is bound to all of its source.

    A division by zero gives what NumPy's does: to look for one would keep loops from doing numbers side by side.
    """

    def compiled(function):
        kernel = numba.njit(error_model="numpy", **options)(function)
        kept = getattr(kernel._cache, "_cache_file", None)
        if kept is not None:
            kept._source_stamp = kept._source_stamp, digest_of_imports(function.__code__.co_filename)
        kernel.compile = functools.partial(_one_at_a_time, function.__code__.co_filename, kernel.compile)
        return kernel

    return compiled


def _one_at_a_time(path, compile_, signature):
    """Compile a kernel of a file, or load what was kept of it, when no other process or thread does.

    For a number that a caller has written out it is the kernel that takes any: numba would compile one for each.
    """
    signature = tuple(types.unliteral(argument) for argument in signature)
    lock = _lock_of(path, os.getpid())
    with global_compiler_lock:  # first: a thread that held the file's would wait for one that compiles what calls it
        try:
            lock.acquire()
        except OSError:  # nobody may write here, or another process hangs: twice is well
            return compile_(signature)
        try:
            return compile_(signature)
        finally:
            lock.release()


@functools.cache
def _lock_of(path, _process):
    """Return a process's lock of what is kept of a file's kernels: a forked one has none of its parent's."""
    file = Path(path)
    return FileLock(file.parent / "__pycache__" / f"{file.stem}.lock", timeout=LONGEST_WAIT_S)


@functools.cache
def digest_of_imports(path):
    """Return the SHA-256 of all files of the project that a file imports, one of another, at its top level."""
    found, waiting = set(), [Path(path)]
    while waiting:
        new = set(_imported(waiting.pop())) - found
        found |= new
        waiting += new
    digest = hashlib.sha256()
    for file in sorted(found):
        digest.update(file.relative_to(SCRIPTS).as_posix().encode() + b"\0" + file.read_bytes())
    return digest.hexdigest()


@functools.cache
def _imported(path):
    """Return the project's files that a file imports from."""
    places = (SCRIPTS / name.replace(".", "/") for name in IMPORT.findall(path.read_text(encoding="utf-8")))
    files = (file for place in places for file in (place.with_suffix(".py"), place / "__init__.py"))
    return tuple(file for file in files if file.is_file() and file != Path(__file__))
