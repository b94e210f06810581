"""What the notebooks share: reading a run's tables, and drawing in one style. Nothing is measured here.

Colours are Okabe and Ito's, told apart by colour-blind readers; figures are one phone wide, and stand side by
side where there is room.
"""

import html
import io
import json
from pathlib import Path
from textwrap import fill
from types import SimpleNamespace

import cv2
import matplotlib.pyplot as plt
import numpy as np
import pandas as pd
from IPython.display import HTML
from matplotlib.ticker import MaxNLocator

from inputs.images import read_image
from markers.contract import marker_corners_world
from reporting.pages import data_uri
from rig.geometry import camera_matrix, make_pose, project

BLUE, ORANGE, GREEN, GREY = "#0072B2", "#D55E00", "#009E73", "#595959"
FOUND, MISSED = "#00C8FF", "#FF8C00"  # bright enough on grey photographs; missed is dashed as well
POSE = ["rx", "ry", "rz", "tx", "ty", "tz"]
WIDTH_IN = 5.0
LETTERS_PER_INCH = 11  # of a heading
# Names are text, however much they look like numbers.
NAMES = dict.fromkeys(("camera", "algorithm", "capture", "station", "dictionary", "image"), str)

plt.rcParams.update(
    {
        "figure.dpi": 130,
        "font.size": 10.5,
        "axes.titlesize": 11,
        "axes.titleweight": "bold",
        "axes.titlelocation": "left",
        "axes.spines.top": False,
        "axes.spines.right": False,
        "axes.grid": True,
        "grid.color": "#E3E3E3",
        "axes.axisbelow": True,
        "figure.constrained_layout.use": True,
    }
)


def head(figure, words, **font):
    """Put words over a figure or a part of one, in as many lines as its width asks for."""
    letters = int(LETTERS_PER_INCH * figure.bbox.width / figure.dpi)
    figure.suptitle(fill(words, letters, break_on_hyphens=False), fontsize=11, **font)


def read_run(results):
    """Return a namespace of a run's tables: ``markers``, ``cameras``... ``cells``, and ``scene``."""
    results = Path(results)
    run = {"results": results, "scene": json.loads((results / "expand/scene.json").read_text())}
    for name in ("markers", "cameras", "stations", "captures"):
        run[name] = read_table(results / f"expand/{name}.csv")
    run["cameras"] = run["cameras"][run["cameras"].camera.isin(run["stations"].camera)]  # those that took something
    run["cells"] = pd.read_parquet(results / "aggregate/cells.parquet")
    run["reference"] = reference_detector(results)
    return SimpleNamespace(**run)


def reference_detector(results):
    """Return the name of the detector that Table 1 counts, None where nothing was counted."""
    return next(iter(read_table(Path(results) / "tables/table1.csv").algorithm), None)


def read_table(path):
    """Return a CSV table."""
    return pd.read_csv(path, dtype=NAMES)


def real_name(run):
    """Return what to call the images that are not the twin's."""
    return "a simulated stand-in for captures" if run.scene.get("origin") == "simulated" else "photographs"


def reference_cells(run):
    """Return the available cells of Table 1's detector, and its name (empty and None without any)."""
    return run.cells[(run.cells.detector == run.reference) & run.cells.available], run.reference


def side_by_side(*pictures):
    """Return an HTML row of pictures ``(figure or image, what it shows)`` that stacks on a narrow screen.

    A figure becomes a PNG, an image (uint8, grey or BGR) a JPEG; both are embedded.
    """
    parts = []
    for picture, words in pictures:
        kind, data = _encode(picture)
        source = data_uri(data, kind)
        text = html.escape(words)
        parts.append(
            f'<figure style="flex:1 1 300px;max-width:640px;margin:0 0 .8em">'
            f'<img src="{source}" alt="{text}" style="width:100%;height:auto">'
            f"<figcaption>{text}</figcaption></figure>"
        )
    return HTML(f'<div style="display:flex;flex-wrap:wrap;gap:12px">{"".join(parts)}</div>')


def _encode(picture):
    if isinstance(picture, np.ndarray):
        return "jpeg", cv2.imencode(".jpg", picture, [cv2.IMWRITE_JPEG_QUALITY, 85])[1].tobytes()
    file = io.BytesIO()
    # No clock and no version in the file: the same numbers give the same page.
    picture.savefig(file, format="png", metadata={"Software": None})
    plt.close(picture)
    return "png", file.getvalue()


# --- Overview


