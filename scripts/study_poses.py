"""Study: one marker in many poses, several noise draws each, detected by several detectors on the same images."""

import logging

import numpy as np
import pandas as pd
import pandera.pandas as pa

import job
from detectors import contract
from id_study.views import place_of
from inputs.tables import CORNERS, write_table
from poses_study.views import digitised, expected_levels, pose_table, scene_of, study_noise, view_of

log = logging.getLogger("twingap")

# A row a pose, draw and detector; corners are empty where the marker was not found.
SIGHTINGS = pa.DataFrameSchema(
    {name: pa.Column(str) for name in ("dictionary", "pose", "detector")}
    | {name: pa.Column(int) for name in ("id", "draw", "false_ids")}
    | {name: pa.Column(float, nullable=True, coerce=True) for name in CORNERS},
    strict=True,
)


def sighting(found, family, number, place):
    """Return (corners (4, 2) of the marker, NaN where it was not found; how many others were) of Detections.

    place  (centre, half side) as id_study.views.place_of has it: a detection counts only with the right id within half a
           side, and of two such the nearer
    """
    centre, half = place
    offsets = [
        np.linalg.norm(d.corners.mean(axis=0) - centre) if (d.dictionary, d.id) == (family, number) else np.inf
        for d in found
    ]
    right = [k for k, offset in enumerate(offsets) if offset <= half]
    nearest = min(right, key=lambda k: offsets[k], default=None)
    corners = np.full((4, 2), np.nan) if nearest is None else found[nearest].corners
    return corners, len(found) - len(right)


def study_poses(family, part, families, number, detectors, draws, ranges, seed, out):
    """Write what detectors saw of a part of the poses.

    family     that is shown; ``families`` are sought in every image
    part       (first, after the last) of the poses
    number     id of the marker
    detectors  {name: parameters}, of which those that read the family look
    draws      images of a pose, each with noise of its own
    ranges     keywords of views.pose_table besides its count: more poses leave the first ones as they are
    """
    able = contract.readers(sorted(detectors), [family], "configuration: poses_study")
    finders = {name: contract.make(name, families, detectors[name], f"detectors.{name}") for name in able}
    noise = [study_noise(draw, seed) for draw in range(draws)]
    scene, rows = scene_of(family, number), []
    for row in pose_table(part[1], **ranges, seed=seed).iloc[part[0] :].itertuples():
        view = view_of(row)
        levels, place = expected_levels(scene, view), place_of(family, number, view)
        for draw, grain in enumerate(noise):
            image = digitised(levels, grain)
            for name, finder in finders.items():
                corners, false = sighting(finder.detect(image), family, number, place)
                rows.append([family, row.pose, name, number, draw, false, *corners.ravel()])
    table = pd.DataFrame(rows, columns=list(SIGHTINGS.columns))
    write_table(table, out, SIGHTINGS)
    log.info("%s: poses %d to %d by %s", family, part[0], part[1] - 1, ", ".join(able))


if __name__ == "__main__":
    job.run(
        study_poses,
        snakemake,
        family=snakemake.wildcards.family,
        part=snakemake.params.part,
        families=snakemake.params.families,
        number=snakemake.params.number,
        detectors=snakemake.params.detectors,
        draws=snakemake.params.draws,
        ranges=snakemake.params.ranges,
        seed=snakemake.params.seed,
        out=snakemake.output[0],
    )
