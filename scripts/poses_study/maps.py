"""Maps of the study: what came of poses, over two of their six degrees of freedom at a time, all detectors alike."""

import io
from dataclasses import dataclass

import matplotlib
import numpy as np
import pandas as pd
from matplotlib.colors import LogNorm, Normalize
from matplotlib.figure import Figure

from poses_study.errors import ratio_of
from poses_study.views import HEIGHT_PX, WIDTH_PX

EMPTY = "#d7dbe0"
FEWEST = 3  # poses of a cell that is drawn
STYLE = {"font.size": 9, "axes.titlesize": 10, "axes.titlelocation": "left", "font.family": "DejaVu Sans"}
DPI = 120


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
    return values.abs().median()


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
    """Return the Planes for a table of poses."""
    near, far = poses.distance_m.min(), poses.distance_m.max()
    distances = np.geomspace(near, far * (1 + 1e-9), 9)
    angles = np.linspace(0, steepest_deg, 9)
    turns, rings = np.linspace(0, 360, 13), np.linspace(0, steepest_deg, 7)
    columns, rows = np.linspace(0, WIDTH_PX, 9) - 0.5, np.linspace(0, HEIGHT_PX, 7) - 0.5
    return (
        Plane("obliqueness, deg × distance, m", "obliqueness_deg", "distance_m", angles, distances, log_y=True),
        Plane("azimuth × obliqueness of the camera", "azimuth_deg", "obliqueness_deg", turns, rings, polar=True),
        Plane("place in the image, px", "x_px", "y_px", columns, rows, down=True),
        Plane("roll × obliqueness, deg", "roll_deg", "obliqueness_deg", turns, angles),
    )


def cells_of(images, measure, plane):
    """Return the numbers (y cells, x cells) of a Measure over a Plane; NaN where fewer than FEWEST poses tell."""
    chosen = {"all": slice(None), "found": images.found, "good": images.found & ~images.flipped}[measure.of]
    images = images.loc[chosen]
    images = images[images[measure.column].notna()]
    column = np.clip(np.searchsorted(plane.x_edges, images[plane.x], side="right") - 1, 0, len(plane.x_edges) - 2)
    row = np.clip(np.searchsorted(plane.y_edges, images[plane.y], side="right") - 1, 0, len(plane.y_edges) - 2)
    numbers = np.full((len(plane.y_edges) - 1, len(plane.x_edges) - 1), np.nan)
    for (r, c), group in images.groupby([pd.Series(row, images.index), pd.Series(column, images.index)]):
        if group.pose.nunique() >= FEWEST:
            numbers[r, c] = measure.reduce(group[measure.column])
    return numbers


def draw_maps(images_of, name, poses, steepest_deg):
    """Return a PNG (bytes) of one of MEASURES: a row a detector, a panel a plane.

    images_of  {detector: table of measures.image_table}
    """
    measure, planes = MEASURES[name], planes_of(poses, steepest_deg)
    with matplotlib.rc_context(STYLE):
        figure = Figure(figsize=(13, 0.7 + 2.9 * len(images_of)), layout="constrained")
        for k, (detector, images) in enumerate(images_of.items()):
            for j, plane in enumerate(planes):
                place = (len(images_of), len(planes), k * len(planes) + j + 1)
                axes = figure.add_subplot(*place, projection="polar" if plane.polar else None)
                mesh = _draw_panel(axes, cells_of(images, measure, plane), measure, plane)
                axes.set_title(plane.title if k == 0 else "")
                if j == 0:
                    axes.set_ylabel(detector, fontweight="bold", fontsize=11)
        bar = figure.colorbar(mesh, ax=figure.axes, location="top", aspect=70, shrink=0.6, extend=_extend(measure))
        bar.set_label(measure.title, fontsize=11)
        if isinstance(measure.norm, LogNorm):
            bar.ax.xaxis.set_major_formatter("{x:g}")
        file = io.BytesIO()
        figure.savefig(file, format="png", dpi=DPI, metadata={"Software": None})
    return file.getvalue()


def _extend(measure):
    return "both" if isinstance(measure.norm, LogNorm) else "neither"


def _draw_panel(axes, numbers, measure, plane):
    """Draw one map; return what a colour bar is made of."""
    colours = matplotlib.colormaps[measure.colours].with_extremes(bad=EMPTY)
    x = np.radians(plane.x_edges) if plane.polar else plane.x_edges
    axes.grid(False)
    mesh = axes.pcolormesh(x, plane.y_edges, np.ma.masked_invalid(numbers), cmap=colours, norm=measure.norm)
    axes.set_facecolor(EMPTY)
    if plane.log_y:
        axes.set_yscale("log")
        ticks = [tick for tick in (0.3, 0.5, 1, 2, 3, 5, 10) if plane.y_edges[0] <= tick <= plane.y_edges[-1]]
        axes.set_yticks(ticks, [f"{tick:g}" for tick in ticks])
        axes.yaxis.set_minor_locator(matplotlib.ticker.NullLocator())
    if plane.polar:
        axes.set_xticks(np.radians([0, 90, 180, 270]), ["right", "above", "left", "below"])
        axes.set_yticks(plane.y_edges[2::2], [f"{edge:.0f}°" for edge in plane.y_edges[2::2]])
        axes.tick_params(axis="y", labelsize=7)
    if plane.down:
        axes.invert_yaxis()
        axes.set_aspect("equal")
    if plane.x in ("roll_deg",):
        axes.set_xticks([0, 90, 180, 270, 360])
    return mesh
