"""What a study of twins says: coverage beside what was published, by each effect, by choices that were left open, by heights.

Coverage is told twice: of the markers wholly in the picture, and of all markers of the rig (``rig``).
"""

import logging

import numpy as np
import pandas as pd

import job
from inputs.tables import read_table
from reporting.metrics import wilson_interval
from study_twin import READINGS
from twin_study.variants import ALONE, CHOICE, IDEAL, WHOLE, WITHOUT

log = logging.getLogger("twingap")

KEYS = ["camera", "detector"]
VARIANT = ["kind", "name", "open"]
SUMS = ["markers", "found", "rig", "false_ids"]
WORDS = {IDEAL: "no effect", WHOLE: "all effects", ALONE: "only {}", WITHOUT: "all but {}", CHOICE: "{}"}
SHOWN = {"coverage_pct": "picture, %", "coverage_rig_pct": "rig, %"}


def with_coverage(table):
    """Return a table with counts SUMS and coverage_pct, its Wilson interval (_low, _high) and coverage_rig_pct."""
    intervals = np.array([wilson_interval(int(r.found), int(r.markers)) for r in table.itertuples()]).reshape(-1, 2)
    share = (100 * table.found / table.markers.where(table.markers > 0)).astype(float)
    return table.assign(
        coverage_pct=share,
        coverage_pct_low=100 * intervals[:, 0],
        coverage_pct_high=100 * intervals[:, 1],
        coverage_rig_pct=100 * table.found / table.rig,
    )


def by_variant(readings):
    """Return a row a camera, detector and twin, in the order in which they were looked at: counts and coverage."""
    return with_coverage(readings.groupby([*KEYS, *VARIANT], sort=False)[SUMS].sum().reset_index())


def ablation_of(variants):
    """Return the rows without choices, with ``change_pct``: coverage less the ideal twin's; of WITHOUT less the whole twin's."""
    table = variants[variants.kind != CHOICE].copy()
    ideal, whole = (_coverage_of(variants, kind) for kind in (IDEAL, WHOLE))
    base = [(whole if r.kind == WITHOUT else ideal)[r.camera, r.detector] for r in table.itertuples()]
    table["twin"] = [WORDS[r.kind].format(r.name_) for r in table.rename(columns={"name": "name_"}).itertuples()]
    table["change_pct"] = table.coverage_pct - base
    return table.drop(columns="open")


def choices_of(variants, published):
    """Return the rows of choices: ``change_pct`` of coverage by it, ``nearer_pct`` and ``nearer_rig_pct``: by how much nearer
    both coverages come to the published {camera: %}.
    """
    table = variants[variants.kind == CHOICE].rename(columns={"name": "choice"}).drop(columns="kind")
    for name in SHOWN:
        whole = _coverage_of(variants, WHOLE, name)
        base = np.array([whole[r.camera, r.detector] for r in table.itertuples()])
        real = table.camera.map(published).to_numpy(float)
        short = name.removeprefix("coverage_")
        table[f"change_{short}"] = table[name] - base
        table[f"nearer_{short}"] = np.abs(base - real) - np.abs(table[name] - real)
    return table[["open", "choice", *KEYS, *[c for c in table if c not in ("open", "choice", *KEYS)]]]


def _coverage_of(variants, kind, name="coverage_pct"):
    return variants[variants.kind == kind].set_index(KEYS)[name]


def by_height(cells, detectors):
    """Return a row a camera, detector and height of the experiment's own twins: counts and coverage."""
    cells = cells[cells.detector.isin(detectors)]
    counts = cells.assign(markers=cells.available, found=cells.available & cells.twin, rig=1)
    table = counts.groupby([*KEYS, "height_m"])[["markers", "found", "rig"]].sum().reset_index()
    return with_coverage(table)


def beside_published(table2, variants, published, detectors):
    """Return a row a camera and detector: coverage of the experiment's twins at all stations and what was published; of the
    study's stations without effects, with all, and what the effects take.
    """
    names = {"algorithm": "detector", "coverage_rig_twin_pct": "coverage_rig_pct"}
    names |= {f"coverage_twin_pct{end}": f"coverage_pct{end}" for end in ("", "_low", "_high")}
    table = table2[["camera", "n_markers", *names]].rename(columns=names)
    table = table[table.detector.isin(detectors)].reset_index(drop=True)
    table["published_pct"] = table.camera.map(published)
    table["over_published_pct"] = table.coverage_pct - table.published_pct
    at = pd.MultiIndex.from_frame(table[KEYS])
    for kind in (IDEAL, WHOLE):
        table[f"{kind}_pct"] = _coverage_of(variants, kind).reindex(at).to_numpy()
    table["effects_take_pct"] = table.ideal_pct - table.whole_pct
    return table


