"""The picture that a report starts with, and `make picture` draws for the README: a patch of the capture, of its twin and of
their difference, before and after the effects that the diagnosis found, beside the gap that falls to its floor.

Patches, not frames: what most effects do is seen in a few pixels. Drawn from what the diagnosis wrote.
"""

import json
import sys
from pathlib import Path

import figures
import matplotlib.pyplot as plt
import numpy as np
import pandas as pd
from matplotlib.image import imread
from PIL import Image
from scipy.ndimage import maximum_filter, uniform_filter

EXAMPLES = ("real", "configured", "explained")
PATCH_PX = 52  # side of a patch: a plate at a middle distance
FULL_SCALE_DN = 60  # difference that is drawn as full red or blue
EDGE_DN = 40  # what varies less in a patch's middle is not looked at: plates show more than ground
MAX_NAMED = 3  # effects that a line holds
COLOURS = 192  # of the README's PNG: a third of the bytes, and no difference to see


def examples_of(results, camera):
    """Return {name: image (H, W, 3), 0..255} of the diagnosis' example, None where it has none."""
    paths = {name: Path(results) / "diagnosis" / camera / f"example_{name}.png" for name in EXAMPLES}
    if not all(p.is_file() for p in paths.values()):
        return None
    images = {name: 255 * np.atleast_3d(imread(p))[..., :3] for name, p in paths.items()}
    images = {name: np.repeat(i, 3, axis=2) if i.shape[2] == 1 else i for name, i in images.items()}
    return images if min(images["real"].shape[:2]) > PATCH_PX else None


def patch_of(images):
    """Return (rows, columns), slices, of the patch with a print in it where the found effects gain most."""
    grey = {name: image.mean(axis=2) for name, image in images.items()}
    before, after = (uniform_filter((grey[name] - grey["real"]) ** 2, PATCH_PX) for name in EXAMPLES[1:])
    middle = PATCH_PX // 2
    contrast = maximum_filter(grey["real"], middle) + maximum_filter(-grey["real"], middle)
    gained = np.where(contrast > EDGE_DN, before - after, -np.inf)
    half = PATCH_PX // 2
    inside = gained[half:-half, half:-half]
    row, column = np.unravel_index(np.argmax(inside), inside.shape)
    return slice(row, row + 2 * half), slice(column, column + 2 * half)


def headline(diagnosis):
    """Return the line above a camera's patches: what was found, or the verdict."""
    names = [s["effect"].replace("_", " ") for s in diagnosis["steps"]]
    found = ", ".join(names) if len(names) <= MAX_NAMED else f"{len(names)} effects"
    by_itself = " by itself" if diagnosis.get("baseline") else ""
    return f"{diagnosis['camera']}{by_itself}: {'+ ' + found if names else diagnosis['verdict']}"


def draw_camera(figure, images, diagnosis, ladder):
    """Draw one camera on a figure: patches of capture and twins, below them the gap and the differences."""
    rows, columns = patch_of(images)
    axes = figure.subplots(2, 3)
    figures.head(figure, headline(diagnosis), fontweight="bold")
    titles = ("capture", *(("twin before", "twin after") if diagnosis["steps"] else ("twin", "twin")))
    for column, (name, title) in enumerate(zip(EXAMPLES, titles, strict=True)):
        axes[0, column].imshow(np.clip(images[name][rows, columns] / 255, 0, 1), interpolation="nearest")
        axes[0, column].set_title(title, fontsize=9.5, fontweight="normal")
        if column:
            off = (images["real"] - images[name]).mean(axis=2)[rows, columns]
            axes[1, column].imshow(off, cmap="RdBu", vmin=-FULL_SCALE_DN, vmax=FULL_SCALE_DN, interpolation="nearest")
            axes[1, column].set_title(
                f"differs by {np.sqrt((off**2).mean()):.1f} DN", fontsize=9.5, fontweight="normal"
            )
    for axis in (*axes[0], *axes[1, 1:]):
        axis.set_axis_off()
    draw_gap(axes[1, 0], ladder)


def draw_gap(axes, ladder):
    """Draw the gap of each twin of a ladder as a bar, and the floor as a dashed line."""
    gap = ladder.gap.to_numpy(float)
    colours = [figures.GREY] + [figures.BLUE] * (len(gap) - 1)
    axes.bar(range(len(gap)), gap, color=colours, width=0.7)
    axes.axhline(1, color=figures.ORANGE, ls="--", lw=1.5)
    for k, value in enumerate(gap):
        axes.text(k, value, f"{value:.1f}", ha="center", va="bottom", fontsize=8.5)
    axes.set_xticks(range(len(gap)), ["ideal", *(f"+{k}" for k in range(1, len(gap)))], fontsize=8.5)
    axes.set_ylim(0, 1.2 * np.nanmax([*gap, 1]))
    axes.set_yticks([])
    axes.spines["left"].set_visible(False)
    axes.grid(False)
    axes.set_title("gap, floors", fontsize=9.5, fontweight="normal")


def cameras_of(results):
    """Return [(images, diagnosis, ladder)] of the cameras whose diagnosis has an example."""
    found = []
    for path in sorted((Path(results) / "diagnosis").glob("*.json")):
        diagnosis = json.loads(path.read_text())
        diagnosis |= diagnosis.get("alone", {})  # pictures and ladder are of these captures, not of what has changed
        images = examples_of(results, diagnosis["camera"])
        ladder = pd.read_csv(path.with_suffix("") / "ladder.csv")
        if images is not None and len(ladder):
            found.append((images, diagnosis, ladder))
    return found


def front_figures(results):
    """Return [(figure, what it shows)], one a camera."""
    pictures = []
    for images, diagnosis, ladder in cameras_of(results):
        figure = plt.figure(figsize=(figures.WIDTH_IN, 3.7))
        draw_camera(figure, images, diagnosis, ladder)
        words = (
            f"{diagnosis['camera']}: {PATCH_PX} pixels of a capture that no fit has seen, of its twin before and after, and how "
            "far they differ (red: the twin is brighter)"
        )
        pictures.append((figure, words))
    return pictures


def draw(results):
    """Return one figure of all cameras side by side."""
    cameras = cameras_of(results)
    figure = plt.figure(figsize=(4.4 * len(cameras), 3.5), dpi=100)
    for part, camera in zip(np.atleast_1d(figure.subfigures(1, len(cameras))), cameras, strict=True):
        draw_camera(part, *camera)
    return figure


def save(figure, path):
    """Write a figure as a PNG of few colours."""
    figure.canvas.draw()
    rgb = np.asarray(figure.canvas.buffer_rgba())[..., :3]
    Image.fromarray(rgb).quantize(COLOURS, dither=Image.Dither.NONE).save(path, optimize=True)


if __name__ == "__main__":
    plt.switch_backend("agg")
    save(draw(Path(sys.argv[1])), sys.argv[2])
