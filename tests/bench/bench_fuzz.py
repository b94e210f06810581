"""Broken inputs on every reader of foreign files: ``python tests/bench/bench_fuzz.py [--inputs 100000] [READER ...]``.

Each reader (fuzz_readers.py) gets so many files that were broken (fuzz_inputs.py); it has to succeed or to raise InputError
with one printable line, within LONGEST_S of processor time and LARGEST_GIB. What does neither is made as small as leaving
edits out makes it, kept in results/fuzz/, told with its traceback, and ends with exit status 1. Readers take turns of TURN
inputs, each turn in a process of its own: a crash in a library is found too.

After each turn docs/fuzz.csv says what each reader was given. The next call goes on there; a reader that did harm begins
anew, and so do all with ``--anew``. What was reached is recorded at the end (record.py).
"""

import argparse
import ctypes
import json
import logging
import os
import re
import resource
import signal
import sys
import tempfile
import time
import traceback
import warnings
from pathlib import Path

ROOT = Path(__file__).resolve().parents[2]
sys.path[:0] = [str(ROOT / "scripts"), str(ROOT / "tests"), str(ROOT / "tests/bench")]

import cv2
import pandas as pd

import job
from fuzz_inputs import fewer_edits
from fuzz_readers import readers
from record import record
from rig.errors import InputError

INPUTS, TURN = 100_000, 2_000
LONGEST_S, LARGEST_GIB = 10, 6
LONGEST_MESSAGE = 2_000
FOUND = ROOT / "results/fuzz"
TABLE = ROOT / "docs/fuzz.csv"
COLUMNS = ["reader", "inputs", "taken", "cpu_s", "harm"]
DIES_WITH_PARENT = 1  # prctl's PR_SET_PDEATHSIG


class Fault(Exception):
    """What a reader must not do."""


def tried(reader, data):
    """Give a reader one input and return whether it took it; raise Fault for anything but that or InputError in one line."""
    reader.path.write_bytes(data)
    signal.setitimer(signal.ITIMER_PROF, LONGEST_S)
    try:
        reader.call(reader.path)
        return True
    except InputError as error:
        message = str(error)
        if not message.isprintable() or not 0 < len(message) <= LONGEST_MESSAGE:
            raise Fault(f"the message is no printable line: {message[:300]!r}") from None
        return False
    except Exception as error:
        *_, last = traceback.extract_tb(error.__traceback__)
        raise Fault(f"{type(error).__name__}: {error} ({last.filename}:{last.lineno})") from error
    finally:
        signal.setitimer(signal.ITIMER_PROF, 0)


def too_long(*_):
    """Stop a reader that takes too long."""
    raise TimeoutError(f"longer than {LONGEST_S} s of processor time")


def fuzz(reader, inputs, first=0):
    """Return (inputs tried, how many of them were taken, smallest input at fault or None, its Fault or None).

    first  number of the first input; it decides all that is drawn
    """
    signal.signal(signal.SIGPROF, too_long)
    taken = 0
    for number in range(first, first + inputs):
        drawn = reader.inputs.drawn(number)
        try:
            taken += tried(reader, reader.inputs.made(*drawn))
        except Fault as fault:
            return number - first, taken, *smallest(reader, drawn, fault)
    return inputs, taken, None, None


def smallest(reader, drawn, fault):
    """Return an input at fault with as few edits as can be, and its Fault."""
    for fewer in fewer_edits(drawn):
        try:
            tried(reader, reader.inputs.made(*fewer))
        except Fault as other:
            return smallest(reader, fewer, other)
    return reader.inputs.made(*drawn), fault


def turn(name, reader, first, inputs):
    """Fuzz one reader in a process of its own; return (inputs tried, taken, CPU seconds, what went wrong or an empty text)."""
    read, write = os.pipe()
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", DeprecationWarning)  # pandas has a thread of its own; no reader uses it
        child = os.fork()
    if not child:
        os.close(read)
        in_the_child(name, reader, first, inputs, write)
    os.close(write)
    with open(read) as pipe:
        said = pipe.read()
    _, status = os.waitpid(child, 0)
    if said:
        return json.loads(said)
    keep(name, reader.path.read_bytes())
    return 0, 0, 0, f"the process ended with {os.waitstatus_to_exitcode(status)}"


