"""Boards photographed by real cameras: a bent lens is named as such, a straight one is not blamed."""

import json

import pandas as pd

from diagnose_camera import diagnose_camera
from effects import library
from expand_tables import expand_tables
from observe_captures import observe_captures
from register_captures import register_captures
from shared_files import shared


def verdict_on(campaign, folder, candidates=None):
    """Return (verdict's record, ladder, table of points' gaps) of a campaign's only camera."""
    camera = pd.read_csv(campaign / "captures.csv").camera.unique().item()
    expand, intrinsics, observations = folder / "expand", folder / "r.json", folder / "observations.npz"
    expand_tables(campaign, None, camera, expand)
    register_captures(expand, campaign, camera, folder / "r.csv", intrinsics)
    observe_captures(expand, intrinsics, campaign, camera, observations)
    candidates = candidates or sorted(library.available_effects())
    out = folder / "out.json", folder / "ladder.csv", folder
    measured = expand, intrinsics, campaign, camera, observations
    diagnose_camera(*measured, None, [], [], candidates, 60_000, 1, [], [], folder / "kept", *out)
    return json.loads(out[0].read_text()), pd.read_csv(out[1]), pd.read_parquet(folder / "plates.parquet")


def test_the_lens_is_named_before_any_flexible_warp(tmp_path):
    """A warp of many waves fits any lens as well: let compete with them, it takes the lens's name."""
    verdict, ladder, points = verdict_on(shared("real/chess_opencv_left"), tmp_path)
    assert verdict["verdict"] == "explained"
    assert verdict["steps"][0]["effect"] == "radial_distortion"
    assert "local_warp" not in [step["effect"] for step in verdict["steps"]]
    assert ladder.corner_rmse_px.iloc[0] > 2.0
    assert ladder.corner_rmse_px.iloc[-1] < 0.25


def test_a_lens_without_distortion_is_not_blamed(tmp_path):
    """A search that takes whatever helps a little would name an effect here, where five coefficients change nothing."""
    verdict, _, _ = verdict_on(shared("real/chess_studio_control"), tmp_path)
    assert verdict["verdict"] == "adequate"
    assert verdict["steps"] == []


def test_what_promised_little_beside_a_strong_lens_is_asked_again(tmp_path):
    """Fails if an effect that a strong lens hides at first is asked no more while another, not worth its name, gains a little."""
    candidates = ["radial_distortion", "principal_point", "tangential_distortion", "board_bend", "pixel_aspect"]
    verdict, _, _ = verdict_on(shared("real/chess_gopro_wide"), tmp_path, candidates)
    assert [step["effect"] for step in verdict["steps"]] == ["radial_distortion", "principal_point"]
    assert verdict["gap"] < 1.2
