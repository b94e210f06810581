"""Draw the README's picture from a run: `make picture`.

Real, twin and their difference for one capture, before and after the effects that the diagnosis found, beside the
errors that fall to their floors. Drawn from a run's tables, renders and images.
"""

import json
import sys
import tempfile
from pathlib import Path

import cv2
import figures
import matplotlib.pyplot as plt
import numpy as np
import pandas as pd
from matplotlib.ticker import NullFormatter, StrMethodFormatter
from PIL import Image

from detectors import contract
from expose_twin import expose_twin

SHOWN = {"corner_rmse_px": "corners off, px", "intensity_rmse_dn": "grey levels, DN"}
FULL_SCALE_DN = 60  # difference that is drawn as full red or blue
COLOURS = 128  # of the PNG: a third of the bytes, and no difference to see


def explained_twin(results, camera, steps, capture):
    """Return the twin's image (grey) of a capture with the effects of the diagnosis' steps."""
    effects = [[s["effect"], {k: p["value"] for k, p in s["parameters"].items()}] for s in steps]
    manifest, register = results / f"render/{camera}.json", results / f"register/{camera}.json"
    with tempfile.TemporaryDirectory() as folder:
        out = Path(folder) / "twin"
        expose_twin(results / "expand" / camera, register, manifest, camera, effects, "picture", out)
        return cv2.imread(str(out / f"{capture}.png"), cv2.IMREAD_GRAYSCALE)


def aligned(twin, real):
    """Return the twin moved onto the real image by the homography between markers found in both.

    A capture is off its station by a few pixels, which is no fault of the twin's.
    """
    detector = contract.make("aruco_subpix")
    there, here = ({(d.dictionary, d.id): d.corners for d in detector.detect(i)} for i in (twin, real))
    both = sorted(there.keys() & here.keys())
    H, _ = cv2.findHomography(np.concatenate([there[k] for k in both]), np.concatenate([here[k] for k in both]))
    return cv2.warpPerspective(twin, H, twin.shape[::-1], borderMode=cv2.BORDER_REPLICATE)


def show(axes, image, title):
    """Draw a grey image, or a signed difference (float) in red and blue."""
    signed = image.dtype != np.uint8
    style = {"cmap": "RdBu", "vmin": -FULL_SCALE_DN, "vmax": FULL_SCALE_DN}
    axes.imshow(image, **(style if signed else {"cmap": "gray", "vmin": 0, "vmax": 255}))
    axes.set_axis_off()
    axes.set_title(title, fontsize=10)


def draw(results, camera):
    """Return the figure."""
    run = figures.read_run(results)
    diagnosis = json.loads((results / f"diagnosis/{camera}.json").read_text())
    ladder = pd.read_csv(results / f"diagnosis/{camera}/ladder.csv")
    capture = figures.typical_capture(run, camera)
    shot = figures.read_capture(run, Path("data/raw") / run.scene["name"], camera, capture)
    real, ideal = (cv2.cvtColor(image, cv2.COLOR_BGR2GRAY) for image in (shot.real, shot.twin))
    found = explained_twin(results, camera, diagnosis["steps"], capture)
    names = [s["effect"].replace("_", " ") for s in diagnosis["steps"]]
    figure = plt.figure(figsize=(11, 5), dpi=100)
    figure.suptitle(f"{camera}: where the twin fails, what it lacks, and its error falling to the floor (dashed)")
    grid = figure.add_gridspec(2, 3)
    show(
        figure.add_subplot(grid[0, 0]),
        real,
        "simulated stand-in" if run.scene["origin"] == "simulated" else "photograph",
    )
    for row, (twin, title) in enumerate([(ideal, "ideal twin"), (found, f"twin with {len(names)} effects")]):
        show(figure.add_subplot(grid[row, 1]), twin, title)
        show(figure.add_subplot(grid[row, 2]), real.astype(float) - aligned(twin, real), "difference")
    for axes, (measure, label) in zip(grid[1, 0].subgridspec(1, 2).subplots(), SHOWN.items(), strict=True):
        axes.plot(ladder.step, ladder[measure], "o-", color=figures.BLUE)
        axes.plot(ladder.step, ladder[f"{measure}_floor"], "--", color=figures.GREY)
        axes.set_yscale("log")
        axes.yaxis.set_major_formatter(StrMethodFormatter("{x:g}"))
        axes.yaxis.set_minor_formatter(NullFormatter())
        axes.set_title(label, fontsize=9)
        axes.set_xticks(ladder.step, ["ideal", *(f"+ {n}" for n in names)], rotation=20, ha="right", fontsize=8)
        axes.tick_params(axis="y", labelsize=8)
    return figure


def save(figure, path):
    """Write a figure as a PNG of few colours."""
    figure.canvas.draw()
    rgb = np.asarray(figure.canvas.buffer_rgba())[..., :3]
    Image.fromarray(rgb).quantize(COLOURS, dither=Image.Dither.NONE).save(path, optimize=True)


if __name__ == "__main__":
    plt.switch_backend("agg")
    save(draw(Path(sys.argv[1]), sys.argv[2]), sys.argv[3])
