"""Tables 1 and 2 from the cells: CSV at full precision; Markdown and LaTeX beside the paper's values."""

import json
import logging
from pathlib import Path

import numpy as np
import pandas as pd
from tabulate import tabulate

import job
from reporting.metrics import kappa_with_interval, mean_with_interval, wilson_interval

log = logging.getLogger("twingap")

# The paper's Table 1 compares cameras by one detector, OpenCV's ArUco as it comes.
PAPERS_DETECTOR = "aruco"

# Table 1 of Krumstroh et al., "Comparing Fiducial Marker Tracking Across Cameras", as far as it is known to
# us: coverage of the real images, and a "precision" that is a ratio of counts.
PUBLISHED = {
    "hp325": {"coverage_pct": 88.76, "precision_pct": 94.0},
    "brio": {"coverage_pct": 84.02, "precision_pct": 91.0},
    "quest3": {"coverage_pct": 72.41, "precision_pct": 97.0},
}
PUBLISHED_NOTE = (
    "The paper's rows give what its Table 1 states, as far as it is known; n/a is not available to us. "
    "Its precision is a ratio of two counts, which can exceed 100 % and rewards a low coverage; ours is the "
    "share of the twin's detections that the photograph has too. Of its distance differences we know only "
    "that they span 1.7 to 3.4 cm over the cameras. Its images, rig positions and resolutions are not ours: "
    "compare orders of magnitude, not digits."
)

MEASURES = ["coverage_pct", "precision_pct", "recall_pct", "kappa", "delta_distance_cm", "delta_rotation_deg"]
MEASURES += ["flip_rate_pct"]
EXTRA_MEASURES = ["coverage_twin_pct", "delta_distance_signed_pct"]
COUNTS = ["n_captures", "n_cells", "n_real", "n_twin", "n_both", "n_pairs", "n_flips"]


def columns_of(first):
    """Return the tables' column names: identity, measures, counts, then intervals and extras."""
    intervals = [f"{m}_{end}" for m in MEASURES for end in ("low", "high")]
    extras = [f"{m}{end}" for m in EXTRA_MEASURES for end in ("", "_low", "_high")]
    extras += ["coverage_rig_pct", "coverage_rig_twin_pct", *COUNTS]
    return [*first, *intervals, *extras]


TABLE1 = columns_of(["camera", *MEASURES, "n_markers"])
TABLE1.append("algorithm")
TABLE2 = columns_of(["camera", "algorithm", *MEASURES, "n_markers", "false_ids"])
TABLE2.append("false_ids_twin")
BY_TYPE = [*TABLE2[:2], "dictionary", *TABLE2[2:]]
TABLE1_BY_TYPE = ["camera", "dictionary", *TABLE1[1:]]


def share(row, name, part, whole):
    """Put a percentage and its Wilson interval into ``row``; NaN where there is nothing to divide by."""
    low, high = wilson_interval(part, whole)
    row[name] = 100 * part / whole if whole else np.nan
    row[f"{name}_low"], row[f"{name}_high"] = 100 * low, 100 * high


