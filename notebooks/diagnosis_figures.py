"""Pictures of a diagnosis: the falling error, residual vectors, candidates, where the gap lives. Draws tables only."""

import json
from pathlib import Path
from textwrap import fill

import figures
import matplotlib.pyplot as plt
import numpy as np
import pandas as pd
from tabulate import tabulate

from reporting.sentences import changes_words, motion_words, needs_words, or_others, residue_words
from rig.words import LADDER, gap_along, plain, with_error

MAX_CANDIDATES = 12
TITLE_LETTERS = 40  # that fit above one of two pictures side by side
EXAMPLES = {"real": "real", "configured": "twin as configured", "explained": "twin with what was found"}
BRIGHTEST_DIFFERENCE_DN = 40
LACKS = """# What does the twin lack, and does the error fall?

Every effect of the library was added to the twin in turn, fitted on some stations and scored on others. The best is
added, all are refitted together, and the search goes on until nothing helps; where three or more are predicted to gain together,
they are added and fitted together. Gaps are in units of the floor: how far repeats of one station lie apart. All errors
here are of captures that no fit has seen."""
CHANGED = """# What has changed since {since}?

One twin was fitted to the captures then and now. Every effect of the library was asked whether it differs between them by
more than between sets into which the captures are divided by chance; what does is named, with how much it was and is.
Pictures titled *by itself* are of the later captures alone, as diagnosed without a baseline."""


def introduction(diagnoses):
    """Return the title and first words, Markdown, of a page of [(diagnosis, ladder, plates)]."""
    since = [d["baseline"] for d, *_ in diagnoses if d.get("baseline")]
    return CHANGED.format(since=since[0]) if since else LACKS


def read_diagnoses(results):
    """Return [(diagnosis, ladder, plates)] of all cameras of a run."""
    results = Path(results)
    found = []
    for path in sorted((results / "diagnosis").glob("*.json")):
        diagnosis = json.loads(path.read_text())
        folder = results / "diagnosis" / diagnosis["camera"]
        ladder = pd.read_csv(folder / "ladder.csv") if (folder / "ladder.csv").is_file() else pd.DataFrame()
        plates = folder / "plates.parquet"
        found.append((diagnosis, ladder, pd.read_parquet(plates) if plates.is_file() else pd.DataFrame()))
    return found


def story_of(results, diagnosis, ladder):
    """Return [(figure, what it shows)] of one camera: one capture before and after, and how the error falls."""
    camera = diagnosis["camera"]
    if diagnosis.get("baseline"):
        figure = change_figure(results, diagnosis)
        return [] if figure is None else [(figure, f"{camera}: one photograph then and one now")]
    pictures = []
    example = example_figure(results, camera)
    if example is not None:
        pictures.append((example, f"{camera}: one capture that no fit has seen, and how far the twins are off"))
    if len(ladder):
        pictures.append((ladder_figure(ladder, camera), f"{camera}: errors on held-out captures, step by step"))
    return pictures


def details_of(diagnosis, plates):
    """Return [(figure, what it shows)] of one camera: where it fails, what the gap follows, which effects competed."""
    camera = diagnosis["camera"]
    pictures = []
    if len(plates) and "dx_px" in plates:
        pictures.append((vectors_figure(plates, camera), f"{camera}: where plates lie off, over the image"))
    if diagnosis["where"]:
        pictures.append((where_figure(diagnosis), f"{camera}: what the gap follows"))
    if diagnosis["candidates"] and not diagnosis.get("baseline"):  # changes are asked to first order: none leaves a gap
        pictures.append((candidates_figure(diagnosis), f"{camera}: candidates one by one"))
    return pictures


def least_seen(diagnosis):
    """Return Markdown, a table: how much of each effect would have to change to be seen; nothing without a baseline."""
    rows = [
        (plain(name), "more than was tried" if amount is None else _amount(amount))
        for name, amount in sorted(diagnosis.get("least_seen", {}).items())
    ]
    if not rows:
        return ""
    table = tabulate(
        rows, ["effect", "least change, of 1/16 to 4 times a clear one, that is seen in most cases"], "github"
    )
    return f"{diagnosis['camera']}: what would a change have to be, to be seen in captures like these?\n\n{table}"


def _amount(parameters):
    return ", ".join(f"{key} by {value:.2g}" for key, value in parameters.items())


