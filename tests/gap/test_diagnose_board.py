"""Boards photographed by real cameras: a bent lens is named as such, a straight one is not blamed."""

import json
from pathlib import Path

import pandas as pd
import pytest

from bench_turned_boards import steps_of
from describe_files import describe_files
from diagnose_camera import ONLY_POINTS, diagnose_camera, with_cells
from effects import library
from expand_tables import expand_tables
from observe_patches import observe_patches
from register_captures import register_captures
from shared_files import shared
from turned_board import off_in_errors, turned_round


def verdict_on(campaign, folder, candidates=None, cells=False):
    """Return (verdict's record, ladder, table of points' gaps) of a campaign's only camera, its ``cells`` looked at or not."""
    camera = pd.read_csv(campaign / "captures.csv").camera.unique().item()
    expand, intrinsics, observations = folder / "expand", folder / "r.json", folder / "observations.npz"
    expand_tables(campaign, None, camera, expand)
    register_captures(expand, campaign, camera, folder / "r.csv", intrinsics, observations)
    candidates = candidates or sorted(library.available_effects())
    out = folder / "out.json", folder / "ladder.csv", folder
    measured = expand, intrinsics, campaign, camera, observations
    of_cells = None, None
    if cells:
        of_cells = folder / "patches.npz", folder / "files.csv"
        observe_patches(*measured, of_cells[0])
        describe_files(expand / "captures.csv", campaign, camera, of_cells[1])
    diagnose_camera(*measured, *of_cells, [], [], candidates, 60_000, 1, [], [], folder / "kept", *out)
    return json.loads(out[0].read_text()), pd.read_csv(out[1]), pd.read_parquet(folder / "plates.parquet")


def test_what_too_few_cells_do_not_show_is_said_so():
    """Fails if effects that cells would show keep the reason why points do not, or a move of points gets theirs."""

    def look():
        raise ValueError("too few photographs show the board's cells")

    of_points = dict.fromkeys(("vignetting", "rail_sag"), ONLY_POINTS)
    result, rows = {"not_looked_at": of_points | {"focal_length": "in the twin already"}}, [{"step": 0}]
    told, same = with_cells(result, rows, None, None, of_points, look)
    assert told["not_looked_at"] == {
        "vignetting": "too few photographs show the board's cells",
        "rail_sag": ONLY_POINTS,
        "focal_length": "in the twin already",
    }
    assert same is rows


def test_the_lens_is_named_before_any_flexible_warp(tmp_path):
    """A warp of many waves fits any lens as well: let compete with them, it takes the lens's name."""
    verdict, ladder, points = verdict_on(shared("real/chess_opencv_left"), tmp_path)
    assert verdict["verdict"] == "explained"
    assert verdict["steps"][0]["effect"] == "radial_distortion"
    assert "local_warp" not in [step["effect"] for step in verdict["steps"]]
    assert ladder.corner_rmse_px.iloc[0] > 2.0
    assert ladder.corner_rmse_px.iloc[-1] < 0.25


def test_photographs_turned_round_tell_of_the_same_lens(tmp_path):
    """Fails if an axis, the image's middle or a sign depends on which way up photographs are; or if one candidate's fit, which
    runs off for these, ends it all with "Singular matrix".
    """
    campaign = shared("real/chess_opencv_left")
    turned = turned_round(campaign, tmp_path / "turned")
    before, after = (steps_of(c, tmp_path / n) for c, n in ((campaign, "before"), (turned, "after")))
    names = ["radial_distortion", "principal_point", "tangential_distortion"]
    assert [s["effect"] for s in before] == [s["effect"] for s in after] == names
    assert off_in_errors(before, after) < 0.2 < off_in_errors(before, before)


def test_a_lens_without_distortion_is_not_blamed(tmp_path):
    """A search that takes whatever helps a little would name an effect here, where five coefficients change nothing."""
    verdict, _, _ = verdict_on(shared("real/chess_studio_control"), tmp_path)
    assert verdict["verdict"] == "adequate"
    assert verdict["steps"] == []


def test_what_had_a_small_predicted_gain_beside_a_strong_lens_is_asked_again(tmp_path):
    """Fails if an effect that a strong lens hides at first is asked no more while another, not worth its name, gains a little."""
    candidates = ["radial_distortion", "principal_point", "tangential_distortion", "board_bend", "pixel_aspect"]
    verdict, _, _ = verdict_on(shared("real/chess_gopro_wide"), tmp_path, candidates)
    assert [step["effect"] for step in verdict["steps"]] == ["radial_distortion", "principal_point"]
    assert verdict["gap"] < 1.2


def test_cells_tell_what_points_cannot(tmp_path):
    """Fails if the cells of the embedded photographs name nothing, or a lens, or if steps, ladder and gap disagree."""
    candidates = [
        "radial_distortion",
        "sensor_noise",
        "denoising",
        "sharpening",
        "exposure",
        "ink_spread",
        "ink_reflectance",
    ]
    raw = Path(__file__).resolve().parents[2] / "data/raw/aruco6x6_gridboard"
    verdict, ladder, _ = verdict_on(raw, tmp_path, candidates, cells=True)
    names = [step["effect"] for step in verdict["steps"]]
    assert sorted(names) == [
        "denoising",
        "sensor_noise",
    ]  # in either order: their predicted gains are nearly alike
    assert set(verdict["not_looked_at"]) == {"exposure", "ink_reflectance"}
    assert verdict["points"]["verdict"] == "adequate" and verdict["points"]["gap"] == verdict["groups"]["corners"]
    first, second = verdict["steps"]
    assert (first["gap_before"], second["gap_after"]) == (verdict["gap_as_configured"], verdict["gap"])
    assert ladder.effect.tolist() == ["ideal", *names] and ladder.gap.is_monotonic_decreasing
    assert ladder.gap.tolist() == pytest.approx([verdict["gap_as_configured"], first["gap_after"], verdict["gap"]])
    assert (ladder.gap_low < ladder.gap).all() and (ladder.gap < ladder.gap_high).all()


def test_what_no_run_asks_for_is_kept_no_longer(tmp_path):
    """Fails if outcomes of code or photographs of long ago stay on the disk, or none of this run is kept."""
    (tmp_path / "kept").mkdir()
    (tmp_path / "kept/of_other_code.pickle").write_bytes(b"")
    verdict_on(
        shared("real/chess_opencv_left"), tmp_path, ["radial_distortion", "principal_point", "tangential_distortion"]
    )
    kept = {path.name for path in (tmp_path / "kept").glob("*.pickle")}
    assert kept and "of_other_code.pickle" not in kept


def test_a_stretch_that_all_photographs_share_is_no_shutter(tmp_path):
    """Fails if a shutter of four parameters, which reaches the floor by itself, takes the name of rows of another length beside a
    lens, or what only a rolled camera would tell is told.
    """
    verdict, _, _ = verdict_on(shared("real/chess_picam_640"), tmp_path)
    first = verdict["steps"][0]
    assert first["effect"] != "rolling_shutter" and {"pixel_aspect", "print_stretch"} < set(first["one_of"])
    assert "to tell pixel aspect from print stretch: roll the camera" in " ".join(n["text"] for n in verdict["needs"])
