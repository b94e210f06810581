"""Rank: which ids of the study are safe: coverage, false ids, confusions by how many cells differ, the worst in pictures."""

import logging
from pathlib import Path

import cv2
import numpy as np
import pandas as pd

import job
from id_study.distances import cells_of, distances_between, nearest_others
from id_study.views import study_image, study_noise, study_scene, study_views
from inputs.tables import read_table
from markers.contract import drawing_of
from reporting.metrics import wilson_interval
from reporting.pages import data_uri, render
from study_ids import READINGS

log = logging.getLogger("twingap")

TEMPLATE = Path(__file__).parent / "reporting/ids_template.html.j2"
WORST = 12  # of a family and detector, with pictures
CODE_PX, ENLARGED = 8, 2  # of a cell; of a view's picture


def by_id(readings, families):
    """Return a row a family, id and detector: views, read, coverage_pct, false_ids, nearest_id and nearest_cells."""
    once = readings.drop_duplicates(["dictionary", "id", "view", "detector"])
    keys = ["dictionary", "id", "detector"]
    table = once.groupby(keys).agg(views=("read", "size"), read=("read", "sum"))
    table["coverage_pct"] = 100 * table.read / table.views
    table["false_ids"] = readings[readings.false_id.notna()].groupby(keys).size()
    table = table.fillna({"false_ids": 0}).astype({"false_ids": int, "read": int}).reset_index()
    near = {family: None if cells is None else nearest_others(cells)[:2] for family, cells in families.items()}
    table["nearest_id"] = _looked_up(table, near, 0)
    table["nearest_cells"] = _looked_up(table, near, 1)
    return table.sort_values(["dictionary", "detector", "id"], ignore_index=True)


def _looked_up(table, near, column):
    values = [
        None if near[family] is None else int(near[family][column][number])
        for family, number in zip(table.dictionary, table.id, strict=True)
    ]
    return pd.array(values, dtype="Int64")


def by_family(ids):
    """Return a row a family and detector: ids, coverage with its interval, ids read everywhere and nowhere, false ids."""
    rows = []
    for (family, detector), group in ids.groupby(["dictionary", "detector"]):
        low, high = wilson_interval(int(group.read.sum()), int(group.views.sum()))
        rows.append(
            {
                "dictionary": family,
                "detector": detector,
                "ids": len(group),
                "views": int(group.views.iloc[0]),
                "coverage_pct": 100 * group.read.sum() / group.views.sum(),
                "coverage_pct_low": 100 * low,
                "coverage_pct_high": 100 * high,
                "ids_always_read": int((group.read == group.views).sum()),
                "ids_never_read": int((group.read == 0).sum()),
                "ids_with_false": int((group.false_ids > 0).sum()),
                "false_ids": int(group.false_ids.sum()),
            }
        )
    return pd.DataFrame(rows)


def confusions_of(readings, families):
    """Return a row a true and a seen id: dictionary, id, detector, seen_dictionary, seen_id, cells that differ, times."""
    wrong = readings[readings.false_id.notna()]
    keys = ["dictionary", "id", "detector", "false_dictionary", "false_id"]
    table = wrong.groupby(keys).size().rename("times").reset_index()
    differ = []
    for row in table.itertuples():
        a, b = families.get(row.dictionary), families.get(row.false_dictionary)
        same = a is not None and b is not None and a.shape[1:] == b.shape[1:]
        differ.append(int(distances_between(a[[row.id]], b[[int(row.false_id)]])[0, 0]) if same else None)
    table["cells"] = pd.array(differ, dtype="Int64")
    names = {"false_dictionary": "seen_dictionary", "false_id": "seen_id"}
    return table.rename(columns=names).sort_values(
        ["times", "dictionary", "id", "detector", "seen_dictionary", "seen_id"],
        ascending=[False, *[True] * 5],
        ignore_index=True,
    )


