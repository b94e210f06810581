"""Study: some ids of a family through the same views, detected by several detectors that seek all families of the study."""

import logging

import numpy as np
import pandas as pd
import pandera.pandas as pa

import job
from detectors import contract
from id_study.views import place_of, study_image, study_noise, study_scene, study_views
from inputs.tables import write_table

log = logging.getLogger("twingap")

# A row a view and detector; of a view with false ids, one a false id.
READINGS = pa.DataFrameSchema(
    {"dictionary": pa.Column(str), "id": pa.Column(int), "view": pa.Column(str), "detector": pa.Column(str)}
    | {"read": pa.Column(bool, coerce=True), "false_dictionary": pa.Column(str, nullable=True, coerce=True)}
    | {"false_id": pa.Column("Int64", nullable=True, coerce=True)},
    strict=True,
)


def readings(found, family, number, place):
    """Return (whether a marker was read, [(family, id) that count as false]) of Detections in a view.

    place  (centre, half side) as id_study.views.place_of has it: a detection counts only with the right id within half a side
    """
    centre, half = place
    read, false = False, []
    for d in found:
        right = (d.dictionary, d.id) == (family, number)
        if right and np.linalg.norm(d.corners.mean(axis=0) - centre) <= half:
            read = True
        else:
            false.append((d.dictionary, d.id))
    return read, sorted(false)


def study_ids(family, ids, families, detectors, views, seed, out):
    """Write the readings of some ids of a family.

    families   that are sought in every image
    detectors  {name: parameters}; those that read none of the families are left out
    views      how many
    """
    able = contract.readers(sorted(detectors), families, "configuration: detectors")
    finders = {name: contract.make(name, families, detectors[name], f"detectors.{name}") for name in able}
    chosen = study_views(views)
    noise = [study_noise(view, seed) for view in chosen]
    rows = []
    for number in ids:
        scene = study_scene(family, number)
        for view, grain in zip(chosen, noise, strict=True):
            image, place = study_image(scene, view, grain), place_of(family, number, view)
            for name, finder in finders.items():
                read, false = readings(finder.detect(image), family, number, place)
                for wrong in false or [("", None)]:
                    rows.append([family, number, view.capture, name, read, *wrong])
    table = pd.DataFrame(rows, columns=list(READINGS.columns))
    write_table(table, out, READINGS)
    log.info("%s: %d ids in %d views by %s", family, len(ids), views, ", ".join(able))


if __name__ == "__main__":
    job.run(
        study_ids,
        snakemake,
        family=snakemake.wildcards.family,
        ids=snakemake.params.ids,
        families=snakemake.params.families,
        detectors=snakemake.params.detectors,
        views=snakemake.params.views,
        seed=snakemake.params.seed,
        out=snakemake.output[0],
    )