def measures_of(cells, *names):
    """Return a dict of all measures of the cells of one camera and detector; ``names`` seed the bootstrap.

    ``n_markers`` counts the markers that were there to be found: one per capture and available marker.
    """
    there = cells[cells.available]
    has_real = bool(cells.has_real.any())
    pairs = there[there.paired]
    steady = pairs[~pairs.flipped]
    both = int((there.real & there.twin).sum())
    row = {"n_markers": len(there), "n_captures": cells.capture.nunique(), "n_cells": len(cells)}
    row["n_twin"] = int(there.twin.sum())
    share(row, "coverage_twin_pct", row["n_twin"], len(there))
    row["coverage_rig_twin_pct"] = 100 * row["n_twin"] / len(cells) if len(cells) else np.nan
    if not has_real:
        return row
    row |= {"n_real": int(there.real.sum()), "n_both": both}
    row |= {"n_pairs": len(pairs), "n_flips": int(pairs.flipped.sum())}
    share(row, "coverage_pct", row["n_real"], len(there))
    row["coverage_rig_pct"] = 100 * row["n_real"] / len(cells) if len(cells) else np.nan
    share(row, "precision_pct", both, row["n_twin"])
    share(row, "recall_pct", both, row["n_real"])
    share(row, "flip_rate_pct", row["n_flips"], len(pairs))
    row["kappa"], row["kappa_low"], row["kappa_high"] = kappa_with_interval(
        there.real.to_numpy(), there.twin.to_numpy(), there.capture, _rng("kappa", *names)
    )
    for name, values in (
        ("delta_distance_cm", 100 * steady.delta_distance_m.abs()),
        ("delta_distance_signed_pct", 100 * steady.delta_distance_m / steady.range_m),
        ("delta_rotation_deg", steady.rotation_deg),
    ):
        row[name], row[f"{name}_low"], row[f"{name}_high"] = mean_with_interval(
            values.to_numpy(), steady.capture, _rng(name, *names)
        )
    return row


def _rng(*names):
    return np.random.default_rng(job.seed_of("tables", *names))


def make_table2(cells, false_ids, campaign):
    """Return Table 2: a row per camera and algorithm, all TABLE2 columns."""
    wrong = false_ids.groupby(["camera", "detector", "source"]).size()
    rows = []
    for (camera, detector), mine in cells.groupby(["camera", "detector"], sort=True):
        row = {"camera": camera, "algorithm": detector} | measures_of(mine, campaign, camera, detector)
        if mine.has_real.any():
            row["false_ids"] = wrong.get((camera, detector, "real"), 0)
        row["false_ids_twin"] = wrong.get((camera, detector, "twin"), 0)
        rows.append(row)
    table = pd.DataFrame(rows, columns=TABLE2)
    whole = ["n_markers", "false_ids", "false_ids_twin", *COUNTS]
    return table.astype(dict.fromkeys(whole, "Int64"))


def make_by_type(cells, false_ids, campaign, read):
    """Return Table 2 for each family of markers by itself: a row per camera, algorithm and family that it reads, BY_TYPE columns.

    read  {algorithm: families that it reads}
    """
    parts = [
        make_table2(mine, false_ids[false_ids.dictionary == family], f"{campaign} {family}").assign(dictionary=family)
        for family, mine in cells.groupby("dictionary", sort=True)
    ]
    table = pd.concat(parts) if parts else pd.DataFrame(columns=BY_TYPE)
    able = [d in read.get(a, ()) for a, d in zip(table.algorithm, table.dictionary, strict=True)]
    return table[np.array(able, bool)].sort_values(["camera", "algorithm", "dictionary"], ignore_index=True)[BY_TYPE]


def make_table1_by_type(by_type, reference, read):
    """Return Table 1 for each family by itself: of BY_TYPE rows those of one detector a family, TABLE1_BY_TYPE columns.

    That is the reference detector where it reads the family, else the first of ``read`` that does.
    """
    chosen = {}
    for name in (reference, *read):
        for family in read.get(name, ()):
            chosen.setdefault(family, name)
    mine = by_type.algorithm == by_type.dictionary.map(chosen)
    return by_type[mine].sort_values(["camera", "dictionary"], ignore_index=True)[TABLE1_BY_TYPE]


def make_table1(table2, reference):
    """Return Table 1: the rows of the reference detector."""
    return table2[table2.algorithm == reference][TABLE1].reset_index(drop=True)


HEADINGS = {
    "coverage_pct": ("coverage", "%", 1),
    "coverage_twin_pct": ("twin's coverage", "%", 1),
    "precision_pct": ("precision", "%", 1),
    "recall_pct": ("recall", "%", 1),
    "kappa": ("kappa", "", 2),
    "delta_distance_cm": ("Δdistance", "cm", 2),
    "delta_rotation_deg": ("Δrotation", "°", 2),
    "flip_rate_pct": ("flips", "%", 1),
}
SHOWN = list(HEADINGS)


