"""Join: the cameras' rows of Table 2, before and after the named effects, to tables/before_after.csv."""

import pandas as pd

import job

FIRST = ["camera", "algorithm", "twin_is"]


def join_comparisons(parts, out):
    """Write all rows to one table, by camera and algorithm, the ideal twin before the explained one."""
    table = pd.concat([pd.read_csv(path) for path in sorted(map(str, parts))], ignore_index=True)
    table = table[FIRST + [name for name in table.columns if name not in FIRST]]
    table = table.sort_values(FIRST, ascending=[True, True, False], kind="stable")
    with job.write_atomically(out) as file:
        table.to_csv(file, index=False, lineterminator="\n")


if __name__ == "__main__":
    job.run(join_comparisons, snakemake, parts=snakemake.input.parts, out=snakemake.output[0])
