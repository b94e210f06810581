"""Compare: what the detectors find in the ideal twin and in the twin with all effects that its verdict names.

Both twins stand at the stations, as in Tables 1 and 2, and are drawn as the fit draws them (gap.predict.synthesis, held to
Blender's renders by a test), so that they differ by the effects alone.
"""

import json
import logging
from pathlib import Path

import numpy as np
import pandas as pd
import pyarrow as pa

import job
from aggregate_detections import CELL_TYPES, FALSE_ID_TYPES, SCHEMAS, aggregate_camera, frame_of, write_parquet
from case_files import load_case
from detect_captures import detect_image, nominal_camera
from detectors import contract
from inputs.tables import DETECTIONS, REGISTERED, read_table
from make_tables import make_table2

log = logging.getLogger("twingap")

BEFORE, AFTER = "ideal", "explained"
TWIN_TYPE = {"twin_is": pa.string()}


def twins_of(verdict):
    """Return {name: effects} of a verdict's record: the twin without effects, and with those adopted and named."""
    effects = {e["effect"]: e["parameters"] for e in verdict.get("configured", [])}
    for step in verdict["steps"]:
        effects[step["effect"]] = {k: p["value"] for k, p in step["parameters"].items()}
    return {BEFORE: [], AFTER: list(effects.items())}


def draw_captures(case, effects, seed):
    """Yield (capture's name, uint8 image, grey or BGR) of a twin at its stations; seeded by names."""
    at_station = np.zeros(6)
    for capture in case.captures:
        rng = np.random.default_rng(job.seed_of(seed, case.campaign, case.camera, capture.view.capture, "compare"))
        image = case.image_of(case.radiance_of(capture, effects, at_station), capture, effects, at_station, rng)
        image = image.astype(np.uint8)
        yield capture.view.capture, image[..., 0] if image.shape[2] == 1 else np.ascontiguousarray(image[..., ::-1])


def detections_in(images, detector, code_of, K):
    """Return the DETECTIONS table of twin images [(capture, image)]."""
    rows = [["twin", name, *row] for name, image in images for row in detect_image(detector, image, code_of, K)[0]]
    return pd.DataFrame(rows, columns=list(DETECTIONS.columns))


def compare_twins(
    expand, tables, register, register_json, verdict, camera, detections, parameters, seed, out, out_cells
):
    """Write Table 2's row of every detector and twin (CSV), and the cells behind them (Parquet), of one camera.

    tables       dict of paths: markers, cameras, stations, captures
    detections   paths .../DETECTOR.csv, of which the real images' rows are taken
    parameters   {detector: dict of parameters}
    """
    case, _ = load_case(expand, register_json, camera)
    markers, cameras, stations, captures = (read_table(tables[name], schema) for name, schema in SCHEMAS.items())
    code_of = {(m.dictionary, m.id): m.code_m for m in markers.itertuples()}
    K, frame = nominal_camera(register_json), frame_of(camera, cameras, register_json)
    poses = read_table(register, REGISTERED)
    rows, cells = [], []
    for name, effects in twins_of(json.loads(Path(verdict).read_text())).items():
        images = list(draw_captures(case, effects, seed))
        for path in sorted(map(Path, detections)):
            detector = contract.make(path.stem, sorted(set(markers.dictionary)), parameters[path.stem])
            real = read_table(path, DETECTIONS)
            found = pd.concat([real[real.source == "real"], detections_in(images, detector, code_of, K)])
            mine, wrong = aggregate_camera(camera, path.stem, found, markers, captures, stations, frame, poses)
            wrong = wrong.reindex(columns=list(FALSE_ID_TYPES))
            rows.append(make_table2(mine, wrong, case.campaign).assign(twin_is=name))
            cells.append(mine.assign(twin_is=name))
        log.info("%s: %d images of the %s twin", camera, len(images), name)
    with job.write_atomically(out) as file:
        pd.concat(rows).to_csv(file, index=False, lineterminator="\n")
    write_parquet(pd.concat(cells), TWIN_TYPE | CELL_TYPES, out_cells)


if __name__ == "__main__":
    job.run(
        compare_twins,
        snakemake,
        expand=Path(snakemake.input.scene).parent,
        tables={name: snakemake.input[name] for name in ("markers", "cameras", "stations", "captures")},
        register=snakemake.input.register,
        register_json=snakemake.input.register_json,
        verdict=snakemake.input.verdict,
        camera=snakemake.wildcards.camera,
        detections=snakemake.input.detections,
        parameters=snakemake.params.parameters,
        seed=snakemake.params.seed,
        out=snakemake.output.table,
        out_cells=snakemake.output.cells,
    )
