"""A disk that is full in each stage: ``python tests/bench/bench_mishaps.py``. Needs the right to mount (``unshare -rm``).

In each stage of a tiny campaign's run a file takes all the room that is left (full_disk.py). Printed is what a user sees, and whether
the next run goes on when there is room again; figures are recorded (record.py). What else may go wrong around a run is cheap,
and tried by tests/test_nothing_lost.py.
"""

import json
import subprocess
import sys
import tempfile
from pathlib import Path

ROOT = Path(__file__).resolve().parents[2]
sys.path[:0] = [str(ROOT / "scripts"), str(ROOT / "tests"), str(ROOT / "tests/bench")]

from full_disk import TARGETS
from record import record
from tiny_campaign import write_campaign


def main():
    """Fill the disk in all stages, print and record; exit with 1 where one did not end well."""
    with tempfile.TemporaryDirectory() as folder:
        campaign = write_campaign(Path(folder) / "tiny")
        command = [sys.executable, str(Path(__file__).with_name("full_disk.py")), folder, str(campaign), *TARGETS]
        done = subprocess.run(["unshare", "-rm", *command], capture_output=True, text=True, check=False)
    if done.returncode:
        sys.exit(f"{done.stderr[-3000:]}\nneeds the right to mount a small disk (unshare -rm)")
    print(done.stderr, file=sys.stderr)
    told, good = json.loads(done.stdout.splitlines()[-1]), 0
    for stage, (status, errors, traceback, again) in told.items():
        well = status == 1 and len(errors) >= 1 and not traceback and again == 0
        good += well
        print(
            f"{stage}: {'well' if well else 'NOT WELL'}; exit status {status}, then {again}; {'; '.join(errors)}",
            flush=True,
        )
    record(
        [
            (
                "stages in which a full disk is told without a traceback and the next run goes on",
                f"{good} of {len(told)}",
                "",
            )
        ]
    )
    sys.exit(good < len(told))


if __name__ == "__main__":
    main()