def markdown(table, keys, values):
    """Return a Markdown table: a row for each of ``keys`` {name: heading} in the order of the table, for each detector the
    ``values`` {name: heading}; numbers with one digit after the point.
    """
    rows = table[list(keys)].drop_duplicates().rename(columns=keys)
    for detector, mine in table.groupby("detector", sort=False):
        shown = mine[[*keys, *values]].rename(columns=keys | {n: f"{detector}: {words}" for n, words in values.items()})
        rows = rows.merge(shown, how="left", on=list(keys.values()))
    return rows.to_markdown(index=False, floatfmt=".1f", missingval="")


def page_of(tables, study):
    """Return the study in words and tables, Markdown."""
    camera, markers = {"camera": "camera"}, {"markers": "markers"}
    heights = ", ".join(f"{h:g}" for h in study["heights_m"])
    nearer = {"nearer_pct": "nearer", "nearer_rig_pct": "nearer, rig"}
    parts = [
        "### Coverage of the twins beside the published one",
        "All stations. The twins with all effects; of the markers in the picture, of the rig's, and by how much the former "
        "exceeds what was published.",
        markdown(
            tables["coverage"],
            camera | {"n_markers": "markers", "published_pct": "published, %"},
            SHOWN | {"over_published_pct": "over"},
        ),
        "### With and without each effect",
        f"Stations at {heights} m. The change is of the markers in the picture: from the twin without effects, and in the rows "
        '"all but" from that with all.',
        claim(tables["coverage"]),
        markdown(tables["ablation"], camera | {"twin": "the twin has"} | markers, SHOWN | {"change_pct": "change"}),
        "### What is left open",
        "One choice at a time in the twin with all effects, the same stations. Nearer: by how many percentage points coverage "
        "comes nearer to the published one; negative: it goes away.",
        best_choices(tables["choices"]),
        markdown(tables["choices"], {"open": "left open", "choice": "choice"} | camera | markers, SHOWN | nearer),
        "### By height",
        "The twins with all effects at all stations.",
        markdown(tables["heights"], camera | {"height_m": "height, m"} | markers, SHOWN),
    ]
    return "\n\n".join(part for part in parts if part) + "\n"


def claim(whole):
    """Return a line a camera and detector: by how much simulation overestimates detection."""
    lines = []
    for row in whole.itertuples():
        words = (
            f"- {row.camera}, {row.detector}: without effects the twin's coverage is {row.ideal_pct:.1f} %, with all "
            f"{row.whole_pct:.1f} %: the effects take {row.effects_take_pct:.1f} percentage points"
        )
        if pd.notna(row.published_pct):
            over = [_over(pct - row.published_pct) for pct in (row.ideal_pct, row.whole_pct)]
            words += f"; of real images {row.published_pct:g} % are published: {over[0]} without, {over[1]} with them"
        lines.append(f"{words}.")
    return "\n".join(lines)


def best_choices(choices):
    """Return a line a camera and detector: the choice that comes nearest to what was published; empty without any."""
    lines = []
    for (camera, detector), mine in choices.dropna(subset="nearer_pct").groupby(KEYS, sort=False):
        best = mine.loc[mine.nearer_pct.idxmax()]
        come = "comes nearest" if best.nearer_pct > 0 else "goes away least"
        lines.append(
            f'- {camera}, {detector}: {best.open}, "{best.choice}", {come}: {best.coverage_pct:.1f} %, by '
            f"{best.nearer_pct:.1f} points."
        )
    return "\n".join(lines)


def _over(points):
    return f"{abs(points):.1f} points too {'high' if points > 0 else 'low'}"


def summarise_study(readings, cells, table2, study, page, tables):
    """Write the study's tables (CSV) and its page (Markdown).

    readings of all cameras, paths; cells and table2 of the experiment; tables {name: path} of coverage, ablation, choices,
    heights
    """
    variants = by_variant(pd.concat([read_table(path, READINGS) for path in readings], ignore_index=True))
    published, detectors = study["published_pct"], study["detectors"]
    made = {
        "coverage": beside_published(pd.read_csv(table2), variants, published, detectors),
        "ablation": ablation_of(variants),
        "choices": choices_of(variants, published),
        "heights": by_height(pd.read_parquet(cells), detectors),
    }
    for name, table in made.items():
        with job.write_atomically(tables[name]) as file:
            table.to_csv(file, index=False, lineterminator="\n")
    with job.write_atomically(page) as file:
        file.write(page_of(made, study))
    log.info("\n%s", claim(made["coverage"]))


if __name__ == "__main__":
    job.run(
        summarise_study,
        snakemake,
        readings=snakemake.input.readings,
        cells=snakemake.input.cells,
        table2=snakemake.input.table2,
        study=snakemake.params.study,
        page=snakemake.output.page,
        tables=dict(zip(("coverage", "ablation", "choices", "heights"), snakemake.output.tables, strict=True)),
    )
