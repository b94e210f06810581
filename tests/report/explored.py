"""A small run with a page to explore: two cameras whose focal length is not the nominal one, six plates, all stages but
Blender and the search, and a verdict that names what was hidden.
"""

import json

import cv2
import numpy as np
import pandas as pd
import yaml

from build_explorer import build_explorer
from case_files import load_case
from compare_twins import compare_twins
from detect_captures import detect_captures
from expand_tables import expand_tables
from explore_camera import explore_camera
from observe_captures import observe_captures
from register_captures import register_captures
from tiny_campaign import SEEN_FOCAL_PX, write_seen_campaign
from workflow_runs import PROJECT

CAMERAS, DETECTORS = ("left", "right"), ("aruco", "bart")
NOMINAL_PX = 180.0
STEPS = {"focal_length": {"ratio": SEEN_FOCAL_PX / NOMINAL_PX}, "exposure": {"scale": 1.0}}
GAPS = (7.25, 1.5, 1.0)
PLATE_GAPS_PX = {"configured": 2.0, "explained": 0.05}
DRAWN = 5
TABLES = ("markers", "cameras", "stations", "captures")


def write_results(folder):
    """Write campaign and results to ``folder`` and return the results' folder; its page is report/explore.html."""
    campaign = write_seen_campaign(folder / "campaign")
    description = yaml.safe_load((campaign / "campaign.yaml").read_text())
    for camera in description["cameras"].values():
        camera |= {"fx": NOMINAL_PX, "fy": NOMINAL_PX}
    (campaign / "campaign.yaml").write_text(yaml.safe_dump(description))
    results = folder / "results"
    expand_tables(campaign, None, None, results / "expand")
    (results / "tables").mkdir()
    (results / "tables/table1.csv").write_text("camera,algorithm\nleft,aruco\n")
    for camera in CAMERAS:
        write_camera_results(results, campaign, camera)
    build_page(results)
    return results


def write_camera_results(results, campaign, camera):
    """Write all that one camera's part of the page is made of, and that part."""
    paths = paths_of(results, camera)
    expand_tables(campaign, None, camera, paths["expand"])
    register_captures(paths["expand"], campaign, camera, paths["register"], paths["register_json"])
    observe_captures(paths["expand"], paths["register_json"], campaign, camera, paths["observations"])
    draw_twins(paths, camera)
    for detector, path in zip(DETECTORS, paths["detections"], strict=True):
        detect_captures(
            camera, detector, {}, [], campaign, paths["expand"] / "captures.csv", paths["expand"] / "markers.csv",
            paths["register_json"], paths["twin"], path, path.with_name(f"{detector}_timing.csv"),
        )  # fmt: skip
    write_verdict(paths, campaign, camera)
    compare_twins(
        paths["expand"], {name: results / f"expand/{name}.csv" for name in TABLES}, paths["register"], paths["register_json"],
        paths["verdict"], camera, paths["detections"], {d: {} for d in DETECTORS}, "s", results / f"{camera}.csv", paths["cells"],
    )  # fmt: skip
    explore(results, campaign, camera)


def explore(results, campaign, camera):
    """Write one camera's folder of the page."""
    p = paths_of(results, camera)
    explore_camera(
        p["expand"], p["register"], p["register_json"], campaign, camera, p["verdict"], p["ladder"], p["observations"],
        p["plates"], p["cells"], p["detections"], p["twin"], DRAWN, "s", results / f"report/explore/{camera}",
    )  # fmt: skip


def paths_of(results, camera):
    """Return {name: path} of one camera's files."""
    diagnosis = results / "diagnosis" / camera
    return {
        "expand": results / "expand" / camera, "register": results / f"register/{camera}.csv",
        "register_json": results / f"register/{camera}.json", "verdict": results / f"diagnosis/{camera}.json",
        "ladder": diagnosis / "ladder.csv", "observations": diagnosis / "observations.npz",
        "plates": diagnosis / "plates.parquet", "cells": results / f"compare/{camera}.parquet",
        "twin": results / "twin" / camera, "detections": [results / f"detect/{camera}/{d}.csv" for d in DETECTORS],
    }  # fmt: skip


def draw_twins(paths, camera):
    """Write the ideal twin's image of each capture at its station."""
    case, _ = load_case(paths["expand"], paths["register_json"], camera)
    paths["twin"].mkdir(parents=True)
    for capture in case.captures:
        radiance = case.radiance_of(capture, [], np.zeros(6))
        image = case.image_of(radiance, capture, [], np.zeros(6), np.random.default_rng(1))
        cv2.imwrite(str(paths["twin"] / f"{capture.view.capture}.png"), image[..., 0].astype(np.uint8))


def write_verdict(paths, campaign, camera):
    """Write a verdict, its ladder and its table of plates: known numbers, which the page has to show."""
    steps = [
        {"effect": name, "parameters": {k: {"value": v, "se": 0.001} for k, v in parameters.items()}}
        for name, parameters in STEPS.items()
    ]
    paths["verdict"].write_text(json.dumps({"verdict": "explained", "configured": [], "steps": steps}))
    ladder = [
        {"step": k, "effect": e, "gap": g, "gap_floor": 1.0}
        for k, (e, g) in enumerate(zip(["ideal", *STEPS], GAPS, strict=True))
    ]
    pd.DataFrame(ladder).to_csv(paths["ladder"], index=False)
    rows = []
    captures, markers = (pd.read_csv(paths["expand"] / f"{name}.csv") for name in ("captures", "markers"))
    for twin, gap in PLATE_GAPS_PX.items():
        for capture in captures.capture:
            for m in markers.itertuples():
                row = {
                    "twin": twin,
                    "capture": capture,
                    "plate": f"{m.dictionary}/{m.id}",
                    "distance_m": m.y,
                    "white": 3.0,
                }
                row |= {
                    "dx_px": gap,
                    **{f"corner_x{k}": gap for k in range(4)},
                    **{f"corner_y{k}": 0.0 for k in range(4)},
                }
                rows.append(row)
    pd.DataFrame(rows).to_parquet(paths["plates"])


def build_page(results, markers=None, scene=None):
    """Write the page of a run, of other tables where they are given; return its path."""
    page = results / "report/explore.html"
    build_explorer(
        markers or results / "expand/markers.csv", scene or results / "expand/scene.json", results / "tables/table1.csv",
        CAMERAS, DETECTORS, PROJECT / "scripts/reporting/explore", page,
    )  # fmt: skip
    return page


def told_in(script):
    """Return what a script of the page's folder hands over."""
    text = script.read_text(encoding="utf-8")
    return json.loads(text[text.index(",") + 1 : text.rindex(")")])
