"""Count blind trials against their sealed truth:
python scripts/trials/summarise_trials.py --verdicts FOLDER --truths FOLDER --true-twins FOLDER --out FOLDER.

Verdicts are FOLDER/<campaign>.json (diagnose_trial.py), truths FOLDER/<campaign>/truth.json, the twins with the true
effects of whole cameras FOLDER/<campaign>.json (true_twin.py). Makes trials.csv, summary.csv and summary.md (each aim
with its 95 % interval), confusion.csv and confusion.png, parameters.csv, power.csv.
"""

import argparse
import json
import sys
from pathlib import Path

ROOT = Path(__file__).resolve().parents[2]
sys.path[:0] = [str(ROOT / "scripts"), str(ROOT / "tests/bench")]

import matplotlib

matplotlib.use("Agg")
import matplotlib.pyplot as plt
import numpy as np
import pandas as pd
import seaborn as sns
from scipy.optimize import linear_sum_assignment
from scipy.stats import quantile_test

import job
from generator import LIBRARY, OUTSIDE
from reporting.metrics import wilson_interval

Z95 = 1.959964
MAX_GAP = 1.05
MAX_GROUP = 3  # names in a group that still says what is hidden
NOTHING = "(nothing)"


def library_view(effect, p):
    """Return {our parameter: true value} of a hidden effect, as far as conventions map; {} where none does.

    ``p`` are the truth's library_parameters (docs/blind-trials.md).
    """
    if p is None:
        return {}
    rename = {
        "marker_scale": {"scale": "scale"},
        "ink_spread": {"spread_m": "spread_m"},
        "focal_length": {"ratio": "ratio"},
        "principal_point": {"dx_px": "dx_px", "dy_px": "dy_px"},
        "radial_distortion": {"k1": "k1", "k2": "k2"},
        "tangential_distortion": {"p1": "p1", "p2": "p2"},
        "lateral_chromatic_aberration": {"red": "red_ratio", "blue": "blue_ratio"},
        "lens_blur": {"sigma_px": "sigma_px"},
        "veiling_glare": {"share": "share"},
        "exposure": {"scale": "scale"},
        "sharpening": {"amount": "amount", "sigma_px": "radius_px"},
        "rolling_shutter": {"skew_px_per_row": "skew_x"},
    }.get(effect, {})
    return {ours: p[theirs] for theirs, ours in rename.items()}


def in_words(effect):
    """Return a hidden effect's single numbers and words, as the generator has them (docs/blind-trials.md)."""
    single = {k: v for k, v in effect["parameters"].items() if isinstance(v, int | float | str)}
    return ", ".join(f"{k} {v:.5g}" if isinstance(v, float) else f"{k} {v}" for k, v in single.items())


def names_in(step):
    """Return the names that a step leaves open, best first: one, or the group that the captures cannot tell apart."""
    return [step["effect"], *(name for name in step.get("one_of", []) if name != step["effect"])]


def steps_of(hidden, counted, steps):
    """Return {hidden name: names of the step that stands for it}: each step stands for one hidden effect at most.

    Of the ways to deal them out, the one that serves most names of ``counted``, then most others, then names given
    alone, then best ones of a group.
    """
    named = [names_in(step) for step in steps]
    worth = np.zeros((len(hidden), len(named)))
    for (i, name), (k, names) in ((h, n) for h in enumerate(hidden) for n in enumerate(named)):
        if name in names:
            clear = 4 * (len(names) <= MAX_GROUP) + 2 * (len(names) == 1) + (names[0] == name)
            worth[i, k] = 10_000 * (name in counted and len(names) <= MAX_GROUP) + 100 + clear
    return {hidden[i]: named[k] for i, k in zip(*linear_sum_assignment(-worth), strict=True) if worth[i, k]}


def trial_row(verdict, truth, twin=None):
    """Return one trial as a row: what was hidden, what was said; ``twin`` is the record of the twin with the true effects."""
    hidden = [e["effect"] for e in truth["effects"]]
    named = [s["effect"] for s in verdict["steps"]]
    inside = [h for h in hidden if h in LIBRARY]
    row = {
        "campaign": truth["campaign"],
        "kind": truth["kind"],
        "strength": truth["strength"],
        "camera": verdict["camera"],
        "hidden": " ".join(hidden),
        "parameters": "; ".join(in_words(e) for e in truth["effects"]),
        "verdict": verdict["verdict"],
        "named": " ".join(named),
        "first_right": bool(named) and any(name in inside for name in names_in(verdict["steps"][0])[:MAX_GROUP]),
        "set_right": set(named) == set(inside),
        "gap_before": verdict.get("gap_as_configured"),
        "gap": verdict["gap"],
        "said_unseen": any(name in verdict.get("not_told", []) for name in hidden),
    }
    return row if twin is None else row | whole_columns(verdict, inside, twin)


