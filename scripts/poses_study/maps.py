"""Maps of the study: what came of poses, over two of their six degrees of freedom at a time, all detectors alike."""

import io
from dataclasses import dataclass

import matplotlib
import numpy as np
import pandas as pd
from matplotlib.colors import LogNorm, Normalize
from matplotlib.figure import Figure
from matplotlib.ticker import NullFormatter, NullLocator

from poses_study.errors import ratio_of
from poses_study.views import HEIGHT_PX, WIDTH_PX

EMPTY = "#d7dbe0"
POSES_A_CELL, FEWEST = 12, 3  # about so many; in a cell that is drawn
ARC = 8  # straight pieces of a cell's arc in a round map
STYLE = {"font.size": 9, "axes.titlesize": 10, "axes.titlelocation": "left", "font.family": "DejaVu Sans"}
TICKS = (0.01, 0.03, 0.1, 0.25, 0.5, 1, 2, 4, 10, 30)  # of logarithmic colours
WIDTH_IN, HEAD_IN, ROW_IN, DPI = 13, 0.95, 2.75, 120


@dataclass(frozen=True)
class Measure:
    """What a map's colours tell: of the images of a cell, a number.

    of       which images: ``all``, ``found``, or ``good`` (found and not flipped)
    columns  of those images, for ``reduce`` to make a number of
    """

    title: str
    of: str
    column: str
    reduce: object
    norm: object
    colours: str = "viridis"


def _percent(values):
    return 100 * values.mean()


def _median_size(values):
    return np.median(np.abs(values))


def _ratio(directions):
    return lambda values: ratio_of(values, directions)


MEASURES = {
    "coverage": Measure("found, % of images", "all", "found", _percent, Normalize(0, 100), "cividis"),
    "flips": Measure("flipped, % of what was found", "found", "flipped", _percent, Normalize(0, 50), "magma_r"),
    "distance_error": Measure(
        "distance error, % of distance, median", "good", "distance_error_pct", _median_size, LogNorm(0.01, 10)
    ),
    "rotation_error": Measure(
        "rotation error, degrees, median", "good", "rotation_error_deg", _median_size, LogNorm(0.03, 30)
    ),
    "distance_scatter": Measure(
        "scatter of distance, seen / predicted", "good", "distance_scatter2", _ratio(1), LogNorm(0.25, 4), "RdBu_r"
    ),
    "rotation_scatter": Measure(
        "scatter of rotation, seen / predicted", "good", "rotation_scatter2", _ratio(3), LogNorm(0.25, 4), "RdBu_r"
    ),
    "distance_trust": Measure(
        "distance error / predicted deviation", "good", "distance_error2", _ratio(1), LogNorm(0.1, 10), "PuOr_r"
    ),
    "rotation_trust": Measure(
        "rotation error / predicted deviation", "good", "rotation_error2", _ratio(3), LogNorm(0.1, 10), "PuOr_r"
    ),
}


@dataclass(frozen=True)
class Plane:
    """Two of the pose's degrees of freedom and the edges of the cells."""

    title: str
    x: str
    y: str
    x_edges: np.ndarray
    y_edges: np.ndarray
    polar: bool = False
    log_y: bool = False
    down: bool = False


