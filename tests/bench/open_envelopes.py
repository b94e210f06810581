"""Open the envelopes of blind trials: python tests/bench/open_envelopes.py --verdicts FOLDER --envelopes FOLDER
--out FOLDER.

Verdicts are FOLDER/<campaign>.json (diagnose_trial.py), envelopes FOLDER/<campaign>/truth.json. Makes trials.csv,
summary.csv and summary.md (each aim of the issue with its 95 % interval), confusion.csv and confusion.png, parameters.csv,
power.csv.
"""

import argparse
import json
import sys
from pathlib import Path

HERE = Path(__file__).resolve().parent
sys.path[:0] = [str(HERE), str(HERE.parents[1] / "scripts")]

import matplotlib

matplotlib.use("Agg")
import matplotlib.pyplot as plt
import numpy as np
import pandas as pd
import seaborn as sns

import job
from generator import LIBRARY, OUTSIDE
from rig.metrics import wilson_interval

Z95 = 1.959964
ENOUGH_GAP = 1.05
NOTHING = "(nothing)"


def library_view(effect, p):
    """Return {our parameter: true value} of a hidden effect, as far as conventions map; {} where none does.

    ``p`` are the envelope's library_parameters (docs/blind-trials.md).
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


def trial_row(verdict, truth):
    """Return one trial as a row: what was hidden, what was said."""
    hidden = [e["effect"] for e in truth["effects"]]
    named = [s["effect"] for s in verdict["steps"]]
    inside = [h for h in hidden if h in LIBRARY]
    return {
        "campaign": truth["campaign"],
        "kind": truth["kind"],
        "strength": truth["strength"],
        "camera": verdict["camera"],
        "hidden": " ".join(hidden),
        "parameters": "; ".join(in_words(e) for e in truth["effects"]),
        "verdict": verdict["verdict"],
        "named": " ".join(named),
        "first_right": bool(named) and named[0] in inside,
        "set_right": set(named) == set(inside),
        "gap_before": verdict.get("gap_as_configured"),
        "gap": verdict["gap"],
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
                        "inside_95": abs(found["value"] - value) <= Z95 * found["se"],
                    }
                )
    return rows


def counted_as(trials):
    """Return each trial's kind; a power trial at strength 1 is drawn as a single one is, and counts as one."""
    return trials.kind.mask((trials.kind == "power") & (trials.strength == 1), "single")


def shares(trials, parameters):
    """Return the table of aims: what, aim, successes, number, share and its 95 % interval (all in percent)."""
    kinds = counted_as(trials)
    by = {kind: trials[kinds == kind] for kind in ("single", "pair", "none", "outside")}
    outside = by["outside"]
    named_wrongly = outside.named != ""
    closed = pd.concat([by["single"], by["pair"]])
    lines = [
        ("single effects: the right one first", "95", by["single"].first_right),
        ("single effects: exactly the right set", "", by["single"].set_right),
        ("two effects: exactly the right set", "85", by["pair"].set_right),
        ("nothing hidden: something named (false alarm)", "at most 1", by["none"].named != ""),
        ("nothing hidden: said adequate", "", by["none"].verdict == "adequate"),
        ("outside the library: said unexplained", "90", outside.verdict == "unexplained"),
        ("outside the library: a wrong name given", "at most 5", named_wrongly),
        ("held-out gap after the climb at most 1.05 floors", "95", closed.gap.fillna(np.inf) <= ENOUGH_GAP),
        ("stated 95 % intervals that hold the truth", "93 to 97", parameters.get("inside_95", pd.Series(dtype=bool))),
    ]
    rows = []
    for what, aim, hits in lines:
        k, n = int(hits.sum()), len(hits)
        low, high = wilson_interval(k, n) if n else (np.nan, np.nan)
        rows.append(
            {
                "what": what,
                "aim_pct": aim,
                "hits": k,
                "trials": n,
                "share_pct": round(100 * k / n, 1) if n else np.nan,
                "low_pct": round(100 * low, 1),
                "high_pct": round(100 * high, 1),
            }
        )
    return pd.DataFrame(rows)


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
    """Draw the confusion matrix."""
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


def open_envelopes(verdicts, envelopes, out):
    """Compare all verdicts with their envelopes and write the tables and the picture."""
    out.mkdir(parents=True, exist_ok=True)
    rows, parameters = [], []
    for path in sorted(verdicts.glob("*.json")):
        truth = json.loads((envelopes / path.stem / "truth.json").read_text())
        for verdict in json.loads(path.read_text()):
            rows.append(trial_row(verdict, truth))
            parameters += parameter_rows(verdict, truth)
    trials, parameters = pd.DataFrame(rows), pd.DataFrame(parameters)
    summary = shares(trials, parameters)
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
    for name in ("verdicts", "envelopes", "out"):
        parser.add_argument(f"--{name}", required=True, type=Path)
    a = parser.parse_args()
    print(open_envelopes(a.verdicts, a.envelopes, a.out).to_markdown(index=False))


if __name__ == "__main__":
    main()
