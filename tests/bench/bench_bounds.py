"""What half and double of each bound of the diagnosis would turn: python tests/bench/bench_bounds.py [KIND/SEED/FIRST-LAST ...]

Diagnoses blind trials with bounds that keep account (watched.py), a process each, and writes docs/bounds.csv, which keeps the rows of
other runs, and docs/bounds.md. Trials given are one run; without any those of RUNS. Real trials are of ../shared/real.
"""

import argparse
import logging
import multiprocessing
import os
import re
import sys
import tempfile
from pathlib import Path

os.environ["OPENBLAS_NUM_THREADS"] = "1"  # before numpy is loaded: threads cost small matrices more than they bring
ROOT = Path(__file__).resolve().parents[2]
sys.path[:0] = [str(ROOT / "scripts"), str(ROOT / "tests/bench")]

import pandas as pd

import job
from record import commit_of

TABLE, PAGE, METHOD = ROOT / "docs/bounds.csv", ROOT / "docs/bounds.md", ROOT / "docs/method.md"
REAL = ROOT.parent / "shared/real"
RUNS = (
    "none/larkspur/3-4 single/larkspur/6-10 pair/larkspur/6-7 whole/yarrow/49",
    "real/fennel/0-1",
)
HEAD = """# What half and double of each bound turn

The bounds are those of [method.md](method.md#bounds-set-by-hand). Blind trials were diagnosed with bounds that keep account of what is
compared with them; [bounds.csv](bounds.csv) has the runs one by one:

{runs}

**turned**: comparisons that half (double) of the bound would have decided otherwise, and in how many trials there was one.
A decision that turns need not change a name; where none turns, half and double of the bound give the same verdicts in these
trials. Each bound was looked at alone. `-`: never compared in these trials, or what is clipped, counted or told with the bound's sign
turned, which keeps no account.
"""
SUMS = ["compared", "half", "double", "trials_half", "trials_double", "trials"]


def bounds_of_method():
    """Return the names of the bounds that docs/method.md lists."""
    return re.findall(r"^\| `([A-Z_]+)` \|", METHOD.read_text(encoding="utf-8"), re.M)


def counted(kind, index, seed):
    """Return {bound: (compared, turned by half, turned by double)} of the diagnosis of one trial."""
    import cv2

    from trials.diagnose_trial import diagnose_case, diagnose_changes
    from trials.generate_trials import generate_trial
    from trials.observe_trial import observe_trial, observed_cases
    from trials.real_trials import generate_real_trial
    from watched import SCALES, counts, watch

    cv2.setNumThreads(1)
    logging.disable()
    watch([module for name, module in sorted(sys.modules.items()) if name.startswith("gap.")], bounds_of_method())
    with tempfile.TemporaryDirectory() as folder:
        campaigns, truths, kept = (Path(folder) / part for part in ("campaigns", "truths", "kept"))
        if kind == "real":
            name = generate_real_trial(campaigns, truths, REAL, index, seed)
        else:
            name, _ = generate_trial(campaigns, truths, kind, index, seed)
        observe_trial(campaigns / name, kept)
        counts.clear()
        if kind == "real":
            diagnose_changes(kept)
        else:
            diagnose_case(observed_cases(kept)[0])
    return {bound: (c["compared"], *(c[s] for s in SCALES)) for bound, c in counts.items()}


def trials_of(text):
    """Return [(kind, index, seed)] of KIND/SEED/FIRST-LAST or KIND/SEED/INDEX."""
    kind, seed, numbers = text.split("/")
    first, _, last = numbers.partition("-")
    return [(kind, index, seed) for index in range(int(first), int(last or first) + 1)]


def table_of(found):
    """Return a row a bound of the counts of several trials."""
    rows = []
    for name in bounds_of_method():
        of = [f.get(name, (0, 0, 0)) for f in found]
        sums, trials = ([sum(map(as_one, n)) for n in zip(*of, strict=True)] for as_one in (int, bool))
        rows.append(dict(zip(["bound", "compared", "half", "double"], [name, *sums], strict=True)))
        rows[-1] |= {"trials_half": trials[1], "trials_double": trials[2], "trials": len(of)}
    return pd.DataFrame(rows)


def with_run(table, run, commit, rows):
    """Return a table with the rows of a run, at a commit, in place of what it said of that run."""
    rows = rows.assign(run=run, commit=commit)[["run", "commit", *rows.columns]]
    return pd.concat([table[table.run != run], rows], ignore_index=True)


def page_of(table):
    """Return docs/bounds.md as text."""
    runs = table.drop_duplicates("run")
    lines = [
        f"- `python tests/bench/bench_bounds.py {r.run}` at {r.commit}: {r.trials} trials" for r in runs.itertuples()
    ]
    table = table.groupby("bound", sort=False)[SUMS].sum().reset_index()
    shown = table[["bound", "compared"]].astype(str).replace("0", "-")
    for scale in ("half", "double"):
        turned = table[scale].astype(str) + " in " + table[f"trials_{scale}"].astype(str)
        shown[f"turned by {scale}"] = turned.where(table.compared > 0, "-").where(
            (table[scale] > 0) | (table.compared == 0), "0"
        )
    head = HEAD.format(runs="\n".join(lines))
    return f"{head}\n{shown.to_markdown(index=False, disable_numparse=True)}\n"


def main(argv=None):
    """Read the command line, diagnose, write the table and the page."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("trials", nargs="*", metavar="KIND/SEED/FIRST-LAST")
    given = parser.parse_args(argv).trials
    for run in [" ".join(given)] if given else RUNS:
        found = []
        for trial in (t for text in run.split() for t in trials_of(text)):
            with multiprocessing.get_context("spawn").Pool(1) as alone:  # constants are watched once in a process
                found.append(alone.apply(counted, trial))
            print(*trial, flush=True)
        table = with_run(pd.read_csv(TABLE, dtype={"commit": str}), run, commit_of(ROOT), table_of(found))
        with job.write_atomically(TABLE) as file:
            table.to_csv(file, index=False, lineterminator="\n")
        with job.write_atomically(PAGE) as file:
            file.write(page_of(table))


if __name__ == "__main__":
    main()
