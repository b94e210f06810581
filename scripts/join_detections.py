"""Join: the detections of a camera's parts to those of the camera, byte for byte what one job would have written."""

import pandas as pd

import job

ORDER = ["source", "capture"]


def join_tables(parts, out):
    """Join CSV tables, each of other captures, sorted by source and capture; values stay the text that they are."""
    tables = [pd.read_csv(path, dtype=str, keep_default_na=False) for path in parts]
    joined = pd.concat(tables).sort_values(ORDER, kind="stable")
    with job.write_atomically(out) as file:
        joined.to_csv(file, index=False, lineterminator="\n")


def join_detections(parts, timings, out, timing):
    """Join the detections and the timings of a camera's parts."""
    join_tables(parts, out)
    join_tables(timings, timing)


if __name__ == "__main__":
    job.run(
        join_detections,
        snakemake,
        parts=snakemake.input.parts,
        timings=snakemake.input.timings,
        out=snakemake.output.detections,
        timing=snakemake.output.timing,
    )