def typical_capture(run, camera):
    """Return the capture of a camera with the median number of markers on which the two sides disagree.

    Of several the one with most markers in the picture, then the first by name.
    """
    cells, _ = reference_cells(run)
    mine = cells[cells.camera == camera]
    if mine.empty:
        names = run.captures[run.captures.camera == camera].capture
        return names.iloc[0] if len(names) else run.stations[run.stations.camera == camera].station.iloc[0]
    by = (
        mine.assign(disagree=mine.real != mine.twin)
        .groupby("capture")
        .agg(disagree=("disagree", "sum"), markers=("available", "sum"))
    )
    by["far"] = (by.disagree - by.disagree.median()).abs()
    return by.sort_values(["far", "markers"], ascending=[True, False], kind="stable").index[0]


def read_capture(run, campaign, camera, capture):
    """Return a namespace: ``real`` (BGR or None), ``twin`` (BGR), ``K``, ``T_real``, ``T_twin`` (4 x 4)."""
    frame = run.cameras.set_index("camera").loc[camera].to_dict()
    registered = run.results / f"register/{camera}.json"
    if registered.exists():
        frame |= {name: json.loads(registered.read_text())[name] for name in ("fx", "fy", "cx", "cy")}
    row = run.captures.set_index("capture").loc[capture] if len(run.captures) else None
    station = row.station if row is not None else capture
    stations = run.stations[run.stations.camera == camera].set_index("station")
    T_twin = _pose(stations.loc[station]) if station in stations.index else None
    poses = run.results / f"register/{camera}.csv"
    T_real = _pose(read_table(poses).set_index("capture").loc[capture]) if row is not None else T_twin
    real = in_colour(read_image(Path(campaign) / row.image)) if row is not None else None
    twin = cv2.imread(str(run.results / f"twin/{camera}/{capture}.png"))
    K = camera_matrix(*(frame[name] for name in ("fx", "fy", "cx", "cy")))
    T_real = T_twin if T_real is None else T_real
    return SimpleNamespace(real=real, twin=twin, K=K, T_real=T_real, T_twin=T_real if T_twin is None else T_twin)


