"""Explore: the page on which a reader compares captures with their twins, effect by effect, marker by marker.

Needs: the verdicts, registered poses, captures, twin images; with markers also what was measured, detected and compared.
Makes: report/explore.html and the folder report/explore/ (a folder a camera with images and numbers; scripts, style).
"""

PAGE_FILES = "scripts/reporting/explore"
EXPLORE_FILES = (
    "loader.js viewer.js loupe.js map.js list.js explore.js explore.css"
    " openseadragon/openseadragon.min.js openseadragon/LICENSE.txt"
).split()
OF_MARKERS = {
    "observations": f"{RESULTS}/diagnosis/{{camera}}/observations.npz",
    "plates": f"{RESULTS}/diagnosis/{{camera}}/plates.parquet",
    "cells": f"{RESULTS}/compare/{{camera}}.parquet",
    "detections": expand(
        f"{RESULTS}/detect/{{{{camera}}}}/{{detector}}.csv", detector=DETECTORS
    ),
}


rule explore_camera:
    input:
        **(OF_MARKERS if HAS_MARKERS and not BOARD else {}),
        scene=f"{RESULTS}/expand/{{camera}}/scene.json",
        register=f"{RESULTS}/register/{{camera}}.csv",
        register_json=f"{RESULTS}/register/{{camera}}.json",
        verdict=OWN_VERDICT,
        ladder=f"{RESULTS}/diagnosis/{{camera}}/ladder.csv",
        twin=f"{RESULTS}/twin/{{camera}}",
        images=captures_of,
        code=imports_of("explore_camera.py"),
        finder_code=finder_code,
    output:
        directory(f"{RESULTS}/report/explore/{{camera}}"),
    log:
        f"{RESULTS}/logs/explore_camera/{{camera}}.log",
    benchmark:
        f"{RESULTS}/benchmarks/explore_camera/{{camera}}.tsv"
    conda:
        "../envs/twingap.yaml"
    resources:
        mem_mb=mem_mb_of("explore_camera"),
        runtime=runtime_of("explore_camera"),
    params:
        campaign=campaign_folder,
        most=config["explore"]["captures"],
        seed=config["seed"],
        pins=locked("numpy", "numba", "opencv-contrib-python-headless", "pandas"),
    message:
        "Drawing captures of {wildcards.camera} beside the ladder's twins"
    script:
        "../scripts/explore_camera.py"


rule build_explorer:
    input:
        cameras=expand(f"{RESULTS}/report/explore/{{camera}}", camera=CAMERAS),
        markers=f"{RESULTS}/expand/markers.csv",
        scene=f"{RESULTS}/expand/scene.json",
        table1=f"{RESULTS}/tables/table1.csv",
        template=f"{PAGE_FILES}/explore.html.j2",
        files=expand(f"{PAGE_FILES}/{{file}}", file=EXPLORE_FILES),
        code=imports_of("build_explorer.py"),
    output:
        expand(f"{RESULTS}/report/explore/{{file}}", file=["index.js", *EXPLORE_FILES]),
        page=f"{RESULTS}/report/explore.html",
    log:
        f"{RESULTS}/logs/build_explorer.log",
    benchmark:
        f"{RESULTS}/benchmarks/build_explorer.tsv"
    conda:
        "../envs/twingap.yaml"
    resources:
        mem_mb=mem_mb_of("build_explorer"),
        runtime=runtime_of("build_explorer"),
    params:
        cameras=CAMERAS,
        detectors=DETECTORS,
        pins=locked("jinja2", "pandas"),
    message:
        "Writing the page to explore"
    script:
        "../scripts/build_explorer.py"