def in_the_child(name, reader, first, inputs, write):
    """Fuzz, hand over what came out as JSON, and end the process."""
    ctypes.CDLL(None).prctl(DIES_WITH_PARENT, signal.SIGKILL)
    resource.setrlimit(resource.RLIMIT_AS, (LARGEST_GIB << 30,) * 2)
    resource.setrlimit(resource.RLIMIT_CORE, (0, 0))
    os.dup2(os.open(os.devnull, os.O_WRONLY), 2)  # what libraries say of broken images
    start = time.process_time()
    count, taken, last, fault = fuzz(reader, inputs, first)
    if fault:
        keep(name, last)
    result = [count, taken, time.process_time() - start, str(fault) if fault else ""]
    os.write(write, json.dumps(result).encode())
    os._exit(0)


def keep(name, data):
    """Keep an input that did harm."""
    FOUND.mkdir(parents=True, exist_ok=True)
    (FOUND / re.sub(r"[^A-Za-z0-9]+", "_", name)).write_bytes(data)


def reached(names, table_path, anew):
    """Return a table by reader of what each was given before; zeros for those that begin anew."""
    old = pd.DataFrame(columns=COLUMNS)
    if table_path.is_file() and not anew:
        old = pd.read_csv(table_path, keep_default_na=False)
    table = old[old.harm == ""].set_index("reader").reindex(names)
    return table.fillna({"inputs": 0, "taken": 0, "cpu_s": 0.0, "harm": ""}).astype({"inputs": int, "taken": int})


def write_table(table, table_path):
    """Write what each reader was given."""
    with job.write_atomically(table_path) as file:
        table.round({"cpu_s": 0}).reset_index(names="reader").to_csv(file, index=False, lineterminator="\n")


def fuzz_all(all_readers, table, names, inputs, table_path):
    """Give each named reader turns until it had ``inputs`` or did harm; the one that had least comes next."""
    while True:
        waiting = table.loc[names].query("inputs < @inputs and harm == ''").inputs
        if waiting.empty:
            return
        name = waiting.idxmin()
        first = int(table.inputs[name])
        count, taken, seconds, harm = turn(name, all_readers[name], first, min(TURN, inputs - first))
        table.loc[name] = [first + count, table.taken[name] + taken, table.cpu_s[name] + seconds, harm]
        write_table(table, table_path)
        if harm or first + count >= inputs:
            print(f"{name:28} {first + count:8} {table.cpu_s[name]:7.0f} s CPU  {harm}", flush=True)


def main():
    """Read the command line, try all readers, record; exit with 1 where one did harm."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("names", nargs="*", metavar="READER")
    parser.add_argument("--inputs", type=int, default=INPUTS)
    parser.add_argument("--anew", action="store_true", help="forget what was tried before")
    given = parser.parse_args()
    logging.disable()
    cv2.setNumThreads(1)  # threads do not survive a fork
    memory = Path("/dev/shm")
    with tempfile.TemporaryDirectory(dir=memory if os.access(memory, os.W_OK) else None) as folder:
        all_readers = readers(folder)
        for name in given.names:
            if name not in all_readers:
                parser.error(f"no reader is called {name!r}; there are {', '.join(all_readers)}")
        table = reached(list(all_readers), TABLE, given.anew)
        fuzz_all(all_readers, table, given.names or list(all_readers), given.inputs, TABLE)
    print(table.to_markdown())
    record(figures(table), "make fuzz")
    sys.exit(bool((table.harm != "").any()))


def figures(table):
    """Return [(what, figure, unit)] of what all readers were given."""
    least = table.inputs.idxmin()
    return [
        ("fuzzed readers of foreign files that raise what is no message of one line", int((table.harm != "").sum()),
         f"of {len(table)} readers"),
        ("broken inputs that each reader of foreign files was given, the fewest", f"{table.inputs[least]:,}", f"({least})"),
        ("broken inputs that all readers of foreign files were given", f"{table.inputs.sum():,}", ""),
    ]  # fmt: skip


if __name__ == "__main__":
    main()