def by_distance(confusions, families, studied):
    """Return a row a family and number of cells that differ: pairs of ids at this distance of which one was studied, and
    how many pairs of them were confused, how often.
    """
    rows = []
    for family, cells in families.items():
        if cells is None:
            continue
        between = nearest_others(cells)[2][studied[family]]
        mine = confusions[(confusions.dictionary == family) & (confusions.seen_dictionary == family)]
        for distance in np.unique(between[between < cells[0].size]):
            at = mine[mine.cells == distance]
            pairs = len(at[["id", "seen_id"]].drop_duplicates())
            rows.append([family, int(distance), int((between == distance).sum()), pairs, int(at.times.sum())])
    return pd.DataFrame(rows, columns=["dictionary", "cells", "pairs", "confused_pairs", "times"])


def worst_ids(ids, readings, views, seed):
    """Return, a family and detector, the WORST ids with pictures: most false ids first, then least coverage."""
    chosen = study_views(views)
    parts = []
    for (family, detector), group in ids.groupby(["dictionary", "detector"]):
        worst = group.sort_values(["false_ids", "read", "id"], ascending=[False, True, True]).head(WORST)
        mine = readings[(readings.dictionary == family) & (readings.detector == detector)]
        rows = [_row(r, mine[mine.id == r.id], chosen, seed) for r in worst.itertuples()]
        parts.append({"family": family, "detector": detector, "rows": rows})
    return parts


def _row(row, readings, views, seed):
    """Return what the page shows of one id: its numbers, its code, the first view in which it was taken for another or missed."""
    wrong = readings[readings.false_id.notna()]
    missed = readings[~readings.read]
    shown = wrong if len(wrong) else missed
    picture, words = None, "read in every view"
    if len(shown):
        view = next(v for v in views if v.capture == shown.view.iloc[0])
        picture = _picture(study_image(study_scene(row.dictionary, row.id), view, study_noise(view, seed)), ENLARGED)
        seen = [f"{w.false_dictionary} {w.false_id}" for w in wrong[wrong.view == view.capture].itertuples()]
        words = f"{view.capture}: " + (f"taken for {', '.join(seen)}" if seen else "not read")
    drawing = drawing_of(row.dictionary, row.id)
    code = None if len(drawing.discs) else _picture(np.where(drawing.white, 255, 0).astype(np.uint8), CODE_PX)
    return row._asdict() | {"picture": picture, "words": words, "code": code}


def _picture(image, times):
    """Return an image as a PNG in a data URI, each pixel enlarged."""
    larger = np.kron(image, np.ones((times, times), np.uint8))
    return data_uri(cv2.imencode(".png", larger)[1].tobytes())


def rank_ids(tables, families, views, seed, out):
    """Write ids.csv, families.csv, confusions.csv, distances.csv and report.html of the study's readings to a folder."""
    readings = pd.concat([read_table(path, READINGS) for path in tables], ignore_index=True)
    cells = {family: cells_of(family) for family in families}
    ids = by_id(readings, cells)
    confusions = confusions_of(readings, cells)
    studied = {family: sorted(set(ids[ids.dictionary == family].id)) for family in families}
    made = {
        "ids": ids,
        "families": by_family(ids),
        "confusions": confusions,
        "distances": by_distance(confusions, cells, studied),
    }
    for name, table in made.items():
        with job.write_atomically(Path(out) / f"{name}.csv") as file:
            table.to_csv(file, index=False, lineterminator="\n")
    page = render(
        TEMPLATE,
        title="Which ids are safe?",
        families=made["families"].to_dict("records"),
        distances=made["distances"].to_dict("records"),
        confusions=confusions.head(WORST).to_dict("records"),
        worst=worst_ids(ids, readings, views, seed),
        views=views,
    )
    with job.write_atomically(Path(out) / "report.html") as file:
        file.write(page)
    log.info("%d ids: %s", ids.groupby(["dictionary", "id"]).ngroups, Path(out) / "report.html")


if __name__ == "__main__":
    job.run(
        rank_ids,
        snakemake,
        tables=snakemake.input.readings,
        families=snakemake.params.families,
        views=snakemake.params.views,
        seed=snakemake.params.seed,
        out=Path(snakemake.output.page).parent,
    )
