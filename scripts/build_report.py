"""The page where a reader starts: what was compared, what came out in words and pictures, links."""

import json
from pathlib import Path

import pandas as pd

import job
from rig.words import LADDER, gap_along, with_error
from run_notebook import render, title_of


def pictures_of(notebook):
    """Return the HTML that cells tagged ``report`` displayed, joined."""
    parts = []
    for cell in notebook.cells:
        if "report" in cell.metadata.get("tags", []) and cell.cell_type == "code":
            parts += [o.data["text/html"] for o in cell.outputs if "text/html" in o.get("data", {})]
    return "\n".join(parts)


def lead_of(notebook):
    """Return the HTML of what the notebook's first cell says below its title: how to read the pictures."""
    from nbconvert.filters import markdown2html

    return markdown2html(notebook.cells[0].source.partition("\n")[2])


def sections_of(notebooks):
    """Return a dict a notebook: ``name``, ``title``, ``lead``, ``page`` (its HTML file), ``pictures``."""
    import nbformat

    sections = []
    for path in notebooks:
        notebook = nbformat.read(path, as_version=4)
        name = Path(path).stem
        sections.append(
            {
                "name": name,
                "title": title_of(notebook),
                "lead": lead_of(notebook),
                "page": f"{name}.html",
                "pictures": pictures_of(notebook),
            }
        )
    return sections


def plural(count, word):
    """Return ``3 stations`` or ``1 station``."""
    return f"{count} {word}" + ("" if count == 1 else "s")


def compared(scene, markers, cameras, stations, captures):
    """Return sentences on what was compared with what."""
    rig = plural(len(markers), "marker") if len(markers) else "one calibration board"
    lines = []
    if len(captures):
        places = captures.groupby("camera").station.nunique().sum()
        kind = "simulated stand-ins for captures" if scene.get("origin") == "simulated" else "photographs"
        lines.append(
            f"{plural(len(captures), 'capture')} ({kind}) of a rig with {rig}, by "
            f"{plural(len(cameras), 'camera')} at {plural(places, 'place')}, each beside its twin."
        )
    else:
        lines.append(
            f"A designed experiment without photographs: {plural(len(stations), 'station')} of "
            f"{plural(len(cameras), 'camera')} over a rig with {rig}, the twin alone."
        )
    lines.append(
        "The twin of a capture is what Blender renders of the nominal rig through an ideal pinhole camera, "
        "with the declared noise and whatever effects the twin has been given."
    )
    return lines


MOST_TOLD = 12  # parameters of one effect that a sentence can hold
NEAR_FLOOR = 1.2  # a gap up to this is told as the floor


def plain(name):
    """Return an identifier as words: ``some_effect`` is ``some effect``."""
    return name.replace("_", " ")


def listed(names):
    """Return ``a, b and c``."""
    names = list(names)
    return " and ".join(filter(None, [", ".join(names[:-1]), *names[-1:]]))


def effect_words(step):
    """Return an effect with its parameters, such as ``radial distortion (k1 0.1712 ± 0.0020)``; of many the number."""
    parameters = step.get("parameters", {})
    if len(parameters) > MOST_TOLD:
        return f"{plain(step['effect'])} ({len(parameters)} parameters)"
    values = [f"{name} {with_error(p['value'], p.get('se'))}" for name, p in parameters.items()]
    return plain(step["effect"]) + (f" ({', '.join(values)})" if values else "")


def verdict_words(diagnosis):
    """Return what a camera's diagnosis says, in words made from its numbers."""
    steps = diagnosis.get("steps", [])
    effects = listed(effect_words(step) for step in steps)
    if diagnosis["verdict"] == "adequate":
        words = "nothing is missing; the twin explains the images down to the floor."
    elif diagnosis["verdict"] == "explained":
        closed = "the gap is the floor" if steps[-1]["gap_after"] <= NEAR_FLOOR else "most of the gap is closed"
        words = f"the twin lacks {effects}; with that, {closed}."
    else:
        words = "a gap is left that no known effect closes."
        words += f" Part of it is {effects}." if steps else ""
    if steps:
        words += f" The gap falls from {steps[0]['gap_before']:.2f} to {steps[-1]['gap_after']:.2f} floors."
    if diagnosis["verdict"] != "adequate" and diagnosis.get("where"):
        most = diagnosis["where"][0]
        words += f" It shows most in {plain(gap_along(most))}, which predicts {100 * most['share']:.0f} % of it."
    confused = sorted({plain(name) for step in steps for name in step.get("confused_with", [])})
    if confused:
        words += f" These captures cannot tell it apart from {listed(confused)}."
        station = diagnosis.get("suggested_station")
        if station and station.get("height_m") is not None:
            words += f" A station at {station['height_m']:g} m height and {station['tilt_deg']:g}° tilt could."
    return words


def ladder_rows(path):
    """Return (headings, rows of text) of the ladder as one reads it: a row a twin, then the camera's floors."""
    rows = []
    for camera, steps in pd.read_csv(path).groupby("camera", sort=False):
        for step in steps.to_dict("records"):
            twin = plain(step["effect"]) if step["step"] == 0 else f"+ {plain(step['effect'])}"
            rows.append([camera, twin, *(_short(step[measure]) for measure in LADDER)])
        rows.append([camera, "floor", *(_short(step[f"{measure}_floor"]) for measure in LADDER)])
    return ["camera", "twin", *LADDER.values()], rows


def _short(value):
    return "" if pd.isna(value) else f"{value:.3g}"


def build_report(
    tables, scene_file, notebooks, headlines_file, provenance_file, diagnoses, ladder_file, template, page
):
    """Write ``index.html``.

    tables     dict of paths: markers, cameras, stations, captures
    notebooks  executed notebooks, in reading order; each has its page ``NAME.html`` beside ``page``
    diagnoses  ``diagnosis/CAMERA.json`` files, none where nothing was diagnosed
    ladder_file  ``tables/ladder.csv`` or None
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
        template=snakemake.input.template,
        page=snakemake.output.page,
    )
