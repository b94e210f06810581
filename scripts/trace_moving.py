"""Trace: where every marker of a moving experiment is seen in every frame, exactly. Needs no Blender."""

from pathlib import Path

import pandas as pd

import job
from inputs.tables import MARKERS, write_table
from moving.config import load_moving
from moving.truth import TRUTH, truth_table


def trace_moving(experiment, truth, markers):
    """Write the truth of all trajectories of an experiment's file, and its markers, as CSV."""
    moving = load_moving(experiment)
    table = pd.concat([truth_table(moving, name) for name in sorted(moving.file.trajectories)])
    write_table(moving.markers, markers, MARKERS)
    write_table(table, truth, TRUTH)


if __name__ == "__main__":
    job.run(
        trace_moving,
        snakemake,
        experiment=Path(snakemake.input.experiment),
        truth=snakemake.output.truth,
        markers=snakemake.output.markers,
    )