def example_figure(results, camera):
    """Return a figure: a capture, its twin before and after, and below what differs; None without images."""
    paths = {name: Path(results) / "diagnosis" / camera / f"example_{name}.png" for name in EXAMPLES}
    if not all(p.is_file() for p in paths.values()):
        return None
    images = {name: plt.imread(p)[..., :3] if plt.imread(p).ndim == 3 else plt.imread(p) for name, p in paths.items()}
    grey = {name: 255 * (i.mean(axis=2) if i.ndim == 3 else i) for name, i in images.items()}
    fig, axes = plt.subplots(2, 3, figsize=(1.5 * figures.WIDTH_IN, 4.4))
    for column, (name, title) in enumerate(EXAMPLES.items()):
        axes[0, column].imshow(images[name], cmap="gray", vmin=0, vmax=1)
        axes[0, column].set_title(title, fontsize=9.5)
        if name != "real":
            difference = grey[name] - grey["real"]
            axes[1, column].imshow(
                difference, cmap="RdBu_r", vmin=-BRIGHTEST_DIFFERENCE_DN, vmax=BRIGHTEST_DIFFERENCE_DN
            )
            rms = float(np.sqrt((difference**2).mean()))
            axes[1, column].set_title(f"minus real:\n{rms:.1f} grey levels (RMS)", fontsize=9.5)
    for axis in axes.ravel():
        axis.axis("off")
    axes[1, 0].text(
        0.5, 0.5, f"red: the twin is brighter\nblue: the real image is\nfull colour: {BRIGHTEST_DIFFERENCE_DN} grey levels",
        ha="center", va="center", fontsize=9, transform=axes[1, 0].transAxes,
    )  # fmt: skip
    figures.head(fig, f"{camera}: does the twin look like the capture?")
    return fig


def change_figure(results, diagnosis):
    """Return a figure: a photograph of the baseline and one of now, with arrows from where the earlier camera has what they
    show, or the same square of the board in both; None without pictures.
    """
    paths = [Path(results) / "diagnosis" / diagnosis["camera"] / f"change_{when}.png" for when in ("before", "after")]
    if not all(p.is_file() for p in paths):
        return None
    shown = diagnosis["shown"]
    titles = f"{diagnosis['baseline']}: {shown['before']}", f"{diagnosis['campaign']}: {shown['after']}"
    fig, axes = plt.subplots(1, 2, figsize=(1.5 * figures.WIDTH_IN, 3.6))
    for axis, path, title in zip(axes, paths, titles, strict=True):
        axis.imshow(plt.imread(path))
        axis.set_title(fill(title, TITLE_LETTERS), fontsize=9.5)
        axis.axis("off")
    if shown.get("square"):
        figures.head(fig, "A square of the board then and now; beside it, with what has changed laid on")
    else:
        figures.head(fig, f"Off where the earlier camera shows it, {shown['times']:g} times as long")
    return fig


def words(diagnosis):
    """Return Markdown sentences of a verdict, made from its numbers."""
    lines = [f"### {diagnosis['camera']}: {diagnosis['verdict']}"]
    if diagnosis.get("baseline"):
        return "\n\n".join([*lines, changes_words(diagnosis)])
    if diagnosis.get("why"):
        return "\n\n".join([*lines, diagnosis["why"].capitalize() + "."])
    steps = diagnosis["steps"]
    if diagnosis["verdict"] == "adequate":
        lines.append(f"Nothing is missing: the held-out gap is {diagnosis['gap']:.2f} floors.")
    for step in steps:
        values = ", ".join(f"{k} = {with_error(p['value'], p['se'])}" for k, p in step["parameters"].items())
        few = values if len(step["parameters"]) <= 6 else f"{len(step['parameters'])} parameters"
        line = f"- **{step['effect']}** ({few}){or_others(step)}{residue_words(step)}: "
        line += f"the gap falls from {step['gap_before']:.2f} to {step['gap_after']:.2f} floors"
        if step["confused_with"] and "one_of" not in step:
            line += f"; this rig can hardly tell it from {', '.join(step['confused_with'])}"
        lines.append(line)
    if diagnosis["verdict"] == "unexplained":
        lines.append(f"A gap of {diagnosis['gap']:.2f} floors is left that no candidate closes.")
    places = [w for w in diagnosis["where"] if w["share"] > 0.1][:3]
    if places:
        told = "; ".join(f"{gap_along(w)} ({100 * w['share']:.0f} %)" for w in places)
        lines.append(f"Of the gap as configured, this much is predicted on captures never fitted: {told}.")
    station = diagnosis.get("suggested_station")
    if station:
        pair = " from ".join(station["tells_apart"])
        lines.append(
            f"To tell {pair}, measure next from a height of {station['height_m']:g} m at a tilt of {station['tilt_deg']:g}°."
        )
    return "\n\n".join(filter(None, [*lines, motion_words(diagnosis).strip(), needs_words(diagnosis).strip()]))


