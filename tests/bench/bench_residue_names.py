"""Names whose only ground is what an earlier step's form left: python tests/bench/bench_residue_names.py [FOLDER].

FOLDER is what ``snakemake --cores 2 blind_trials`` made (observations/, verdicts/, truths/). The steps of each verdict are taken
in their order with the values that they have in the end, and a step stands on a residue where it closes enough of what is
left above the floors only if groups count of which earlier steps had closed four fifths. Prints such steps; figures are recorded
(record.py).
"""

import argparse
import json
import os
import sys
from pathlib import Path

os.environ["OPENBLAS_NUM_THREADS"] = "1"  # before numpy is loaded: threads cost small matrices more than they bring
ROOT = Path(__file__).resolve().parents[2]
sys.path[:0] = [str(ROOT / "scripts"), str(ROOT / "tests/bench")]

from gap.bounds import CLOSED, LITTLE  # noqa: E402
from gap.select.naming import least_gain  # noqa: E402
from gap.select.outcome import twins_on_the_way  # noqa: E402
from gap.select.search import Search  # noqa: E402
from gap.select.standing import is_enough  # noqa: E402
from gap.select.twin import Twin  # noqa: E402
from record import record  # noqa: E402
from trials.observe_trial import observed_cases  # noqa: E402


def excess_on_the_way(case, steps, floors):
    """Return [{group: held-out loss above the floor}] before the first of a verdict's steps and after each."""
    search = Search(case)
    found = [(s["effect"], {k: p["value"] for k, p in s["parameters"].items()}) for s in steps]
    effects, poses = [*((n, p) for n, p in case.nuisances if n not in dict(found)), *found], case.start_poses()

    def seen(some):
        there, groups = search.solver.score(some, poses, search.test)
        return Twin(tuple(some), there, groups, floors, {}, {}, {}, 0.0, True)

    base = seen([e for e in effects if e not in found])
    twins = [base, *twins_on_the_way(search, base, seen(effects), [n for n, _ in found])]
    return [twin.excess for twin in twins]


def stands_on_a_residue(name, first, before, after):
    """Return whether a step closes enough only if groups count of which earlier steps had closed most; each excess {group: loss},
    ``first`` before any step.
    """

    def closes_enough(groups):
        gains = {group: before[group] - after[group] for group in groups}
        return is_enough(gains, sum(gains.values()), least_gain(name), {g: before[g] for g in groups}, LITTLE)

    return closes_enough(before) and not closes_enough([g for g in before if before[g] > CLOSED * first[g]])


def main(argv=None):
    """Read the command line, count, record."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("folder", nargs="?", type=Path, default=Path("results/blind_trials"))
    folder, count = parser.parse_args(argv).folder, {True: 0, False: 0}
    verdicts = sorted(folder.glob("verdicts/*.json"))
    if not verdicts:
        parser.error(f"{folder} has no verdicts: run `snakemake --cores 2 blind_trials` first")
    for path in verdicts:
        truth = json.loads((folder / "truths" / path.stem / "truth.json").read_text())
        hidden = [e["effect"] for e in truth["effects"]]
        cases = observed_cases(folder / "observations" / path.stem)
        for case, verdict in zip(cases, json.loads(path.read_text()), strict=True):
            left = excess_on_the_way(case, verdict["steps"], verdict["floor"]) if verdict["steps"] else []
            for step, before, after in zip(verdict["steps"], left[:-1], left[1:], strict=True):
                if stands_on_a_residue(step["effect"], left[0], before, after):
                    count[step["effect"] in hidden] += 1
                    print(path.stem, step["effect"], step["effect"] in hidden, sep=" | ", flush=True)
    what = "names whose only ground is what earlier forms left"
    figure = f"{count[True]} true, {count[False]} wrong"
    record([(what, figure, f"of {len(verdicts)} trials")], f"python tests/bench/bench_residue_names.py {folder}")


if __name__ == "__main__":
    main()
