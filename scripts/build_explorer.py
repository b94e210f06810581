"""The page to explore: explore.html, its scripts and style, and the index of what its folder holds of every camera."""

import json
import shutil
from pathlib import Path

import pandas as pd

import job
from inputs import tables
from inputs.campaign import CalibrationBoard
from inputs.scene import target_plate
from reporting.explore_tables import as_js, rounded
from reporting.pages import render
from rig.geometry import make_pose, transform
from rig.plates import marker_corners_plate

SCRIPTS = ("loader.js", "viewer.js", "loupe.js", "map.js", "list.js", "explore.js")  # in the order in which they run
COPIED = (*SCRIPTS, "explore.css", "openseadragon/openseadragon.min.js", "openseadragon/LICENSE.txt")


def outline_of(marker):
    """Return the outline (4, 2) on the ground of a marker's plate, a row of the markers' table, as lists."""
    T = make_pose([marker.rx, marker.ry, marker.rz], [marker.x, marker.y, marker.z])
    return rounded(transform(T, marker_corners_plate(marker.plate_m))[:, :2], 4)


def board_outline(scene):
    """Return the outline (4, 2) of a campaign's board as lists, None where it has none."""
    if not scene.get("target"):
        return None
    return rounded(target_plate(CalibrationBoard.model_validate(scene["target"])).outline_world()[:, :2], 4)


def build_explorer(markers, scene_file, table1, cameras, detectors, page_files, page):
    """Write ``explore.html`` and, in the folder ``explore`` beside it, its scripts, style and index.

    markers, scene_file, table1  tables of the run; ``page_files`` is the folder of explore.html.j2 and what it needs
    cameras, detectors  names; each camera's folder lies in ``explore`` already
    """
    rig = tables.read_table(markers, tables.MARKERS)
    scene = json.loads(Path(scene_file).read_text())
    counted = pd.read_csv(table1, dtype={"algorithm": str}).algorithm
    index = {
        "campaign": scene.get("name", ""), "cameras": list(cameras), "detectors": list(detectors) if len(rig) else [],
        "reference": next(iter(counted), None), "markers": (rig.dictionary + "/" + rig.id.astype(str)).tolist(),
        "plates": [outline_of(m) for m in rig.itertuples()], "board": board_outline(scene),
    }  # fmt: skip
    page, page_files = Path(page), Path(page_files)
    folder = page.parent / page.stem
    for name in COPIED:
        (folder / name).parent.mkdir(parents=True, exist_ok=True)
        shutil.copyfile(page_files / name, folder / name)
    with job.write_atomically(folder / "index.js") as file:
        file.write(as_js("index", index))
    title = f"{index['campaign']}: captures and their twins"
    html = render(
        page_files / "explore.html.j2", title=title, simulated=scene.get("origin") == "simulated", scripts=SCRIPTS
    )
    with job.write_atomically(page) as file:
        file.write(html)


if __name__ == "__main__":
    job.run(
        build_explorer,
        snakemake,
        markers=snakemake.input.markers,
        scene_file=snakemake.input.scene,
        table1=snakemake.input.table1,
        cameras=snakemake.params.cameras,
        detectors=snakemake.params.detectors,
        page_files=Path(snakemake.input.template).parent,
        page=snakemake.output.page,
    )