def gap_ratio(verdict, twin):
    """Return a verdict's held-out gap over the true twin's (records: dicts), both in the true twin's floors; inf without one."""
    if verdict["gap"] is None or twin["gap"] is None:
        return np.inf
    floors = verdict["floor"]
    found = {g: gap * floors.get(g, 1.0) / twin["floor"].get(g, 1.0) for g, gap in verdict["groups"].items()}
    return float(np.sqrt(np.mean(np.square(list(found.values())))) / twin["gap"])


def whole_columns(verdict, hidden, twin):
    """Return what is counted of a whole camera: hidden effects that count and those of them named, names given, in groups
    and wrong, and the gap over that of the twin with the true effects.
    """
    steps = verdict["steps"]
    stands_for = steps_of(hidden, twin["counted"], steps)
    found = [name for name in twin["counted"] if len(stands_for.get(name, [])) in range(1, MAX_GROUP + 1)]
    return {
        "counted": " ".join(twin["counted"]),
        "one_of": " ".join("|".join(names_in(step)) for step in steps),
        "n_counted": len(twin["counted"]),
        "n_found": len(found),
        "n_named": len(steps),
        "n_in_groups": sum(len(names_in(step)) > 1 for step in steps),
        "n_wrong": len(steps) - len(stands_for),
        "gap_ratio": gap_ratio(verdict, twin),
    }


def parameter_rows(verdict, truth):
    """Return a row for every parameter whose true value is known in the library's own convention."""
    rows = []
    for e in truth["effects"]:
        step = next((s for s in verdict["steps"] if s["effect"] == e["effect"]), None)
        if step is None:
            continue
        for name, value in library_view(e["effect"], e["library_parameters"]).items():
            found = step["parameters"][name]
            if found["se"]:
                rows.append(
                    {
                        "campaign": truth["campaign"],
                        "effect": e["effect"],
                        "parameter": name,
                        "truth": value,
                        "found": found["value"],
                        "se": found["se"],
                        "miss": abs(found["value"] - value) / found["se"],
                        "inside_95": abs(found["value"] - value) <= Z95 * found["se"],
                    }
                )
    return rows


def counted_as(trials):
    """Return each trial's kind; a power trial at strength 1 is drawn as a single one is, and counts as one."""
    return trials.kind.mask((trials.kind == "power") & (trials.strength == 1), "single")


def share_row(what, aim, hits, number):
    """Return a row of the summary: a share in per cent with Wilson's 95 % interval."""
    percent = [round(100 * share, 1) for share in (hits / number, *wilson_interval(hits, number))]
    columns = ("what", "aim", "value", "low", "high", "unit", "hits", "number")
    return dict(zip(columns, (what, aim, *percent, "%", hits, number), strict=True))


def number_row(what, aim, unit, value, low, high, number):
    """Return a row of the summary that is no share."""
    return {"what": what, "aim": aim, "value": value, "low": low, "high": high, "unit": unit, "number": number}


def summary_of(trials, parameters):
    """Return the table of aims, those rows for which there are trials: what, aim, value, its 95 % interval, unit, counts."""
    kinds = counted_as(trials)
    by = {kind: trials[kinds == kind] for kind in ("single", "pair", "none", "outside", "whole")}
    real = trials[(kinds == "real") & (trials.verdict != "refused")]
    changed, same = real[real.hidden != ""], real[real.hidden == ""]
    missed = changed[changed.named == ""]
    outside, whole, closed = by["outside"], by["whole"], pd.concat([by["single"], by["pair"]])
    hits = [
        ("single effects: the right one first", "98 %", by["single"].first_right),
        ("single effects: exactly the right set", "", by["single"].set_right),
        ("two effects: exactly the right set", "92 %", by["pair"].set_right),
        ("nothing hidden: something named (false alarm)", "at most 1 %", by["none"].named != ""),
        ("nothing hidden: said adequate", "", by["none"].verdict == "adequate"),
        ("outside the library: said unexplained", "97 %", outside.verdict == "unexplained"),
        ("outside the library: a wrong name given", "at most 5 %", outside.named != ""),
        ("held-out gap after forward selection at most 1.05 floors", "95 %", closed.gap.fillna(np.inf) <= MAX_GAP),
        ("what has changed on photographs: the right effect first", "90 %", changed.first_right),
        ("changes on photographs without a name: said to go unseen even if clear", "", missed.said_unseen),
        ("nothing changed on photographs: something named (false alarm)", "at most 2 %", same.named != ""),
        ("whole cameras: explained", "", whole.verdict == "explained"),
    ]
    counts = [(what, aim, int(hit.sum()), len(hit)) for what, aim, hit in hits]
    if len(whole):
        total = whole[["n_counted", "n_found", "n_named", "n_in_groups", "n_wrong"]].sum().astype(int)
        near = whole.gap_ratio <= MAX_GAP
        counts += [
            (
                "whole cameras: hidden effects named, alone or in a group of at most three",
                "90 % of 60 cameras",
                total.n_found,
                total.n_counted,
            ),
            ("whole cameras: names in groups", "at most 15 %", total.n_in_groups, total.n_named),
            ("whole cameras: wrong names", "at most 5 %", total.n_wrong, total.n_named),
            (
                "held-out gap over that of the twin with the true names, fitted: at most 1.05",
                "95 %",
                int(near.sum()),
                len(near),
            ),
        ]
    inside = parameters.get("inside_95", pd.Series(dtype=bool))
    counts.append(("stated 95 % intervals that hold the truth", "95 % in its interval", int(inside.sum()), len(inside)))
    rows = [share_row(what, aim, int(k), int(n)) for what, aim, k, n in counts if n]
    if len(parameters):
        miss = parameters.miss.to_numpy()
        interval = quantile_test(miss, q=0, p=0.5).confidence_interval(0.95)
        ends = np.round([np.median(miss), interval.low, interval.high], 2)
        rows.append(number_row("stated errors: median miss", "0.5 to 0.85", "standard errors", *ends, len(miss)))
    columns = ["what", "aim", "value", "low", "high", "unit", "hits", "number"]
    return pd.DataFrame(rows, columns=columns).astype({"hits": "Int64"})


