"""Join: the observations of a camera's parts to those of the camera."""

import case_files
import job


def join_observations(parts, out):
    """Join the observations (npz) of a camera's parts, given in the order of their captures."""
    with job.write_atomically(out, "wb") as file:
        case_files.join_observations(parts, file)


if __name__ == "__main__":
    job.run(join_observations, snakemake, parts=snakemake.input.parts, out=snakemake.output.observations)
