"""Draw the README's second picture from a run on photographs: `make picture`.

A photograph, its twin and both in one: real green, twin magenta, grey where they agree.
"""

import sys
from pathlib import Path

import cv2
import figures
import matplotlib.pyplot as plt
from front_picture import save


def draw(results, campaign, camera):
    """Return the figure of a camera's typical photograph."""
    run = figures.read_run(results)
    _, detector = figures.reference_cells(run)
    capture = figures.typical_capture(run, camera)
    shot = figures.read_capture(run, campaign, camera, capture)
    twin = figures.outlined(shot.twin, run, camera, capture, "twin", shot.K, shot.T_twin, detector)
    real = figures.outlined(shot.real, run, camera, capture, "real", shot.K, shot.T_real, detector)
    shown = {
        "photograph: found markers blue": real,
        "ideal twin in its place": twin,
        "both: coloured where they differ": figures.overlay(shot),
    }
    return side_by_side(shown)


def side_by_side(shown):
    """Return the figure of pictures {words above it: (H, W, 3), blue first}."""
    figure, row = plt.subplots(1, len(shown), figsize=(11, 3.0), dpi=100, layout="constrained")
    for axes, (words, image) in zip(row, shown.items(), strict=True):
        axes.imshow(cv2.cvtColor(image, cv2.COLOR_BGR2RGB))
        axes.set_axis_off()
        axes.set_title(words, fontsize=10)
    return figure


if __name__ == "__main__":
    plt.switch_backend("agg")
    save(draw(Path(sys.argv[1]), Path(sys.argv[2]), sys.argv[3]), sys.argv[4])
