"""Tables before and after: the twin with the right effect has to lie nearer to the captures than the ideal one."""

import json

import pandas as pd

from compare_twins import compare_twins, twins_of
from detect_captures import detect_captures
from expand_tables import expand_tables
from register_captures import register_captures
from trials.generate_trials import generate_trial


def test_explained_twin_has_what_was_adopted_and_what_is_named():
    """A twin that lost the adopted effects, or kept an old parameter of one that was refitted, is not the verdict's."""
    verdict = {
        "configured": [{"effect": "lens_blur", "parameters": {"sigma_px": 1.0}}],
        "steps": [
            {"effect": "exposure", "parameters": {"scale": {"value": 0.9, "se": 0.1}}},
            {"effect": "lens_blur", "parameters": {"sigma_px": {"value": 1.2, "se": 0.1}}},
        ],
    }
    twins = twins_of(verdict)
    assert list(twins) == ["ideal", "explained"]
    assert twins["ideal"] == []
    assert dict(twins["explained"]) == {"lens_blur": {"sigma_px": 1.2}, "exposure": {"scale": 0.9}}


def test_undiagnosed_camera_keeps_its_ideal_twin():
    """A verdict without a configured twin (nothing could be measured) must not end the run."""
    assert twins_of({"steps": []}) == {"ideal": [], "explained": []}


def test_distances_agree_after_a_hidden_focal_length_was_named(tmp_path):
    """Twins that are swapped, or drawn without their effects, would not move the distances from off to right."""
    name, truth = generate_trial(tmp_path / "c", tmp_path / "e", "single", 0, "compare", "focal_length", size="small")
    campaign, expand = tmp_path / "c" / name, tmp_path / "expand"
    expand_tables(campaign, None, None, expand)
    camera = next((campaign / "images").iterdir()).name
    register, register_json = tmp_path / f"{camera}.csv", tmp_path / f"{camera}.json"
    register_captures(expand, campaign, camera, register, register_json)
    tables = {n: expand / f"{n}.csv" for n in ("markers", "cameras", "stations", "captures")}
    found = tmp_path / "bart.csv"
    detect_captures(
        camera, "bart", {}, [], campaign, tables["captures"], tables["markers"], register_json, tmp_path / "no twin",
        found, tmp_path / "timing.csv",
    )  # fmt: skip
    ratio = truth["effects"][0]["library_parameters"]["ratio"]
    verdict = tmp_path / "verdict.json"
    verdict.write_text(
        json.dumps({"steps": [{"effect": "focal_length", "parameters": {"ratio": {"value": ratio, "se": 0.0}}}]})
    )

    compare_twins(
        expand, tables, register, register_json, verdict, camera, [found], {"bart": {}}, "seed",
        tmp_path / "rows.csv", tmp_path / "cells.parquet",
    )  # fmt: skip

    off = pd.read_csv(tmp_path / "rows.csv").set_index("twin_is").delta_distance_signed_pct.abs()
    assert off["ideal"] > 1.0
    assert off["explained"] < 0.3
    cells = pd.read_parquet(tmp_path / "cells.parquet")
    assert set(cells.twin_is) == {"ideal", "explained"}
