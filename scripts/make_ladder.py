"""Ladder: join the cameras' ladders, every twin on the way with its held-out errors, to tables/ladder.csv."""

from pathlib import Path

import pandas as pd

import job

FIRST = ["camera", "step", "effect"]


def make_ladder(parts, out):
    """Write the ladders of all cameras to one table, cameras by name, steps in order."""
    tables = [pd.read_csv(path) for path in sorted(map(str, parts))]
    table = pd.concat([t for t in tables if len(t)], ignore_index=True) if any(map(len, tables)) else tables[0]
    table = table[FIRST + [c for c in table.columns if c not in FIRST]].sort_values(["camera", "step"], kind="stable")
    with job.write_atomically(Path(out)) as file:
        table.to_csv(file, index=False, lineterminator="\n")


if __name__ == "__main__":
    job.run(make_ladder, snakemake, parts=snakemake.input.parts, out=snakemake.output[0])