def cell_text(row, name):
    """Return ``value (low to high)``, rounded for reading; empty where there is no value."""
    digits = HEADINGS[name][2]
    if pd.isna(row[name]):
        return ""
    low, high = row[f"{name}_low"], row[f"{name}_high"]
    interval = "" if pd.isna(low) else f" ({low:.{digits}f} to {high:.{digits}f})"
    return f"{row[name]:.{digits}f}{interval}"


def readable(table, first, counts):
    """Return (headings, rows of text) of a table, with the paper's rows under those of its cameras."""
    headings = [*first, *(" ".join(filter(None, HEADINGS[n][:2])) for n in SHOWN), *counts.values()]
    rows = []
    for _, row in table.iterrows():
        whole = ["" if pd.isna(row[name]) else str(row[name]) for name in counts]
        rows.append([*(row[name] for name in first), *(cell_text(row, name) for name in SHOWN), *whole])
        stated = PUBLISHED.get(row.camera) if row.algorithm == PAPERS_DETECTOR else None
        if stated:
            values = [f"{stated[name]:g}" if name in stated else "n/a" for name in SHOWN]
            others = [row[name] for name in first[1:]]
            rows.append([f"{row.camera}, paper", *others, *values, *["n/a"] * len(counts)])
    return headings, rows


def markdown(headings, rows, caption, notes):
    """Return a Markdown table with its caption above and notes below."""
    return "\n".join([caption, "", tabulate(rows, headings, tablefmt="github", disable_numparse=True), "", *notes, ""])


def latex(headings, rows, caption, notes):
    """Return a LaTeX table (booktabs, graphicx) with caption and notes."""

    def escape(text):
        for plain, tex in (("%", r"\%"), ("_", r"\_"), ("Δ", r"$\Delta$"), ("°", r"$^\circ$")):
            text = text.replace(plain, tex)
        return text

    lines = [" & ".join(map(escape, cells)) + r" \\" for cells in (headings, *rows)]
    return "\n".join(
        [
            r"\begin{table}",
            r"\centering",
            rf"\caption{{{escape(caption)}}}",
            r"\resizebox{\linewidth}{!}{%",
            rf"\begin{{tabular}}{{l{'r' * (len(headings) - 1)}}}",
            r"\toprule",
            lines[0],
            r"\midrule",
            *lines[1:],
            r"\bottomrule",
            r"\end{tabular}}",
            *(rf"\par\footnotesize {escape(note)}" for note in notes),
            r"\end{table}",
            "",
        ]
    )


def notes_of(table, origin):
    """Return the sentences under a table: what the numbers are, and what they are not."""
    if table.empty:
        return ["This campaign has no markers to detect, so there is nothing to count."]
    notes = [
        "In brackets: 95 % intervals, Wilson for shares, bootstrap over captures for kappa and means. Flips "
        "of the planar ambiguity are counted apart and not averaged in."
    ]
    if table.n_real.isna().all():
        notes.append("No photographs: coverage of the twin alone.")
    elif origin == "simulated":
        notes.append("The images called real are a simulated stand-in for captures.")
    if (table.algorithm == PAPERS_DETECTOR).any() and table.camera.isin(PUBLISHED).any():
        notes.append(PUBLISHED_NOTE)
    return notes


