"""Pictures of moving cameras: tracks over the image, errors over time, jitter, clips. Draws tables only."""

import html
from pathlib import Path
from types import SimpleNamespace

import cv2
import figures
import matplotlib.pyplot as plt
import numpy as np
import pandas as pd
from IPython.display import HTML

from inputs.safe_yaml import load_yaml

MARKER = ["dictionary", "id"]
COLOURS = [figures.BLUE, figures.ORANGE, figures.GREEN, "#CC79A7", figures.GREY, "#E69F00", "#56B4E9"]
COLUMNS = {
    "recall_pct": "recall %",
    "with_bridged_pct": "with bridged %",
    "false_ids": "false ids",
    "corner_median_px": "corners median px",
    "corner_rms_px": "corners RMS px",
    "translation_median_mm": "place mm",
    "rotation_median_deg": "turn °",
    "jitter_mm": "jitter mm",
    "shake_mm": "shake mm",
    "first_seen_mean_ms": "first seen ms",
    "dropout_frames": "dropouts",
    "dropout_frames_bridged": "bridged",
    "hidden_frames": "hidden",
    "hidden_frames_lost": "lost",
    "recovery_median_frames": "recovery",
}


def read_run(results, experiment):
    """Return a namespace: the experiment's keys (``file``), its tables, reports of each detector."""
    results = Path(results)
    tables = {name: pd.read_csv(results / f"tables/{name}.csv") for name in ("moving", "moving_cells", "moving_timing")}
    detectors = sorted(tables["moving"].detector.unique())
    return SimpleNamespace(
        results=results,
        file=load_yaml(experiment),
        truth=pd.read_csv(results / "truth.csv"),
        measures=tables["moving"],
        cells=tables["moving_cells"],
        timing=tables["moving_timing"],
        detectors=detectors,
        reports={name: pd.read_csv(results / f"detect/{name}.csv") for name in detectors},
        colour=dict(zip(detectors, COLOURS, strict=False)),
    )


def centres(table):
    """Return the mean of the corners (n, 2), pixels."""
    return np.stack([table[[f"{axis}{k}" for k in range(4)]].mean(axis=1) for axis in "xy"], axis=1)


def tracks_figure(run, trajectory, detector):
    """Return a figure: where markers went (lines) over the middle frame, where they were seen and bridged (dots)."""
    truth = run.truth[(run.truth.trajectory == trajectory) & run.truth.in_frame]
    mine = run.reports[detector]
    mine = mine[mine.trajectory == trajectory]
    images = sorted((run.results / "frames" / trajectory).glob("*.png"))
    image = cv2.imread(str(images[len(images) // 2]), cv2.IMREAD_GRAYSCALE)
    fig, axis = plt.subplots(figsize=(figures.WIDTH_IN, 0.35 + figures.WIDTH_IN * image.shape[0] / image.shape[1]))
    axis.imshow(image, cmap="gray", vmin=-150, vmax=255)
    for _, marker in truth.groupby(MARKER):
        axis.plot(*centres(marker).T, color=figures.GREY, lw=0.8)
    for seen, colour, size in ((True, figures.BLUE, 5), (False, figures.ORANGE, 12)):
        axis.scatter(*centres(mine[mine.seen == seen]).T, s=size, color=colour, zorder=3)
    axis.set_xlim(0, image.shape[1])
    axis.set_ylim(image.shape[0], 0)
    axis.set_axis_off()
    axis.set_title(f"{trajectory}, {detector}")
    return fig


def error_figure(run, trajectory):
    """Return a figure: median corner error of what is reported, over time; markers hidden are shaded, and the recall."""
    cells = run.cells[(run.cells.trajectory == trajectory) & run.cells.in_frame]
    fig, (above, below) = plt.subplots(2, 1, figsize=(figures.WIDTH_IN, 4.2), sharex=True, height_ratios=[2, 1])
    share = cells.assign(hidden=cells.hidden > 0).groupby("frame").hidden.mean()
    for axis in (above, below):
        shade = axis.twinx()
        shade.fill_between(share.index, share, step="mid", color="#BBBBBB", alpha=0.5, lw=0)
        shade.set_ylim(0, 1)
        shade.set_axis_off()
        axis.set_zorder(2)
        axis.patch.set_visible(False)
    for detector in run.detectors:
        mine = cells[cells.detector == detector]
        reported = mine[mine.reported].groupby("frame").corner_px.median()
        above.plot(reported.index, reported, "-", lw=1.2, color=run.colour[detector], label=detector)
        below.plot(mine.groupby("frame").kept.mean() * 100, lw=1.2, color=run.colour[detector])
    above.set_yscale("log")
    above.set_ylabel("corners (px)")
    below.set_ylabel("reported (%)")
    below.set_ylim(0, 103)
    below.set_xlabel("frame")
    above.legend(fontsize=8, ncols=4, frameon=False)
    above.set_title(f"{trajectory}: how far off are corners?")
    return fig


def jitter_figure(run):
    """Return a figure: how much poses of a camera at rest scatter."""
    mine = run.measures[run.measures.trajectory == "all"].set_index("detector").loc[run.detectors]
    fig, axes = plt.subplots(1, 2, figsize=(figures.WIDTH_IN, 2.4))
    for axis, column, label in zip(axes, ("jitter_mm", "jitter_deg"), ("place (mm)", "turn (°)"), strict=True):
        axis.barh(run.detectors, mine[column], color=[run.colour[d] for d in run.detectors])
        axis.set_title(label)
        axis.invert_yaxis()
    return fig


def latency_figure(run):
    """Return a figure: milliseconds a frame, median and 99th percentile."""
    mine = run.timing[run.timing.trajectory == "all"].set_index("detector").loc[run.detectors]
    fig, axis = plt.subplots(figsize=(figures.WIDTH_IN, 2.4))
    axis.barh(run.detectors, mine.ms_p99, color="#CCCCCC", label="99th percentile")
    axis.barh(run.detectors, mine.ms_median, color=[run.colour[d] for d in run.detectors], label="median")
    axis.invert_yaxis()
    axis.set_title("time a frame (ms; grey: 99th percentile)")
    return fig


def measures_table(run, trajectory="all"):
    """Return an HTML table of the measures, a row a detector."""
    mine = (
        run.measures[run.measures.trajectory == trajectory].set_index("detector")[list(COLUMNS)].rename(columns=COLUMNS)
    )
    text = mine.to_html(float_format=lambda v: f"{v:.3g}", na_rep="–", border=0)
    return HTML(f'<div class="wide">{text}</div>')


def budget_words(run):
    """Return a sentence of each detector that keeps a budget."""
    held = run.timing[(run.timing.trajectory == "all") & run.timing.budget_ms.notna()]
    lines = [
        f"- **{r.detector}** with a budget of {r.budget_ms:g} ms: 99 % of the frames within {r.held_ms_p99:.1f} ms, "
        f"{r.held_over_pct:.1f} % over it, at most by {r.held_most_over_ms:.1f} ms; {r.held_partial_pct:.1f} % partial."
        for r in held.itertuples()
    ]
    return "\n".join(lines)


def clips(run):
    """Return an HTML row of the detectors' clips, which lie beside the page's folder."""
    parts = [
        f'<figure style="flex:1 1 300px;max-width:640px;margin:0 0 .8em"><video controls muted preload="metadata" '
        f'style="width:100%" src="../clips/{html.escape(name)}.webm"></video>'
        f"<figcaption>{html.escape(name)}</figcaption></figure>"
        for name in run.detectors
    ]
    return HTML(f'<div style="display:flex;flex-wrap:wrap;gap:12px">{"".join(parts)}</div>')