def ladder_figure(ladder, camera):
    """Return a figure: every error against the step, its 95 % interval, and its floor."""
    measures = {m: label for m, label in LADDER.items() if ladder[m].notna().any()}
    rows = -(-len(measures) // 2)
    fig, axes = plt.subplots(rows, 2, figsize=(figures.WIDTH_IN, 1.2 + 1.5 * rows), sharex=True, squeeze=False)
    names = ["ideal" if k == 0 else e for k, e in zip(ladder.step, ladder.effect, strict=True)]
    for axis, (measure, label) in zip(axes.ravel(), measures.items(), strict=False):
        value = ladder[measure]
        axis.fill_between(
            ladder.step, ladder[f"{measure}_low"], ladder[f"{measure}_high"], color=figures.BLUE, alpha=0.2
        )
        axis.plot(ladder.step, value, "o-", color=figures.BLUE)
        axis.plot(ladder.step, ladder[f"{measure}_floor"], "--", color=figures.GREY)
        axis.set_ylim(0, max(1e-6, 1.15 * np.nanmax([value.max(), ladder[f"{measure}_floor"].max()])))
        axis.set_title(label, fontsize=9.5)
        axis.set_xticks(ladder.step, names, rotation=35, ha="right", fontsize=7.5)
    figures.head(fig, f"{camera}: does the error fall to its floor (dashed)?")
    return fig


def vectors_figure(plates, camera):
    """Return a figure: where the twin's plates lie off the real ones, before and after, each with its own scale."""
    fig, axes = plt.subplots(1, 2, figsize=(figures.WIDTH_IN, 2.6), sharex=True, sharey=True)
    for axis, (twin, title) in zip(axes, (("configured", "as configured"), ("explained", "after")), strict=True):
        mine = plates[plates.twin == twin]
        length = np.hypot(mine.dx_px, mine.dy_px)
        longest = max(float(length.quantile(0.95)), 1e-6) if len(mine) else 1.0
        axis.quiver(
            mine.column_px, mine.row_px, mine.dx_px, mine.dy_px, angles="xy", scale_units="xy", scale=longest / 60,
            width=0.004, color=figures.BLUE,
        )  # fmt: skip
        axis.set_title(f"{title}:\narrow of 60 px = {longest:.2g} px", fontsize=8.5)
        axis.set_aspect("equal")
    if len(axes):
        axes[0].invert_yaxis()
    figures.head(fig, f"{camera}: which way are plates off, over the image?")
    return fig


def candidates_figure(diagnosis):
    """Return a figure: the held-out gap that each candidate alone would leave."""
    rows = sorted(diagnosis["candidates"], key=lambda c: c["rank"])[:MAX_CANDIDATES]
    fig, axis = plt.subplots(figsize=(figures.WIDTH_IN, 3.2))
    names = [c["effect"] for c in rows][::-1]
    gaps = [c["gap_after"] or np.nan for c in rows][::-1]
    axis.barh(names, gaps, color=figures.BLUE)
    axis.axvline(1, color=figures.GREY, ls="--")
    if diagnosis.get("gap_as_configured"):
        axis.axvline(diagnosis["gap_as_configured"], color=figures.ORANGE)
    axis.set_xlabel("gap with it alone, floors (orange: without)", fontsize=8.5)
    figures.head(fig, f"{diagnosis['camera']}: which effect alone helps most?")
    return fig


def where_figure(diagnosis):
    """Return a figure: shares of the gap that one covariate, or one value for all, predicts on held-out captures."""
    rows = diagnosis["where"][:8][::-1]
    fig, axis = plt.subplots(figsize=(figures.WIDTH_IN, 2.6))
    axis.barh([gap_along(r) for r in rows], [100 * r["share"] for r in rows], color=figures.GREEN)
    axis.set_xlim(0, 100)
    axis.set_xlabel("share of the gap predicted, %")
    figures.head(fig, f"{diagnosis['camera']}: what does the gap follow?")
    return fig
