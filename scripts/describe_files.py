"""Describe: what the files of a camera's captures say of themselves: EXIF, a JPEG's own tables. Makes a table."""

from pathlib import Path

import pandas as pd

import job
from inputs.campaign import inside
from inputs.photo_facts import photo_facts
from inputs.tables import CAPTURES, FILES, read_table, write_table


def describe_files(captures, campaign, camera, out):
    """Write one row a capture of a camera, as inputs.photo_facts has it; no row without photographs.

    captures  expand/captures.csv
    """
    table = read_table(captures, CAPTURES)
    rows = [
        {"capture": c.capture} | photo_facts(inside(campaign, c.image, f"{campaign}: capture {c.capture}"))
        for c in table[table.camera == camera].sort_values("capture").itertuples()
    ]
    write_table(pd.DataFrame(rows, columns=list(FILES.columns)), out, FILES)


if __name__ == "__main__":
    job.run(
        describe_files,
        snakemake,
        captures=Path(snakemake.input.captures),
        campaign=snakemake.params.campaign,
        camera=snakemake.wildcards.camera,
        out=snakemake.output.table,
    )