def planes_of(poses, steepest_deg):
    """Return the Planes for a table of poses, the finer the more there are."""
    n = int(np.clip(np.sqrt(len(poses) / POSES_A_CELL), 2, 24))
    distances = np.geomspace(poses.distance_m.min(), poses.distance_m.max(), n + 1)
    angles, rings = (np.linspace(0, steepest_deg, k + 1) for k in (n, max(n // 2, 2)))
    turns = np.linspace(0, 360, n + 1)
    columns, rows = np.linspace(0, WIDTH_PX, n + 1) - 0.5, np.linspace(0, HEIGHT_PX, n + 1) - 0.5
    return (
        Plane("obliqueness, deg × distance, m", "obliqueness_deg", "distance_m", angles, distances, log_y=True),
        Plane(
            "from where it is seen", "azimuth_deg", "obliqueness_deg", np.linspace(0, 360, 2 * n + 1), rings, polar=True
        ),
        Plane("place in the image, px", "x_px", "y_px", columns, rows, down=True),
        Plane("roll × obliqueness, deg", "roll_deg", "obliqueness_deg", turns, angles),
    )


def cells_of(images, measure, plane):
    """Return the numbers (y cells, x cells) of a Measure over a Plane; NaN where fewer than FEWEST poses tell."""
    chosen = {"all": images.found | True, "found": images.found, "good": images.found & ~images.flipped}[measure.of]
    images = images[chosen & images[measure.column].notna()]
    shape = (len(plane.y_edges) - 1, len(plane.x_edges) - 1)
    row, column = (
        np.clip(np.searchsorted(edges, images[name].to_numpy(), side="right") - 1, 0, len(edges) - 2)
        for edges, name in ((plane.y_edges, plane.y), (plane.x_edges, plane.x))
    )
    cell = row * shape[1] + column
    order = np.argsort(cell, kind="stable")
    values, poses = images[measure.column].to_numpy()[order], pd.factorize(images.pose)[0][order]
    numbers = np.full(shape[0] * shape[1], np.nan)
    for part in np.split(np.arange(len(order)), np.flatnonzero(np.diff(cell[order])) + 1):
        if len(np.unique(poses[part])) >= FEWEST:
            numbers[cell[order[part[0]]]] = measure.reduce(values[part])
    return numbers.reshape(shape)


def draw_maps(images_of, name, poses, steepest_deg):
    """Return a PNG (bytes) of one of MEASURES: a row a detector, a panel a plane.

    images_of  {detector: table of measures.image_table}
    """
    measure, planes = MEASURES[name], planes_of(poses, steepest_deg)
    height = HEAD_IN + ROW_IN * len(images_of)
    with matplotlib.rc_context(STYLE):
        figure = Figure(figsize=(WIDTH_IN, height))
        grid = figure.add_gridspec(
            len(images_of), len(planes), left=0.06, right=0.985, bottom=0.35 / height, top=1 - HEAD_IN / height,
            wspace=0.22, hspace=0.2,
        )  # fmt: skip
        for k, (detector, images) in enumerate(images_of.items()):
            for j, plane in enumerate(planes):
                axes = figure.add_subplot(grid[k, j], projection="polar" if plane.polar else None)
                mesh = _draw_panel(axes, cells_of(images, measure, plane), measure, plane)
                if k == 0:
                    axes.set_title(plane.title, pad=8)
                if j == 0:
                    axes.set_ylabel(detector, fontweight="bold", fontsize=11)
        bar_place = figure.add_axes((0.3, 1 - 0.3 / height, 0.4, 0.13 / height))
        extend = "both" if isinstance(measure.norm, LogNorm) else "neither"
        ticks = [t for t in TICKS if measure.norm.vmin <= t <= measure.norm.vmax] if extend == "both" else None
        bar = figure.colorbar(mesh, cax=bar_place, orientation="horizontal", extend=extend, ticks=ticks)
        bar.ax.xaxis.set_major_formatter("{x:g}")
        bar.ax.xaxis.set_minor_formatter(NullFormatter())
        file = io.BytesIO()
        figure.savefig(file, format="png", dpi=DPI, metadata={"Software": None})
    return file.getvalue()


def _draw_panel(axes, numbers, measure, plane):
    """Draw one map; return what a colour bar is made of."""
    colours = matplotlib.colormaps[measure.colours].with_extremes(bad=EMPTY)
    x = plane.x_edges
    if plane.polar:
        x, numbers = np.radians(np.linspace(0, 360, ARC * (len(x) - 1) + 1)), np.repeat(numbers, ARC, axis=1)
    axes.grid(False)
    mesh = axes.pcolormesh(x, plane.y_edges, np.ma.masked_invalid(numbers), cmap=colours, norm=measure.norm)
    axes.set_facecolor(EMPTY)
    if plane.log_y:
        axes.set_yscale("log")
        ticks = [tick for tick in (0.3, 0.5, 1, 2, 3, 5, 10) if plane.y_edges[0] <= tick <= plane.y_edges[-1]]
        axes.set_yticks(ticks, [f"{tick:g}" for tick in ticks])
        axes.yaxis.set_minor_locator(NullLocator())
    if plane.polar:
        axes.set_xticks(np.radians([0, 90, 180, 270]), ["right", "", "left", "below"])
        axes.set_yticks([30, 60], ["30°", "60°"])
        axes.tick_params(axis="y", labelsize=7)
    if plane.down:
        axes.invert_yaxis()
        axes.set_aspect("equal")
    if plane.x == "roll_deg":
        axes.set_xticks([0, 90, 180, 270, 360])
    return mesh
