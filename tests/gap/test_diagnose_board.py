"""Boards photographed by real cameras: a bent lens is named as such, a straight one is not blamed."""

import json

import pandas as pd

from diagnose_board import diagnose_board
from expand_tables import expand_tables
from shared_files import shared


def verdict_on(campaign, folder):
    """Return (verdict's record, ladder) of a campaign's only camera."""
    camera = pd.read_csv(campaign / "captures.csv").camera.unique().item()
    expand_tables(campaign, None, camera, folder / "expand")
    diagnose_board(folder / "expand", campaign, camera, folder / "out.json", folder / "ladder.csv")
    return json.loads((folder / "out.json").read_text()), pd.read_csv(folder / "ladder.csv")


def test_the_lens_is_named_before_any_flexible_warp(tmp_path):
    """A warp of many waves fits any lens as well: let compete with them, it takes the lens's name."""
    verdict, ladder = verdict_on(shared("real/chess_opencv_left"), tmp_path)
    assert verdict["verdict"] == "explained"
    assert verdict["steps"][0]["effect"] == "radial_distortion"
    assert "local_warp" not in [step["effect"] for step in verdict["steps"]]
    assert ladder.corner_rmse_px.iloc[0] > 2.0
    assert ladder.corner_rmse_px.iloc[-1] < 0.25


def test_a_lens_without_distortion_is_not_blamed(tmp_path):
    """A search that takes whatever helps a little would name an effect here, where five coefficients change nothing."""
    verdict, _ = verdict_on(shared("real/chess_studio_control"), tmp_path)
    assert verdict["verdict"] == "adequate"
    assert verdict["steps"] == []