def in_colour(image):
    """Return an image of 8 or 16 bits, grey or BGR, as uint8 BGR."""
    image = (image // 257).astype(np.uint8) if image.dtype == np.uint16 else image
    return cv2.cvtColor(image, cv2.COLOR_GRAY2BGR) if image.ndim == 2 else image[..., :3]


def _pose(row):
    values = row[POSE].to_numpy(float)
    return make_pose(values[:3], values[3:]) if np.isfinite(values).all() else None


def outlined(image, run, camera, capture, side, K, T_cam_world, detector):
    """Return the image with the outline of each marker: found solid blue, missed dashed orange."""
    scale = max(1, round(1280 / image.shape[1]))
    canvas = cv2.resize(image, None, fx=scale, fy=scale, interpolation=cv2.INTER_NEAREST)
    cells = run.cells
    cells = cells[(cells.camera == camera) & (cells.capture == capture) & (cells.detector == detector)]
    there = cells[cells.available].merge(run.markers, on=["dictionary", "id"])
    for marker in there.itertuples():
        corners = (project(K, T_cam_world, marker_corners_world(marker)) + 0.5) * scale - 0.5
        found = getattr(marker, side)
        for a, b in zip(corners, np.roll(corners, -1, axis=0), strict=True):
            _line(canvas, a, b, FOUND if found else MISSED, 0 if found else 5 * scale)
    return canvas if scale == 1 else cv2.resize(canvas, (1280, round(1280 * image.shape[0] / image.shape[1])))


def _line(canvas, a, b, colour, dash_px):
    bgr = tuple(int(colour[k : k + 2], 16) for k in (5, 3, 1))
    n = max(1, int(np.hypot(*(b - a)) / dash_px)) if dash_px else 1
    n += 1 - n % 2
    ends = np.linspace(a, b, n + 1)
    for start, stop in zip(ends[::2], ends[1::2], strict=False):
        cv2.line(
            canvas,
            *(tuple(np.round(p * 16).astype(int).tolist()) for p in (start, stop)),
            bgr,
            2,
            cv2.LINE_AA,
            4,
        )


def overlay(shot):
    """Return real (green) over the twin (magenta), moved to the registered pose by the plane of the plates.

    Where both agree the picture is grey.
    """
    plane = [shot.K @ np.delete(T[:3], 2, axis=1) for T in (shot.T_real, shot.T_twin)]
    H = plane[0] @ np.linalg.inv(plane[1])
    height, width = shot.real.shape[:2]
    twin = cv2.warpPerspective(shot.twin, H, (width, height), borderMode=cv2.BORDER_REPLICATE)
    real, twin = (cv2.cvtColor(i, cv2.COLOR_BGR2GRAY) for i in (shot.real, twin))
    return np.dstack([twin, real, twin])


def board_figure(run, camera):
    """Return a figure of photographs of a board: residuals of each, and how far and how slanting it was seen from."""
    poses = read_table(run.results / f"register/{camera}.csv")
    T = [_pose(row) for _, row in poses.iterrows()]
    known = [k for k, pose in enumerate(T) if pose is not None]
    figure, (left, right) = plt.subplots(1, 2, figsize=(1.5 * WIDTH_IN, 2.8))
    left.bar(range(len(poses)), poses.rms_px, color=BLUE)
    left.set(xlabel="photograph, by name", ylabel="corners off the pinhole (px)", title="residuals of each")
    eyes = np.array([-T[k][:3, :3].T @ T[k][:3, 3] for k in known]).reshape(-1, 3)
    slant = [np.degrees(np.arccos(min(1.0, abs(T[k][2, 2])))) for k in known]
    points = right.scatter(np.linalg.norm(eyes, axis=1), slant, c=poses.rms_px.iloc[known], cmap="cividis", s=36)
    right.set(
        xlabel="distance to the board's corner (m)", ylabel="slant (°), 0: face on", title="where it was seen from"
    )
    figure.colorbar(points, label="px")
    return figure


# --- Figure 3 ----


def distance_bins(range_m, at_most=9):
    """Return bin edges in metres, of a round width, over the ranges."""
    low, high = range_m.min(), range_m.max()
    for width in (0.1, 0.2, 0.25, 0.5, 1, 2, 5, 10):
        edges = np.arange(np.floor(low / width), np.ceil(high / width) + 1) * width
        if len(edges) - 1 <= at_most:
            break
    return edges if len(edges) > 1 else np.array([edges[0], edges[0] + width])


def heat_map(cells, side, heights, edges, title):
    """Return a figure: share of the markers that ``side`` found, by height and distance; grey: none."""
    figure, axes = plt.subplots(figsize=(WIDTH_IN, 1.25 + 0.42 * len(heights)))
    draw_heat_map(axes, cells, side, heights, edges)
    axes.set_title(title)
    return figure


def draw_heat_map(axes, cells, side, heights, edges):
    """Draw a ``heat_map`` on axes."""
    n_rows, n_columns = len(heights), len(edges) - 1
    row = (
        cells.height_m.map({h: k for k, h in enumerate(heights)}).to_numpy() if heights[0] is not None else 0 * cells.id
    )
    column = np.clip(np.digitize(cells.range_m, edges) - 1, 0, n_columns - 1)
    at = (np.asarray(row, int), column)
    there, found = np.zeros((n_rows, n_columns)), np.zeros((n_rows, n_columns))
    np.add.at(there, at, 1)
    np.add.at(found, at, cells[side].to_numpy(float))
    share = np.divide(100 * found, there, out=np.full_like(there, np.nan), where=there > 0)
    axes.set_facecolor("#EDEDED")
    axes.grid(False)
    axes.pcolormesh(share, cmap="cividis", vmin=0, vmax=100, edgecolors="white", linewidth=1.5)
    for r, c in zip(*np.nonzero(there), strict=True):
        ink = "white" if share[r, c] < 55 else "black"
        axes.text(c + 0.5, r + 0.5, f"{share[r, c]:.0f}", ha="center", va="center", color=ink, fontsize=10)
    axes.set_xticks(range(n_columns + 1), [f"{e:g}" for e in np.round(edges, 3)])
    axes.set_yticks(np.arange(n_rows) + 0.5, ["all" if h is None else f"{h:g}" for h in heights])
    axes.tick_params(length=0)
    axes.set(xlabel="distance to the marker (m)", ylabel="height (m)")


# --- Figure 4 ----

AXES = {
    "rotation_x_deg": "about x: nodding",
    "rotation_y_deg": "about y: turning",
    "rotation_z_deg": "about z: rolling",
}


def bands(axes, x, y, edges, colour):
    """Draw the points, and per bin the median with bands that hold 50 and 90 of 100 pairs."""
    axes.axhline(0, color=GREY, linewidth=1)
    axes.plot(x, y, ".", color=colour, markersize=3, alpha=0.35)
    index = np.clip(np.digitize(x, edges) - 1, 0, len(edges) - 2)
    used = [k for k in range(len(edges) - 1) if (index == k).sum() >= 5]
    if not used:
        return
    quantiles = np.array([np.quantile(y[index == k], [0.05, 0.25, 0.5, 0.75, 0.95]) for k in used])
    centres = np.array([(edges[k] + edges[k + 1]) / 2 for k in used])
    axes.fill_between(centres, quantiles[:, 0], quantiles[:, 4], color=colour, alpha=0.15, linewidth=0)
    axes.fill_between(centres, quantiles[:, 1], quantiles[:, 3], color=colour, alpha=0.3, linewidth=0)
    axes.plot(centres, quantiles[:, 2], "-o", color=colour, markersize=4, linewidth=1.8)


def rotation_figure(pairs, edges, limit_deg, title):
    """Return a figure: rotation of real against twin per axis over distance; flips as ticks along the top."""
    steady, flips = pairs[~pairs.flipped], pairs[pairs.flipped]
    figure, rows = plt.subplots(3, 1, figsize=(WIDTH_IN, 5.6), sharex=True, sharey=True)
    for axes, (name, words) in zip(rows, AXES.items(), strict=True):
        bands(axes, steady.range_m.to_numpy(), steady[name].to_numpy(), edges, BLUE)
        axes.set_ylim(-limit_deg, limit_deg)
        axes.set_ylabel("difference (°)")
        axes.text(0.01, 0.04, words, transform=axes.transAxes, color=GREY)
        axes.yaxis.set_major_locator(MaxNLocator(5))
        if len(flips):
            axes.plot(flips.range_m, np.full(len(flips), 0.93 * limit_deg), "v", color=ORANGE, markersize=6)
    rows[0].set_title(f"{title}: {len(steady)} pairs, {len(flips)} flips (▼)")
    rows[-1].set_xlabel("distance to the marker (m)")
    return figure


def distance_figure(pairs, edges, limit_pct, title):
    """Return a figure: real minus twin distance, in % of the range, over distance; flips left out."""
    steady = pairs[~pairs.flipped]
    figure, axes = plt.subplots(figsize=(WIDTH_IN, 2.6))
    percent = 100 * (steady.delta_distance_m / steady.range_m).to_numpy()
    bands(axes, steady.range_m.to_numpy(), percent, edges, GREEN)
    axes.set(xlabel="distance to the marker (m)", ylabel="real − twin (%)", title=title)
    axes.set_ylim(-limit_pct, limit_pct)
    return figure


def round_limit(values, share=0.98, least=1.0):
    """Return a round number that holds ``share`` of the absolute values; ``least`` where there are none."""
    if not len(values):
        return least
    top = max(least, float(np.quantile(np.abs(values), share)) * 1.15)
    step = 10 ** np.floor(np.log10(top)) / 2
    return float(np.ceil(top / step) * step)


# --- Tables ------


def share_figure(table, measures, title):
    """Return a figure: percentages with intervals, a row a camera (and algorithm), a colour a measure."""
    label = table.camera if "algorithm" not in table else table.camera + ", " + table.algorithm
    figure, axes = plt.subplots(figsize=(WIDTH_IN, 1.2 + 0.55 * len(table)))
    marks = [("o", BLUE), ("s", ORANGE), ("^", GREEN), ("D", GREY)]
    for k, ((name, words), (mark, colour)) in enumerate(zip(measures.items(), marks, strict=False)):
        y = np.arange(len(table)) + 0.2 * (k - (len(measures) - 1) / 2)
        value = table[name].to_numpy(float)
        error = np.abs(np.stack([value - table[f"{name}_low"], table[f"{name}_high"] - value]))
        axes.errorbar(value, y, xerr=error, fmt=mark, color=colour, label=words, markersize=6, capsize=0)
    axes.set_yticks(range(len(table)), label)
    axes.set(xlim=(0, 102), xlabel="%", title=title)
    axes.set_ylim(len(table) - 0.5, -0.5)
    figure.legend(loc="outside lower center", ncols=2, frameon=False)
    return figure


def markdown_table(path):
    """Return a Markdown table file as HTML: title, table that scrolls sideways, notes."""
    title, *lines = Path(path).read_text(encoding="utf-8").splitlines()
    rows = [[c.strip() for c in line.strip("|").split("|")] for line in lines if line.startswith("|")]
    notes = [line for line in lines if line and not line.startswith("|")]
    parts = [f"<p><strong>{html.escape(title)}</strong></p>"]
    if len(rows) > 2:
        head, body = rows[0], rows[2:]
        parts.append('<div class="wide" style="overflow-x:auto"><table><thead><tr>')
        parts += [f"<th>{html.escape(c)}</th>" for c in head]
        parts.append("</tr></thead><tbody>")
        for row in body:
            kind = ' class="paper"' if row[0].endswith(", paper") else ""
            cells = (html.escape(c).replace(" (", "<br><small>(", 1) + ("</small>" if " (" in c else "") for c in row)
            parts.append(f"<tr{kind}>" + "".join(f"<td>{c}</td>" for c in cells) + "</tr>")
        parts.append("</tbody></table></div>")
    parts += [f'<p class="note">{html.escape(note)}</p>' for note in notes]
    return HTML("".join(parts))
