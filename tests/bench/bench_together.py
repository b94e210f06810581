"""Which effects are proposed together for a camera's first twin, and how many of these are really hidden:
python tests/bench/bench_together.py [SEED ...]. Of whole cameras, single effects and effects outside the library.

What captures show by themselves, what corners tell, and forward selection in the derivatives by all other effects of the library,
about their nulls and towards their starts; nothing is fitted but points.
"""

import argparse
import itertools
import logging
import os
import sys
import tempfile
from pathlib import Path

os.environ["OPENBLAS_NUM_THREADS"] = "1"  # before numpy is loaded: threads cost small matrices more than they bring
ROOT = Path(__file__).resolve().parents[2]
sys.path[:0] = [str(ROOT / "scripts"), str(ROOT / "tests/bench")]

import cv2  # noqa: E402

from gap.select.joint_way import first_proposal  # noqa: E402
from gap.select.naming import is_flexible  # noqa: E402
from gap.select.search import Search  # noqa: E402
from record import record  # noqa: E402
from trials.generate_trials import generate_trial  # noqa: E402
from trials.observe_trial import observe_trial, observed_cases  # noqa: E402

COUNTS = {"whole": 4, "single": 4, "outside": 3}  # of trials of each kind and seed
HIDDEN = {
    "whole": "proposed together, whole trials: names that are hidden",
    "single": "proposed together, single trials: names that are hidden",
    "outside": "proposed together, outside trials: names that are hidden",
}
FIRST = {
    "whole": "proposed together, whole trials: the first name is hidden",
    "single": "proposed together, single trials: the first name is hidden",
}


def counted(kind, index, seed):
    """Return (names that are hidden, names that are proposed for the first twin) of one trial; none where it shows too little."""
    with tempfile.TemporaryDirectory() as folder:
        name, truth = generate_trial(Path(folder) / "campaigns", Path(folder) / "truths", kind, index, seed)
        observe_trial(Path(folder) / "campaigns" / name, Path(folder) / "kept")
        search = Search(observed_cases(Path(folder) / "kept")[0])
    hidden = [e["effect"] for e in truth["effects"]]
    if search.why_unusable():
        return hidden, []
    twin = search.fitted(list(search.problem.nuisances))
    return hidden, first_proposal(search, twin, [n for n in search.candidates if not is_flexible(n)])[0].names


def main(argv=None):
    """Read the command line, count, record."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("seeds", nargs="*", metavar="SEED", default=["gorse"])
    seeds = parser.parse_args(argv).seeds
    cv2.setNumThreads(1)
    logging.disable()
    for kind, count in COUNTS.items():
        trials = []
        for seed, index in itertools.product(seeds, range(count)):
            trials.append(counted(kind, index, seed))
            hidden, names = trials[-1]
            print(kind, "hidden:", *hidden, "| proposed:", *names, flush=True)
        right = sum(name in hidden for hidden, names in trials for name in names)
        number = sum(len(names) for _, names in trials)
        of = sum(len(hidden) for hidden, _ in trials)
        figures = [(HIDDEN[kind], f"{right} of {number}", f"names; {of} effects are hidden")]
        if kind in FIRST:
            first = sum(names[:1] != [] and names[0] in hidden for hidden, names in trials)
            figures.append((FIRST[kind], f"{first} of {len(trials)}", "cameras"))
        record(figures, f"python tests/bench/bench_together.py {' '.join(seeds)}")


if __name__ == "__main__":
    main()
