"""What numba keeps of compiled code, in processes of their own: an edit of what a kernel calls reaches it."""

import contextlib
import functools
import shutil
import subprocess
import sys
import time

import numpy as np
from filelock import FileLock

from kernels import njit
from workflow_runs import PROJECT

CALLER = """from kernels import njit
from callee import LEVEL, doubled


@njit(cache=True)
def level():
    return doubled(LEVEL)
"""
CALLEE = """from kernels import njit

LEVEL = 21


@njit(cache=True)
def doubled(x):
    return 2 * x
"""


def said(folder):
    """Return what a new process gets from the kernel, and how many times it was compiled there."""
    code = "import caller; print(caller.level(), sum(caller.level.stats.cache_misses.values()))"
    done = subprocess.run([sys.executable, "-c", code], cwd=folder, capture_output=True, text=True, check=True)
    return done.stdout.split()


def test_an_edit_of_what_a_kernel_calls_reaches_it(tmp_path):
    """Fails if a kernel that was compiled earlier still has another file's old code or numbers, or is compiled every time."""
    shutil.copy(PROJECT / "scripts/kernels.py", tmp_path)
    (tmp_path / "caller.py").write_text(CALLER)
    (tmp_path / "callee.py").write_text(CALLEE)
    assert said(tmp_path) == ["42", "1"]
    assert said(tmp_path) == ["42", "0"]
    (tmp_path / "callee.py").write_text(CALLEE.replace("2 * x", "3 * x"))
    assert said(tmp_path) == ["63", "1"]
    (tmp_path / "callee.py").write_text(CALLEE.replace("LEVEL = 21", "LEVEL = 5"))
    assert said(tmp_path) == ["10", "1"]
    assert said(tmp_path) == ["10", "0"]


def test_of_several_processes_one_compiles(tmp_path):
    """Fails if jobs that start together each compile all kernels: on few cores they wait for one another twice as long."""
    shutil.copy(PROJECT / "scripts/kernels.py", tmp_path)
    (tmp_path / "caller.py").write_text(CALLER)
    (tmp_path / "callee.py").write_text(CALLEE)
    code = (
        "import time, pathlib, caller\nwhile not pathlib.Path('go').exists(): time.sleep(0.01)\n"
        "print(caller.level(), sum(caller.level.stats.cache_misses.values()))"
    )
    together = [
        subprocess.Popen([sys.executable, "-c", code], cwd=tmp_path, stdout=subprocess.PIPE, text=True)
        for _ in range(3)
    ]
    time.sleep(5)
    (tmp_path / "go").touch()
    said = sorted(process.communicate(timeout=60)[0].split() for process in together)
    assert said == [["42", "0"], ["42", "0"], ["42", "1"]]


def test_what_another_process_compiles_keeps_no_other_file_waiting(tmp_path):
    """Fails if one lock serves all files: a job waits, a core idle, while another compiles what it has no use for."""
    shutil.copy(PROJECT / "scripts/kernels.py", tmp_path)
    (tmp_path / "callee.py").write_text(CALLEE)
    (tmp_path / "other.py").write_text(CALLEE)
    run = functools.partial(subprocess.run, cwd=tmp_path, capture_output=True, text=True, timeout=60)
    run([sys.executable, "-c", "import other; other.doubled(21)"])
    with contextlib.ExitStack() as held:
        for lock in (tmp_path / "__pycache__").glob("*.lock"):
            held.enter_context(FileLock(lock))
        assert run([sys.executable, "-c", "import callee; print(callee.doubled(21))"]).stdout == "42\n"


def test_a_forked_process_compiles(tmp_path):
    """Fails if a lock is its parent's: the child of a user's pool ends with an error."""
    shutil.copy(PROJECT / "scripts/kernels.py", tmp_path)
    (tmp_path / "callee.py").write_text(CALLEE)
    code = """if True:
        import multiprocessing, sys, callee
        assert callee.doubled(2) == 4
        child = multiprocessing.get_context("fork").Process(target=lambda: sys.exit(int(callee.doubled(20.5))))
        child.start(); child.join(60)
        sys.exit(child.exitcode)
    """
    assert subprocess.run([sys.executable, "-c", code], cwd=tmp_path, timeout=100).returncode == 41


def test_all_compiled_code_is_kept_so():
    """Fails if a file takes numba's own decorator: what it calls could change unseen."""
    taking = [f for f in (PROJECT / "scripts").rglob("*.py") if "import njit" in f.read_text(encoding="utf-8")]
    numbas = {f.name for f in taking if "from numba import njit" in f.read_text(encoding="utf-8")}
    assert len(taking) > 15 and numbas == {"bundle_code.py"}


def test_a_division_by_zero_is_numpys():
    """Fails if kernels look for divisions by zero: their loops then do one number at a time."""

    @njit()
    def share(part, whole):
        return part / whole

    assert share(1.0, 0.0) == np.inf and np.isnan(share(0.0, 0.0))


@njit()
def _halved(x, times):
    return x / 2**times


@njit()
def _halved_twice(x, times):
    return _halved(_halved(x, 1), 2) + _halved(x, times)


def test_numbers_written_out_share_a_kernel():
    """Fails if what a kernel is called with as 1, as 2 and as a variable is compiled for each: a longer wait, for the same."""
    assert _halved_twice(8.0, 3) == 2.0
    assert len(_halved.signatures) == 1
