"""The page where a reader starts: what was compared, what came out in words and pictures, links."""

import json
from pathlib import Path

import pandas as pd

import job
from reporting.pages import render, sections_of
from reporting.sentences import compared, ladder_rows, verdict_words


def build_report(
    tables, scene_file, notebooks, headlines_file, provenance_file, diagnoses, ladder_file, explorer, template, page
):
    """Write ``index.html``.

    tables     dict of paths: markers, cameras, stations, captures
    notebooks  executed notebooks, in reading order; each has its page ``NAME.html`` beside ``page``
    diagnoses  ``diagnosis/CAMERA.json`` files, none where nothing was diagnosed
    ladder_file  ``tables/ladder.csv`` or None
    explorer   file name of the page to explore, beside ``page``, or None
    template   the report's jinja2 file
    """
    scene = json.loads(Path(scene_file).read_text())
    frames = {name: pd.read_csv(path, dtype={"station": str}) for name, path in tables.items()}
    verdicts = []
    for path in sorted(diagnoses):
        diagnosis = json.loads(Path(path).read_text())
        verdicts.append((diagnosis["camera"], diagnosis["verdict"], verdict_words(diagnosis)))
    html = render(
        template,
        title=f"{scene.get('name', 'twingap')}: camera against twin",
        simulated=scene.get("origin") == "simulated" and len(frames["captures"]) > 0,
        compared=compared(scene, **frames),
        headlines=json.loads(Path(headlines_file).read_text()),
        sections=sections_of(notebooks),
        verdicts=verdicts,
        ladder=ladder_rows(ladder_file) if ladder_file else None,
        explorer=explorer,
        provenance=json.loads(Path(provenance_file).read_text()),
    )
    with job.write_atomically(page) as file:
        file.write(html)


if __name__ == "__main__":
    job.run(
        build_report,
        snakemake,
        tables={name: snakemake.input[name] for name in ("markers", "cameras", "stations", "captures")},
        scene_file=snakemake.input.scene,
        notebooks=snakemake.input.notebooks,
        headlines_file=snakemake.input.headlines,
        provenance_file=snakemake.input.provenance,
        diagnoses=snakemake.input.get("diagnoses", []),
        ladder_file=next(iter(snakemake.input.get("ladder", [])), None),
        explorer=next(iter(snakemake.params.explorer), None),
        template=snakemake.input.template,
        page=snakemake.output.page,
    )
