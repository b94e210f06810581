"""Map: where the pose of a marker can be trusted: coverage, errors, flips, scatter beside what corners predict, in maps."""

import logging
from pathlib import Path

import cv2
import numpy as np
import pandas as pd

import job
from id_study.views import PRINT_M, study_marker
from inputs.tables import read_table
from poses_study.maps import MEASURES, draw_maps
from poses_study.measures import by_detector, by_pose, image_table, with_trust
from poses_study.views import (
    HEIGHT_PX,
    WIDTH_PX,
    digitised,
    expected_levels,
    pose_table,
    scene_of,
    study_noise,
    true_corners,
    view_of,
)
from reporting.pages import data_uri, render
from study_poses import SIGHTINGS

log = logging.getLogger("twingap")

TEMPLATE = Path(__file__).parent / "reporting/poses_template.html.j2"
SHOWN = 5  # poses of a kind, in pictures
BESIDE, SIDE_PX = 0.8, 150  # of a marker's extent, around it; of a picture


def images_of_family(sightings, poses):
    """Return {detector: measures.image_table} of the sightings of one family."""
    first = sightings.iloc[0]
    code_m = study_marker(first.dictionary, int(first.id)).code_m
    return {
        detector: with_trust(image_table(group, poses, code_m))
        for detector, group in sightings.groupby("detector", sort=True)
    }


def telling_poses(table):
    """Return [(words, rows of a pose table)] of one detector that are worth a look: missed although large, flipped, worst."""
    large = table.sort_values(["side_px", "pose"], ascending=[False, True])
    missed, flipped = large[large.found == 0], large[large.flipped > 0]
    worst = table[table.rotation_error_deg.notna()].sort_values(["rotation_error_deg", "pose"], ascending=[False, True])
    kinds = (("missed, the largest", missed), ("flipped, the largest", flipped), ("most turned, not flipped", worst))
    return [(words, rows.head(SHOWN)) for words, rows in kinds if len(rows)]


def picture(row, seed):
    """Return a picture of a row's marker, enlarged, as a PNG in a data URI."""
    corners = true_corners(row.dictionary, row.id, row)
    middle, half = corners.mean(axis=0), (0.5 + BESIDE) * np.ptp(corners, axis=0).max()
    low = np.maximum(np.floor(middle - half).astype(int), 0)
    high = np.minimum(np.ceil(middle + half).astype(int) + 1, [WIDTH_PX, HEIGHT_PX])
    levels = expected_levels(scene_of(row.dictionary, row.id), view_of(row))
    part = digitised(levels, study_noise(0, seed))[low[1] : high[1], low[0] : high[0]]
    scale = SIDE_PX / max(part.shape)
    larger = cv2.resize(
        part, None, fx=scale, fy=scale, interpolation=cv2.INTER_NEAREST if scale > 1 else cv2.INTER_AREA
    )
    return data_uri(cv2.imencode(".png", larger)[1].tobytes())


def page_of_family(family, tables, pictures, seed):
    """Return what the page shows of a family: maps, and a detector's telling poses with pictures."""
    parts = []
    for detector, table in tables.items():
        for words, rows in telling_poses(table):
            shown = [row._asdict() | {"picture": picture(row, seed)} for row in rows.itertuples(index=False)]
            parts.append({"detector": detector, "words": words, "rows": shown})
    maps = [{"title": MEASURES[name].title, "picture": data_uri(png), "name": name} for name, png in pictures.items()]
    return {"family": family, "maps": maps, "parts": parts}


def map_poses(sightings, families, draws, count, ranges, seed, out):
    """Write poses.csv, detectors.csv, maps/FAMILY/MEASURE.png and report.html of the study's sightings to a folder.

    sightings  paths of study_poses' tables
    draws      images of a pose
    count, ranges  of views.pose_table
    """
    out = Path(out)
    seen = pd.concat([read_table(path, SIGHTINGS) for path in sightings], ignore_index=True)
    places, pose_rows, detector_rows, sections = pose_table(count, **ranges, seed=seed), [], [], []
    for family in families:
        images_of = images_of_family(seen[seen.dictionary == family], places)
        tables = {detector: by_pose(images) for detector, images in images_of.items()}
        pose_rows += tables.values()
        detector_rows += [by_detector(images) for images in images_of.values()]
        pictures = {name: draw_maps(images_of, name, places, ranges["steepest_deg"]) for name in MEASURES}
        for name, png in pictures.items():
            with job.write_atomically(out / f"maps/{family}/{name}.png", "wb") as file:
                file.write(png)
        sections.append(page_of_family(family, tables, pictures, seed))
    detectors = pd.DataFrame(detector_rows)
    for name, table in (("poses", pd.concat(pose_rows)), ("detectors", detectors)):
        with job.write_atomically(out / f"{name}.csv") as file:
            table.to_csv(file, index=False, lineterminator="\n")
    page = render(
        TEMPLATE,
        title="Where can a marker's pose be trusted?",
        detectors=detectors.to_dict("records"),
        sections=sections,
        count=count,
        ranges=ranges,
        draws=draws,
        print_cm=100 * PRINT_M,
    )
    with job.write_atomically(out / "report.html") as file:
        file.write(page)
    log.info("%d poses: %s", len(places), out / "report.html")


if __name__ == "__main__":
    job.run(
        map_poses,
        snakemake,
        sightings=snakemake.input.sightings,
        families=snakemake.params.families,
        draws=snakemake.params.draws,
        count=snakemake.params.poses,
        ranges=snakemake.params.ranges,
        seed=snakemake.params.seed,
        out=Path(snakemake.output.page).parent,
    )
