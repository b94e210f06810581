"""Study: what detectors find of a designed experiment's markers in the images of several twins of a camera.

Each station's render is used for all of them; a detection counts where the twin's lens puts its marker.
"""

import functools
import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pandas as pd
import pandera.pandas as pa
from tqdm import tqdm

import job
from aggregate_detections import match_detections, predicted_markers
from detectors import contract
from effects import pipeline
from effects.library import moves_points
from expose_twin import rendered_poses, twin_image, views_of
from inputs.render_store import read_station
from inputs.tables import CORNERS, MARKERS, STATIONS, read_table, write_table
from inputs.twins import read_effect
from twin_study.variants import variants_of

# A row a twin, station and detector: the rig's markers, those in the picture, those of them found, detections that are false.
READINGS = pa.DataFrameSchema(
    {name: pa.Column(str, coerce=True) for name in ("camera", "station")}
    | {name: pa.Column(float, coerce=True) for name in ("height_m", "tilt_deg")}
    | {name: pa.Column(str, coerce=True) for name in ("kind", "name", "open", "detector")}
    | {name: pa.Column(int) for name in ("rig", "markers", "found", "false_ids")},
    strict=True,
)


def count(found, markers, place):
    """Return (markers, those in the picture, those of them found, false ids) of Detections; place as of ``predicted_markers``."""
    rows = [[d.dictionary, d.id, *d.corners.ravel()] for d in found]
    table = pd.DataFrame(rows, columns=["dictionary", "id", *CORNERS])
    row_of, false = match_detections(table, markers, [place])
    there = place["available"]
    return len(markers), int(there.sum()), int((there & (row_of >= 0)).sum()), int(false.sum())


def study_station(radiance, view, variants, finders, markers, seed, campaign):
    """Yield (Variant, detector's name, numbers of ``count``) of a station's linear radiance (H + 2m, W + 2m).

    finders {name: detector}; seed and campaign as of ``twin_image``
    """
    moved = {}  # most twins move points alike, which is a third of their cost
    for variant in variants:
        moving = [(name, p) for name, p in variant.effects if moves_points(name)]
        key = pipeline.key_of(moving)
        if key not in moved:
            moved[key] = pipeline.resample(np.ascontiguousarray(radiance)[..., None], view, moving)
        rest = [(name, p) for name, p in variant.effects if not moves_points(name)]
        image = np.ascontiguousarray(twin_image(moved[key], view, rest, seed, campaign))
        lens = functools.partial(pipeline.map_points, view=view, chosen=moving)
        place = predicted_markers(markers, view.K, view.width, view.height, view.T_cam_world, lens)
        for name, finder in finders.items():
            yield variant, name, count(finder.detect(image), markers, place)


def check_variants(variants, where):
    """Raise InputError for a choice whose values no effect takes; ``where`` names the study's file."""
    for variant in variants:
        for name, parameters in variant.effects:
            read_effect(f"{where}: {variant.name or variant.kind}", {"effect": name, "parameters": parameters})


def study_twin(expand, register_json, manifest, study, study_file, camera, effects, detectors, seed, out):
    """Write the readings of a camera.

    expand     folder of the camera's tables; manifest that of its renders
    study      dict as inputs.twin_study.TwinStudy; study_file names it in messages
    effects    [[name, parameters], ...] of the camera's twin, after the render
    detectors  {name: parameters}
    """
    record = json.loads(Path(manifest).read_text())
    campaign = json.loads((Path(expand) / "scene.json").read_text())["name"]
    markers = read_table(Path(expand) / "markers.csv", MARKERS)
    stations = read_table(Path(expand) / "stations.csv", STATIONS).set_index("station")
    chosen = stations[stations.height_m.isin(study["heights_m"])]
    variants = variants_of([(n, p) for n, p in effects], camera, study["choices"])
    check_variants(variants, study_file)
    families = sorted(set(markers.dictionary))
    finders = {n: contract.make(n, families, p, f"detectors.{n}") for n, p in detectors.items()}
    poses = {name: pose for name, pose in rendered_poses(record).items() if name in chosen.index}
    rows = []
    with tqdm(total=len(poses) * len(variants) * len(finders), desc=f"twins of {camera}", mininterval=5) as progress:
        for capture, view in views_of(Path(expand), register_json, camera, poses):
            radiance, margin = read_station(Path(manifest).parent, record["stations"][view.station])
            view = replace(view, margin=margin)
            place = [camera, capture, chosen.height_m[view.station], chosen.tilt_deg[view.station]]
            for variant, name, numbers in study_station(radiance, view, variants, finders, markers, seed, campaign):
                rows.append([*place, variant.kind, variant.name, variant.open, name, *numbers])
                progress.update()
    write_table(pd.DataFrame(rows, columns=list(READINGS.columns)), out, READINGS)


if __name__ == "__main__":
    job.run(
        study_twin,
        snakemake,
        expand=Path(snakemake.input.scene).parent,
        register_json=snakemake.input.register,
        manifest=snakemake.input.manifest,
        study=snakemake.params.study,
        study_file=snakemake.input.study,
        camera=snakemake.wildcards.camera,
        effects=snakemake.params.effects,
        detectors=snakemake.params.detectors,
        seed=snakemake.params.seed,
        out=snakemake.output[0],
    )