def confusion_of(trials):
    """Return the confusion matrix of single trials: hidden effects in rows, what was named first in columns."""
    single = trials[counted_as(trials).isin(["single", "none", "outside"])]
    hidden = single.hidden.replace("", NOTHING)
    said = single.named.str.split().str[0].fillna(single.verdict.map({"adequate": NOTHING}).fillna("(unexplained)"))
    table = pd.crosstab(hidden, said)
    rows = [n for n in (*LIBRARY, *OUTSIDE, NOTHING) if n in table.index]
    columns = [n for n in (*LIBRARY, "(unexplained)", NOTHING) if n in table.columns]
    return table.loc[rows, columns]


def draw_confusion(table, path):
    """Draw the confusion matrix; where nothing belongs in it, an empty picture."""
    if table.empty:
        table = pd.DataFrame(0, index=[NOTHING], columns=[NOTHING])
    size = (1.5 + 0.32 * len(table.columns) + 2, 1.5 + 0.26 * len(table))
    figure, axes = plt.subplots(figsize=size, layout="constrained")
    shown = table.div(table.sum(axis=1), axis=0)
    sns.heatmap(
        shown, annot=table.astype(str).where(table > 0, ""), fmt="",
        cmap="Blues", cbar=False, linewidths=0.3, ax=axes, vmin=0, vmax=1,
    )  # fmt: skip
    axes.set(xlabel="named first", ylabel="hidden", title="Was the hidden effect named? (number of trials)")
    figure.savefig(path, dpi=110)
    plt.close(figure)


def power_of(trials):
    """Return per effect the share of trials named at each strength, the smallest named in at least half, and what it was."""
    power = trials[trials.kind == "power"]
    if power.empty:
        return pd.DataFrame(columns=["hidden", "smallest_seen"])
    table = power.pivot_table(index="hidden", columns="strength", values="set_right", aggfunc="mean")
    seen = [min((s for s in table.columns if row[s] >= 0.5), default=np.nan) for _, row in table.iterrows()]
    of_smallest = power.set_index(["hidden", "strength"]).parameters
    first = of_smallest[~of_smallest.index.duplicated()]
    words = [first.get((effect, strength), "") for effect, strength in zip(table.index, seen, strict=True)]
    return table.assign(smallest_seen=seen, was=words).reset_index()


def summarise_trials(verdicts, truths, true_twins, out):
    """Count all verdicts against their truths and write the tables and the picture; return the summary."""
    rows, parameters = [], []
    for path in sorted(verdicts.glob("*.json")):
        truth = json.loads((truths / path.stem / "truth.json").read_text())
        twins = json.loads((true_twins / path.name).read_text()) if truth["kind"] == "whole" else {}
        for verdict in json.loads(path.read_text()):
            rows.append(trial_row(verdict, truth, twins.get(verdict["camera"])))
            parameters += parameter_rows(verdict, truth)
    trials, parameters = pd.DataFrame(rows), pd.DataFrame(parameters)
    summary = summary_of(trials, parameters)
    tables = {
        "trials": trials.sort_values(["kind", "hidden", "campaign"]),
        "parameters": parameters,
        "summary": summary,
        "confusion": confusion_of(trials).reset_index(),
        "power": power_of(trials),
    }
    for name, table in tables.items():
        with job.write_atomically(out / f"{name}.csv") as file:
            table.to_csv(file, index=False, lineterminator="\n")
    with job.write_atomically(out / "summary.md") as file:
        file.write(summary.to_markdown(index=False) + "\n")
    draw_confusion(confusion_of(trials), out / "confusion.png")
    return summary


def main():
    """Read the command line."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    for name in ("verdicts", "truths", "true-twins", "out"):
        parser.add_argument(f"--{name}", required=True, type=Path)
    a = parser.parse_args()
    print(summarise_trials(a.verdicts, a.truths, a.true_twins, a.out).to_markdown(index=False))


if __name__ == "__main__":
    main()
