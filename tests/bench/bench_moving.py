"""How much poses scatter at rest, and how many frames an occlusion costs: python tests/bench/bench_moving.py

Renders a camera at rest and one before which an object passes (config/moving/default.yaml, a seed of its own), runs the
detectors on both as on video, prints BART beside ArUco and records it (record.py). About two minutes on one core.
"""

import argparse
import sys
import tempfile
from pathlib import Path

PROJECT = Path(__file__).resolve().parents[2]
sys.path.insert(0, str(PROJECT / "scripts"))

import pandas as pd
import yaml

import job
from detect_moving import detect_moving
from inputs.safe_yaml import load_yaml
from measure_moving import measure_moving
from moving.config import load_moving
from record import record
from render_moving import render_moving
from trace_moving import trace_moving

TRAJECTORIES = ("at_rest", "hand_held_sway", "occlusion")
SHOWN = {
    "at_rest": ["recall_pct", "jitter_mm", "jitter_deg"],
    "hand_held_sway": ["recall_pct", "shake_mm", "corner_median_px"],
    "occlusion": [
        "recall_pct",
        "hidden_frames",
        "hidden_frames_lost",
        "bridged_corner_median_px",
        "recovery_most_frames",
    ],
}


def write_experiment(folder, seed):
    """Write the experiment with another seed and only the trajectories that are needed; return its path."""
    content = load_yaml(PROJECT / "config/moving/default.yaml")
    content |= {"name": "bench", "seed": seed}
    content["trajectories"] = {name: content["trajectories"][name] for name in TRAJECTORIES}
    path = folder / "config/moving/bench.yaml"
    path.parent.mkdir(parents=True)
    path.write_text(yaml.safe_dump(content))
    (folder / "config/rigs").symlink_to(PROJECT / "config/rigs")
    return path


def measure(folder, seed):
    """Return the measures (detector, trajectory) as a table."""
    experiment = write_experiment(folder, seed)
    detectors = list(load_moving(experiment).file.detectors)
    trace_moving(experiment, folder / "truth.csv", folder / "markers.csv")
    frames = {name: folder / "frames" / name for name in TRAJECTORIES}
    for name in TRAJECTORIES:
        render_moving(experiment, name, folder / "render" / name, frames[name], folder / "seconds.csv")
    found = {name: folder / f"{name}.csv" for name in detectors}
    clocks = {name: folder / f"{name}_timing.csv" for name in detectors}
    for name in detectors:
        detect_moving(experiment, name, frames, found[name], clocks[name])
    out = folder / "moving.csv"
    measure_moving(experiment, folder / "truth.csv", found, clocks, out, folder / "cells.csv", folder / "ms.csv")
    return pd.read_csv(out).set_index(["detector", "trajectory"])


def report(measures):
    """Print a table for each trajectory, and both aims; record these."""
    for trajectory, columns in SHOWN.items():
        table = measures.xs(trajectory, level="trajectory")[columns]
        print(f"\n{trajectory}\n\n{table.to_markdown(floatfmt='.3g')}")
    figures = []
    rest, hidden = (measures.xs(name, level="trajectory") for name in ("at_rest", "occlusion"))
    for unit, what in (("mm", "BART's jitter at rest, place"), ("deg", "BART's jitter at rest, turn")):
        mine, theirs = (rest.loc[name, f"jitter_{unit}"] for name in ("bart", "aruco_subpix"))
        print(
            f"\njitter at rest, {unit}: BART {mine:.3g}, ArUco with sub-pixel corners {theirs:.3g}: {mine / theirs:.0%}"
        )
        figures.append((what, float(100 * mine / theirs), "% of sub-pixel ArUco's"))
    lost = {name: int(hidden.loc[name, "hidden_frames_lost"]) for name in ("bart", "aruco")}
    print(
        f"\nframes lost of {int(hidden.hidden_frames['bart'])} hidden ones: BART {lost['bart']}, ArUco {lost['aruco']}"
    )
    lost_of = f"{lost['bart']} ({lost['aruco']}) of {int(hidden.hidden_frames['bart'])}"
    record([*figures, ("frames lost through an occlusion by BART (ArUco)", lost_of, "frames")])


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--seed", default="bench", help="of motion and noise")
    arguments = parser.parse_args()
    job.set_up_log()
    with tempfile.TemporaryDirectory() as scratch:
        report(measure(Path(scratch), arguments.seed))
