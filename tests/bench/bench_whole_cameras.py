"""Cameras with four to nine effects at once: python tests/bench/bench_whole_cameras.py [--seed NAME] [--count N] [--first K].

Each is diagnosed by all effects of the library, two threads, in this process. Prints a line a camera; figures are recorded
(record.py). All effects that were drawn count as hidden, also those too weak to be seen beside the others: which these are takes
``scripts/trials/true_twin.py`` a quarter of an hour a camera.
"""

import argparse
import logging
import os
import sys
import tempfile
import time
from pathlib import Path

os.environ["OPENBLAS_NUM_THREADS"] = "1"  # before numpy is loaded: threads cost small matrices more than they bring
ROOT = Path(__file__).resolve().parents[2]
sys.path[:0] = [str(ROOT / "scripts"), str(ROOT / "tests/bench")]

import cv2  # noqa: E402
import numpy as np  # noqa: E402
import pandas as pd  # noqa: E402

from gap.select.select_effects import verdict  # noqa: E402
from record import record  # noqa: E402
from trials.generate_trials import generate_trial  # noqa: E402
from trials.observe_trial import observe_trial, observed_cases  # noqa: E402
from trials.summarise_trials import MAX_GROUP  # noqa: E402

THREADS = 2


def diagnosed(index, seed):
    """Return a row of one camera: what is hidden, its verdict, names, groups of names, gaps, seconds."""
    with tempfile.TemporaryDirectory() as folder:
        name, truth = generate_trial(Path(folder) / "campaigns", Path(folder) / "truths", "whole", index, seed)
        observe_trial(Path(folder) / "campaigns" / name, Path(folder) / "kept")
        case = observed_cases(Path(folder) / "kept")[0]
    start = time.perf_counter()
    search, base, _, outcome = verdict(case, threads=THREADS)
    seconds = time.perf_counter() - start
    return {
        "hidden": [e["effect"] for e in truth["effects"]],
        "verdict": outcome.verdict,
        "groups": groups_of(outcome.steps),
        "before": round(base.gap, 2),
        "after": round(outcome.twin.gap, 2),
        "s": round(seconds),
        "predictions": search.cost,
    }


def groups_of(steps):
    """Return what each Step leaves open: [(its name and those that would do as well)]."""
    return [step.one_of or (step.effect,) for step in steps]


def counts_of(hidden, groups):
    """Return (hidden effects named, alone or in a group of MAX_GROUP at most; wrong names; names in groups)."""
    small = [group for group in groups if len(group) <= MAX_GROUP]
    named = [name for name in hidden if any(name in group for group in small)]
    wrong = [group for group in groups if not set(group) & set(hidden)]
    return len(named), len(wrong), sum(len(group) > 1 for group in groups)


def main(argv=None):
    """Read the command line, diagnose, record."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--seed", default="hawthorn")
    parser.add_argument("--count", type=int, default=60)
    parser.add_argument("--first", type=int, default=0)
    args = parser.parse_args(argv)
    cv2.setNumThreads(1)
    logging.disable()
    rows = []
    for index in range(args.first, args.first + args.count):
        rows.append(diagnosed(index, args.seed))
        print(index, *(f"{key} {value}" for key, value in rows[-1].items()), sep=" | ", flush=True)
    rows = pd.DataFrame(rows)
    named, wrong, grouped = np.sum([counts_of(r.hidden, r.groups) for r in rows.itertuples()], axis=0)
    hidden, names = rows.hidden.map(len).sum(), rows.groups.map(len).sum()
    of = f"of {len(rows)} cameras, seed {args.seed}"
    record(
        [
            (
                "whole cameras: hidden effects named, alone or in a group of at most three",
                f"{named} of {hidden} ({named / hidden:.0%})",
                f"effects that were drawn, seen or not, {of}",
            ),
            ("whole cameras: wrong names", f"{wrong} of {names} ({wrong / names:.0%})", f"names {of}"),
            ("whole cameras: names in groups", f"{grouped} of {names} ({grouped / names:.0%})", f"names {of}"),
            ("whole cameras: explained", f"{(rows.verdict == 'explained').sum()} of {len(rows)}", "cameras"),
            ("whole cameras: median time to the verdict, two threads", rows.s.median() / 60, "min"),
        ],
        f"python tests/bench/bench_whole_cameras.py --seed {args.seed} --count {args.count} --first {args.first}",
    )


if __name__ == "__main__":
    main()