def headline(row):
    """Return what a row of Table 1 says, in words made from its numbers."""
    if row.n_markers == 0:
        return f"{row.camera}: no marker is known to lie wholly in any picture."
    if pd.isna(row.n_real):
        return (
            f"{row.camera}: the twin lets {row.algorithm} find {row.coverage_twin_pct:.1f} % of "
            f"{row.n_markers} markers; there are no photographs to compare with."
        )
    if row.n_real == row.n_twin == 0:
        return (
            f"{row.camera}: {row.algorithm} finds none of {row.n_markers} markers, neither in the real images nor in "
            "the twin's."
        )
    words = (
        f"{row.camera}: of {row.n_markers} markers in the pictures, {row.algorithm} finds "
        f"{row.coverage_pct:.1f} % in the real images and {row.coverage_twin_pct:.1f} % in the twin's. "
        f"The twin misses {row.n_real - row.n_both} that the real images have and has "
        f"{row.n_twin - row.n_both} that they miss"
    )
    words += f" (kappa {row.kappa:.2f})." if pd.notna(row.kappa) else "."
    if row.n_pairs == 0:
        return f"{words} No marker was found by both, so there is no pose to compare."
    if pd.notna(row.delta_distance_cm):
        words += (
            f" Where both find a marker, its distances differ by {row.delta_distance_cm:.1f} cm and "
            f"its poses by {row.delta_rotation_deg:.1f}° on average"
        )
    else:
        words += " Of the pairs none is left to average"
    return f"{words}; {row.n_flips} of {row.n_pairs} pairs are flips, counted apart."


def headlines_of(table1):
    """Return a sentence or more per camera, and one for a campaign without markers."""
    if table1.empty:
        return ["This campaign has no markers to detect, so there is nothing to count."]
    return [headline(row) for row in table1.itertuples()]


def make_tables(cells_file, false_ids_file, scene_file, reference, tables, read=None):
    """Write Tables 1 and 2, both by families of markers too, and the headlines, a JSON list of sentences.

    reference  detector whose rows are Table 1
    tables  dict of paths by file name: ``table1.csv``, ``.md``, ``.tex``, so for table2, ``headlines.json``; where ``read``
            is given ``table1_by_type.csv`` and ``table2_by_type.csv``
    read    {detector: families of markers that it reads}
    """
    cells, false_ids = pd.read_parquet(cells_file), pd.read_parquet(false_ids_file)
    scene = json.loads(Path(scene_file).read_text())
    table2 = make_table2(cells, false_ids, scene.get("name", ""))
    table1 = make_table1(table2, reference)
    algorithm = table1.algorithm.iloc[0] if len(table1) else "no detector"
    captions = {
        "table1": f"Table 1. Real against twin by camera, detector {algorithm}.",
        "table2": "Table 2. Real against twin by camera and algorithm.",
    }
    layout = {
        "table1": (table1, ["camera"], {"n_markers": "markers"}),
        "table2": (
            table2,
            ["camera", "algorithm"],
            {"n_markers": "markers", "false_ids": "false ids", "false_ids_twin": "twin's false ids"},
        ),
    }
    for name, (table, first, counts) in layout.items():
        headings, rows = readable(table, first, counts)
        notes = notes_of(table, scene.get("origin"))
        with job.write_atomically(tables[f"{name}.csv"]) as file:
            table.to_csv(file, index=False, lineterminator="\n")
        for suffix, form in (("md", markdown), ("tex", latex)):
            with job.write_atomically(tables[f"{name}.{suffix}"]) as file:
                file.write(form(headings, rows, captions[name], notes))
    if read is not None:
        by_type = make_by_type(cells, false_ids, scene.get("name", ""), read)
        of_table1 = make_table1_by_type(by_type, reference, read)
        for name, table in (("table1_by_type.csv", of_table1), ("table2_by_type.csv", by_type)):
            with job.write_atomically(tables[name]) as file:
                table.to_csv(file, index=False, lineterminator="\n")
    with job.write_atomically(tables["headlines.json"]) as file:
        json.dump(headlines_of(table1), file, ensure_ascii=False, indent=1)
        file.write("\n")


if __name__ == "__main__":
    job.run(
        make_tables,
        snakemake,
        cells_file=snakemake.input.cells,
        false_ids_file=snakemake.input.false_ids,
        scene_file=snakemake.input.scene,
        reference=snakemake.params.reference,
        tables={Path(path).name: path for path in snakemake.output},
        read=snakemake.params.read,
    )
