"""Draw Figure 3 of a designed experiment, its cameras side by side, and what the effects of their twins take: `make paper`."""

import sys
from pathlib import Path

import figures
import matplotlib.pyplot as plt
import numpy as np
import pandas as pd
from front_picture import save

SHOWN = {"ideal": ("o", figures.GREY, "twin without effects"), "whole": ("s", figures.BLUE, "twin with all effects")}


def draw_figure3(results):
    """Return the figure: by height and distance, the share of markers that Table 1's detector finds in each camera's twin."""
    run = figures.read_run(results)
    cells, detector = figures.reference_cells(run)
    edges, heights = figures.distance_bins(cells.range_m), sorted(cells.height_m.unique())
    cameras = sorted(cells.camera.unique())
    size = (4.2 * len(cameras), 1.2 + 0.3 * len(heights))
    figure, row = plt.subplots(1, len(cameras), figsize=size, dpi=100, sharey=True, squeeze=False)
    for axes, camera in zip(row[0], cameras, strict=True):
        mine = cells[cells.camera == camera]
        figures.draw_heat_map(axes, mine, "twin", heights, edges)
        axes.set_title(f"{camera}: {detector} finds {100 * mine.twin.mean():.0f} % of {len(mine)}", fontsize=10.5)
        axes.label_outer()
    return figure


def draw_effects(results):
    """Return the figure: a camera and detector a row, coverage without effects, with all, with each alone, and as published."""
    ablation = pd.read_csv(Path(results) / "study/ablation.csv", dtype=figures.NAMES)
    coverage = pd.read_csv(Path(results) / "study/coverage.csv", dtype=figures.NAMES)
    places = list(coverage[["camera", "detector"]].itertuples(index=False, name=None))
    figure, axes = plt.subplots(figsize=(8, 1.3 + 0.5 * len(places)), dpi=100)
    for y, (camera, detector) in enumerate(places):
        mine = ablation[(ablation.camera == camera) & (ablation.detector == detector)]
        for row in mine[mine.kind == "alone"].itertuples():
            axes.plot(row.coverage_pct, y, "|", color=figures.ORANGE, markersize=14)
        for kind, (mark, colour, _) in SHOWN.items():
            axes.plot(mine.coverage_pct[mine.kind == kind], [y], mark, color=colour, markersize=7)
    axes.plot(coverage.published_pct, np.arange(len(places)), "D", color=figures.GREEN, markersize=6)
    for mark, colour, words in (
        *SHOWN.values(),
        ("|", figures.ORANGE, "with one effect"),
        ("D", figures.GREEN, "paper, real"),
    ):
        axes.plot([], [], mark, color=colour, label=words)
    axes.set_yticks(range(len(places)), [f"{camera}, {detector}" for camera, detector in places])
    axes.set(xlabel="coverage of the markers in the picture (%)", ylim=(len(places) - 0.5, -0.5), xlim=(0, 102))
    figure.legend(loc="outside lower center", ncols=4, frameon=False)
    return figure


if __name__ == "__main__":
    plt.switch_backend("agg")
    results, figure3, effects = sys.argv[1:]
    save(draw_figure3(results), figure3)
    save(draw_effects(results), effects)
