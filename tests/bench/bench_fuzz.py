"""Broken inputs on every reader of foreign files: ``python tests/bench/bench_fuzz.py [--inputs 100000] [READER ...]``.

Each reader (fuzz_readers.py) gets so many files that hypothesis broke (fuzz_inputs.py); it has to succeed or to raise
InputError with one printable line, within LONGEST_S of processor time and LARGEST_GIB. What does neither is shrunk, kept in results/fuzz/, told
with its traceback, and ends with exit status 1. Readers run side by side, each in a process of its own: a crash in a library is
found too. Numbers are printed as they come and recorded (record.py).
"""

import argparse
import json
import logging
import os
import re
import resource
import signal
import subprocess
import sys
import tempfile
import time
import traceback
from concurrent.futures import Future, ThreadPoolExecutor, as_completed
from pathlib import Path

ROOT = Path(__file__).resolve().parents[2]
sys.path[:0] = [str(ROOT / "scripts"), str(ROOT / "tests"), str(ROOT / "tests/bench")]

from hypothesis import HealthCheck, Phase, given, seed, settings

from fuzz_readers import readers
from record import record
from rig.errors import InputError

INPUTS, BATCH = 100_000, 2_000  # hypothesis remembers what it tried: a batch begins anew
LONGEST_S, LARGEST_GIB = 10, 6
LONGEST_MESSAGE = 2_000
FOUND = ROOT / "results/fuzz"


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


def fuzz(reader, inputs, number=0, batch=BATCH):
    """Return (inputs tried, how many of them were taken, smallest input at fault or None, its Fault or None).

    number  of the first batch; it decides all that is drawn
    """
    signal.signal(signal.SIGPROF, too_long)
    count, taken, last = 0, 0, b""

    def one(data):
        nonlocal count, taken, last
        count, last = count + 1, data
        taken += tried(reader, data)

    while count < inputs:
        how = settings(
            max_examples=min(batch, inputs - count), deadline=None, database=None, phases=(Phase.generate, Phase.shrink),
            suppress_health_check=list(HealthCheck), report_multiple_bugs=False, print_blob=False,
        )  # fmt: skip
        try:
            seed(number)(how(given(reader.inputs)(one)))()
        except Fault as fault:
            return count, taken, last, fault
        number += 1
    return count, taken, None, None


def of_one_reader(name, inputs):
    """Fuzz one reader in this process, and print what came out as a line of JSON."""
    resource.setrlimit(resource.RLIMIT_AS, (LARGEST_GIB << 30,) * 2)
    resource.setrlimit(resource.RLIMIT_CORE, (0, 0))
    logging.disable()
    with tempfile.TemporaryDirectory() as folder:
        start = time.monotonic()
        count, taken, last, fault = fuzz(readers(folder)[name], inputs)
    if fault:
        keep(name, last)
    print(json.dumps([count, taken, round(time.monotonic() - start), str(fault) if fault else ""]), flush=True)


def keep(name, data):
    """Keep an input that did harm."""
    FOUND.mkdir(parents=True, exist_ok=True)
    (FOUND / re.sub(r"[^A-Za-z0-9]+", "_", name)).write_bytes(data)


def in_a_process(name, inputs):
    """Fuzz one reader in a process of its own; return (name, inputs tried, taken, seconds, what went wrong or an empty text)."""
    command = [sys.executable, __file__, "--inputs", str(inputs), "--here", name]
    done = subprocess.run(command, capture_output=True, text=True, errors="replace", check=False)
    if done.returncode:
        return name, 0, 0, 0, f"the process ended with {done.returncode}: {done.stderr[-2000:]}"
    return name, *json.loads(done.stdout.splitlines()[-1])


def main():
    """Read the command line, try all readers, record; exit with 1 where one did harm."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("names", nargs="*", metavar="READER")
    parser.add_argument("--inputs", type=int, default=INPUTS)
    parser.add_argument("--here", action="store_true", help=argparse.SUPPRESS)
    given = parser.parse_args()
    with tempfile.TemporaryDirectory() as folder:
        known = list(readers(folder))
    for name in given.names:
        if name not in known:
            parser.error(f"no reader is called {name!r}; there are {', '.join(known)}")
    if given.here:
        of_one_reader(given.names[0], given.inputs)
        return
    print(f"{'reader':28} {'inputs':>8} {'taken':>8} {'s':>6}", flush=True)
    results = []
    with ThreadPoolExecutor(os.cpu_count()) as pool:
        waiting = [pool.submit(in_a_process, name, given.inputs) for name in given.names or known]
        for result in map(Future.result, as_completed(waiting)):
            results.append(result)
            print("{:28} {:8} {:8} {:6} {}".format(*result), flush=True)
    faults = sum(bool(what) for *_, what in results)
    print(f"{sum(r[1] for r in results):,} inputs to {len(results)} readers, {faults} of which did harm")
    if not given.names:
        record(figures(results))
    sys.exit(bool(faults))


def figures(results):
    """Return [(what, figure, unit)] of all readers' results."""
    least = min(results, key=lambda r: r[1])
    return [
        ("fuzzed readers of foreign files that raise what is no message of one line", sum(bool(r[4]) for r in results),
         f"of {len(results)} readers"),
        ("broken inputs that each reader of foreign files was given, the fewest", f"{least[1]:,}", f"({least[0]})"),
        ("broken inputs that all readers of foreign files were given", f"{sum(r[1] for r in results):,}", ""),
    ]  # fmt: skip


if __name__ == "__main__":
    main()
