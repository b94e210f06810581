"""One calibrated rule against forward selection, on effects of a quarter of their clear strength:
python tests/bench/bench_score_test.py [EFFECT ...]. Writes docs/score-test.csv.

The rule: the candidate with the smallest p-value of a score test is proposed, Bonferroni's threshold at 1 % over all candidates (the
lowest that a bank of campaigns with nothing to find could give, whose renderer and robust weights only raise it), discounted by
what stays unexplained once something was adopted; it must lower some group's held-out gap by 2 %; in the end each name must pass its
own test with itself taken out. Free warps compete last. What is named alone is counted, of the generator's effects; beside it, what
forward selection names of the same observations.
"""

import argparse
import logging
import sys
import tempfile
from pathlib import Path

ROOT = Path(__file__).resolve().parents[2]
sys.path[:0] = [str(ROOT / "scripts"), str(ROOT / "tests/bench")]

import numpy as np  # noqa: E402
import pandas as pd  # noqa: E402
from scipy.stats import chi2  # noqa: E402

import job  # noqa: E402
from effects import library  # noqa: E402
from gap.fit.residuals import GROUPS  # noqa: E402
from gap.fit.score import group_gaps  # noqa: E402
from gap.select.naming import is_flexible  # noqa: E402
from gap.select.search import Search  # noqa: E402
from gap.select.select_effects import verdict  # noqa: E402
from generator.vocabulary import LIBRARY  # noqa: E402
from record import record  # noqa: E402
from trials.generate_trials import generate_trial  # noqa: E402
from trials.observe_trial import observe_trial, observed_cases  # noqa: E402

TABLE = ROOT / "docs/score-test.csv"
SEED, STRENGTH = "gate", 0.25
ALPHA, MIN_RAISE = 0.01, 1.02  # a p-value over all candidates; factor of a group's gap
NOTHING, NOT_RUN = "nothing", "not run"
MAX_NAMES = 4  # more need not be counted: it is not named alone


def named_by_rule(search):
    """Return (names in the order proposed, names that stay) of a Search by the one rule."""
    twin = search.fitted(list(search.problem.nuisances))
    candidates, proposed, refused = list(search.candidates), [], set()
    while len(proposed) < MAX_NAMES:
        left = [n for n in candidates if n not in twin.names and n not in refused]
        best = most_evident(search, twin, [n for n in left if not is_flexible(n)], len(candidates), bool(proposed))
        best = best or most_evident(search, twin, [n for n in left if is_flexible(n)], len(candidates), bool(proposed))
        if best is None:
            break
        adopted = search.adopt(search.try_effect(twin, best))
        if not raises_a_gap(adopted, twin):
            refused.add(best)
            continue
        twin, proposed = adopted, [*proposed, best]
    return proposed, without_what_fails(search, twin, proposed)


def most_evident(search, twin, names, number, discounted):
    """Return the name with the smallest p-value of a score test, None where none of ``number`` candidates passes."""
    gaps = group_gaps(twin.groups, twin.floors)
    factor = np.array([max(1.0, gaps.get(g, 1.0) ** 2) if discounted else 1.0 for g in GROUPS])
    best = (np.log(ALPHA / number), None)
    for name in names:
        by_group = search.predicted_gain(twin, name)
        G = float(np.sum(np.array([by_group[g] for g in GROUPS]) / factor))
        best = min(
            best, (float(chi2.logsf(max(G, 0.0), len(library.fitted_parameters(name)))), name), key=lambda b: b[0]
        )
    return best[1]


def raises_a_gap(full, without):
    """Return whether some group's held-out gap is higher by 2 % in a Twin without an effect than in the full one."""
    ours, theirs = (group_gaps(t.groups, full.floors) for t in (full, without))
    return any(theirs[g] > MIN_RAISE * ours[g] for g in ours if ours[g] > 0)


def without_what_fails(search, twin, names):
    """Return the names that pass their own test, one taken out at a time, all others refitted."""
    for name in names:
        if len(names) == 1:
            break
        rest = search.fitted([e for e in twin.effects if e[0] != name], twin.poses)
        cost = sum(rest.losses.values()) - sum(twin.losses.values())
        passes = chi2.logsf(max(cost, 0.0), len(library.fitted_parameters(name))) < np.log(
            ALPHA / len(search.candidates)
        )
        if not (passes and raises_a_gap(twin, rest)):
            return without_what_fails(search, rest, [n for n in names if n != name])
    return names


def replayed(effect, folder):
    """Return the table's row (dict) of an effect at a quarter of its clear strength."""
    name, _ = generate_trial(folder, folder / "truths", "power", 0, SEED, effect, STRENGTH)
    observe_trial(folder / name, folder / "observed")
    case = observed_cases(folder / "observed")[0]
    search = Search(case)
    proposed, stay = named_by_rule(search)
    forward = [step.effect for step in verdict(case)[3].steps]
    words = {"proposed": proposed, "named": stay, "forward": forward}
    return {"effect": effect} | {k: " ".join(v) or NOTHING for k, v in words.items()} | {"predictions": search.cost}


def main():
    """Read the command line, replay, write, record."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("effects", nargs="*", metavar="EFFECT", help="of the generator; all where none is named")
    logging.disable()
    for effect in parser.parse_args().effects or LIBRARY:
        with tempfile.TemporaryDirectory() as folder:
            row = replayed(effect, Path(folder))
        print(row, flush=True)
        old = pd.read_csv(TABLE, keep_default_na=False) if TABLE.is_file() else pd.DataFrame(columns=list(row))
        table = (
            pd.concat([old[old.effect != effect], pd.DataFrame([row])])
            .fillna(NOT_RUN)
            .replace("", NOTHING)
            .sort_values("effect")
        )
        with job.write_atomically(TABLE) as file:
            table.to_csv(file, index=False, lineterminator="\n")
    table = pd.read_csv(TABLE, keep_default_na=False)
    command = "python tests/bench/bench_score_test.py"
    first, alone = ((column == table.effect).sum() for column in (table.proposed.str.split().str[0], table.named))
    both = table[table.forward != NOT_RUN]
    forward, rule = ((both[column] == both.effect).sum() for column in ("forward", "named"))
    figures = [
        ("a quarter of the clear strength, by one score test: proposed first", f"{first} of {len(table)}", ""),
        ("a quarter of the clear strength, by one score test: named alone", f"{alone} of {len(table)}", ""),
        (
            "the same trials, where both were run: forward selection names alone",
            f"{forward} of {len(both)}",
            f"the rule {rule}",
        ),
    ]
    record(figures, command)


if __name__ == "__main__":
    main()
