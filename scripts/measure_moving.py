"""Measure: what each detector reports of moving cameras against the exact truth; timings in a table of their own."""

import pandas as pd

import job
from detect_moving import DETECTIONS, TIMING
from inputs.tables import read_table
from moving.config import load_moving
from moving.metrics import CELL, latency, match_reports, summary
from moving.truth import TRUTH

CELLS = [*CELL, "in_frame", "hidden", "seen", "reported", "kept", "corner_px", "translation_mm", "rotation_deg"]


def measure_moving(experiment, truth, detections, timings, out, cells_out, timing_out):
    """Write the measures per detector and trajectory, the errors of every marker and frame, and the latencies.

    detections, timings  {detector: path}
    """
    moving = load_moving(experiment)
    true = read_table(truth, TRUTH)
    at_rest = [name for name, motion in moving.file.trajectories.items() if motion.kind == "at_rest"]
    measures, clocks, all_cells = [], [], []
    for detector in sorted(detections):
        cells, false = match_reports(true, read_table(detections[detector], DETECTIONS))
        timing = read_table(timings[detector], TIMING)
        all_cells.append(cells[CELLS].assign(detector=detector))
        for name in [*sorted(moving.file.trajectories), "all"]:
            mine, wrong, clock = (t if name == "all" else t[t.trajectory == name] for t in (cells, false, timing))
            here = {"detector": detector, "trajectory": name}
            measures.append(here | summary(mine, wrong, moving.file.fps, at_rest))
            clocks.append(here | latency(clock))
    write(pd.DataFrame(measures), out)
    write(pd.concat(all_cells)[["detector", *CELLS]], cells_out)
    write(pd.DataFrame(clocks), timing_out)


def write(table, path):
    """Write a table as CSV, floats at full precision."""
    with job.write_atomically(path) as file:
        table.to_csv(file, index=False, lineterminator="\n")


if __name__ == "__main__":
    detectors = snakemake.params.detectors
    job.run(
        measure_moving,
        snakemake,
        experiment=snakemake.input.experiment,
        truth=snakemake.input.truth,
        detections=dict(zip(detectors, snakemake.input.detections, strict=True)),
        timings=dict(zip(detectors, snakemake.input.timings, strict=True)),
        out=snakemake.output.measures,
        cells_out=snakemake.output.cells,
        timing_out=snakemake.output.timing,
    )
