"""Draw the picture of docs/clusters.md: ``python notebooks/cluster_picture.py OUT.png``."""

import sys

import matplotlib

matplotlib.use("Agg")
import matplotlib.pyplot as plt
from matplotlib.patches import FancyArrowPatch, FancyBboxPatch

BOXES = {
    "store": (0.2, 1.0, "object store\n(S3)", "#f3e3c3"),
    "login": (2.6, 1.0, "login node\nsnakemake --profile\nprofiles/slurm", "#cfe2f3"),
    "slurm": (5.0, 1.0, "Slurm\nsbatch, squeue", "#d9d2e9"),
    "node1": (7.4, 1.75, "node\nrender, detect, ...", "#d9ead3"),
    "node2": (7.4, 0.25, "node\nobserve, diagnose", "#d9ead3"),
    "share": (5.0, -1.0, "one folder that all see: clone, .venv, data/raw, results", "#eeeeee"),
}
WIDTH, HEIGHT = 1.8, 1.0
ARROWS = [
    ("store", "login", "fetch_data.py"),
    ("login", "slurm", "jobs: threads,\nmem_mb, runtime"),
    ("slurm", "node1", ""),
    ("slurm", "node2", ""),
]


def draw(path):
    """Draw boxes and the ways between them to a PNG."""
    figure, axis = plt.subplots(figsize=(10, 3.6), layout="constrained")
    for name, (x, y, text, colour) in BOXES.items():
        left, width = (2.6, 6.6) if name == "share" else (x, WIDTH)
        height = 0.6 if name == "share" else HEIGHT
        style = "round,pad=0.02,rounding_size=0.1"
        axis.add_patch(FancyBboxPatch((left, y), width, height, boxstyle=style, fc=colour, ec="#555555"))
        axis.text(left + width / 2, y + height / 2, text, ha="center", va="center", fontsize=9)
    for start, end, text in ARROWS:
        a, b = BOXES[start], BOXES[end]
        tail, head = (a[0] + WIDTH, a[1] + HEIGHT / 2), (b[0], b[1] + HEIGHT / 2)
        axis.add_patch(FancyArrowPatch(tail, head, arrowstyle="-|>", mutation_scale=12, color="#333333"))
        axis.text((tail[0] + head[0]) / 2, tail[1] + 0.62, text, ha="center", va="bottom", fontsize=8)
    for x, top in ((3.5, 1.0), (8.3, 0.25)):
        axis.add_patch(FancyArrowPatch((x, top), (x, -0.4), arrowstyle="<|-|>", mutation_scale=12, color="#333333"))
    axis.set(xlim=(0, 9.4), ylim=(-1.2, 3.0))
    axis.axis("off")
    figure.savefig(path, dpi=110)


if __name__ == "__main__":
    draw(sys.argv[1])
