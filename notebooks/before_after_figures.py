"""Tables 1 and 2 and their figures for two twins: the ideal one, and the one with the effects that a verdict names."""

import html
import json
from pathlib import Path
from types import SimpleNamespace

import figures
import pandas as pd
from IPython.display import HTML

TWINS = {"ideal": "before", "explained": "after"}
CHANGES = {
    "coverage_twin_pct": ("twin's coverage", "%", 1),
    "kappa": ("kappa", "", 2),
    "delta_distance_cm": ("Δdistance", "cm", 2),
    "delta_rotation_deg": ("Δrotation", "°", 2),
    "flip_rate_pct": ("flips", "%", 1),
}


def read_comparison(results):
    """Return a namespace: ``table``, ``cells`` of Table 1's detector for both twins, ``verdicts`` {camera: dict}."""
    results = Path(results)
    table = figures.read_table(results / "tables/before_after.csv")
    cameras = sorted(set(table.camera))
    parts = [pd.read_parquet(results / f"compare/{camera}.parquet") for camera in cameras]
    cells = pd.concat(parts, ignore_index=True)
    cells = cells[cells.available & (cells.detector == figures.reference_detector(results))]
    verdicts = {camera: json.loads((results / f"diagnosis/{camera}.json").read_text()) for camera in cameras}
    return SimpleNamespace(table=table, cells=cells, verdicts=verdicts, reference=figures.reference_detector(results))


def before_after_words(comparison):
    """Return a sentence or two a camera: what was added, and what became of Table 1's differences."""
    lines = []
    for camera, verdict in comparison.verdicts.items():
        named = [e["effect"] for e in [*verdict.get("configured", []), *verdict["steps"]]]
        if not named:
            lines.append(f"**{camera}**: no effect was adopted or named, so before and after are the same twin.")
            continue
        rows = comparison.table[
            (comparison.table.camera == camera) & (comparison.table.algorithm == comparison.reference)
        ]
        before, after = (rows[rows.twin_is == name].iloc[0] for name in TWINS)
        words = [
            f"{title} {before[name]:.{digits}f} → {after[name]:.{digits}f}{' ' + unit if unit else ''}"
            for name, (title, unit, digits) in CHANGES.items()
            if pd.notna(before[name]) and pd.notna(after[name])
        ]
        lines.append(f"**{camera}**, + {', '.join(f'`{n}`' for n in named)}: {'; '.join(words)}.")
    return lines


def before_after_table(table):
    """Return Table 2 as HTML, a row a camera and algorithm, each measure before and after with its interval."""
    heads = [
        f"{title}{' ' + unit if unit else ''}, {words}"
        for title, unit, _ in CHANGES.values()
        for words in TWINS.values()
    ]
    parts = [
        '<div class="wide" style="overflow-x:auto"><table><thead><tr><th>camera</th><th>algorithm</th><th>coverage, real %</th>'
    ]
    parts += [f"<th>{html.escape(head)}</th>" for head in heads]
    parts.append("</tr></thead><tbody>")
    for (camera, algorithm), rows in table.groupby(["camera", "algorithm"], sort=False):
        by_twin = rows.set_index("twin_is")
        parts.append(f"<tr><td>{html.escape(camera)}</td><td>{html.escape(algorithm)}</td>")
        parts.append(f"<td>{_with_interval(by_twin.loc['ideal'], 'coverage_pct', 1)}</td>")
        for name, (_, _, digits) in CHANGES.items():
            parts += [f"<td>{_with_interval(by_twin.loc[twin], name, digits)}</td>" for twin in TWINS]
        parts.append("</tr>")
    parts.append("</tbody></table></div>")
    return HTML("".join(parts))


def _with_interval(row, name, digits):
    if pd.isna(row[name]):
        return ""
    low, high = row[f"{name}_low"], row[f"{name}_high"]
    interval = "" if pd.isna(low) else f"<br><small>({low:.{digits}f} to {high:.{digits}f})</small>"
    return f"{row[name]:.{digits}f}{interval}"
