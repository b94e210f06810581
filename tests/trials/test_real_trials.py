"""Real photographs taken again: what is laid on moves points by as much as it says, and nothing else does."""

import numpy as np
import pytest

from generator import LIBRARY, nominal
from generator.photographs import LAID_ON, MAX_SHIFT_PX, MOVES_POINTS, Retaken, decode, why_not_laid
from generator.sensor import encode
from shared_files import shared
from trials.real_trials import NULLS, _copy_calibrations, drawn_effect, laid_effect, what_is_laid_on

CAMERA = nominal.Camera("c", 160, 120, 160.0)
SPOT = np.array([120.0, 40.0])


def spot():
    """Return a photograph (H, W, 3) of one bright spot on grey."""
    y, x = np.mgrid[: CAMERA.height, : CAMERA.width]
    linear = 0.2 + 0.6 * np.exp(-((x - SPOT[0]) ** 2 + (y - SPOT[1]) ** 2) / (2 * 3.0**2))
    return np.repeat(np.rint(encode(linear)).astype(np.uint8)[..., None], 3, axis=2)


def place(image):
    """Return where the spot is (x, y), and how much light it has."""
    light = np.clip(decode(image[..., 1]) - 0.21, 0, None)
    y, x = np.mgrid[: CAMERA.height, : CAMERA.width]
    return np.array([(x * light).sum(), (y * light).sum()]) / light.sum(), light.sum()


def retaken(effects, name="a", seed="s"):
    """Return the spot's photograph taken again."""
    return Retaken(CAMERA, effects, seed).photograph(spot(), name)


def test_a_null_is_moved_within_a_codecs_block_and_by_a_fraction():
    """Fails if a photograph with nothing laid on stays on its pixels or its codec's blocks, moves farther, or loses light."""
    before, light = place(spot())
    moves = [place(retaken({}, name))[0] - before for name in "abcdef"]
    assert 2.0 < np.abs(moves).max() <= MAX_SHIFT_PX + 0.05
    assert np.ptp(np.array(moves) % 1, axis=0).min() > 0.3
    assert len({tuple(m.round(3)) for m in moves}) == 6
    assert abs(place(retaken({}))[1] / light - 1) < 0.03
    assert np.array_equal(retaken({}), retaken({}))


@pytest.mark.parametrize(
    ("effects", "moved"),
    [
        ({"focal_length": {"ratio": 1.05}}, 0.05 * (SPOT - [79.5, 59.5])),
        ({"principal_point": {"dx_px": 4.0, "dy_px": -3.0}}, [4.0, -3.0]),
        ({"rolling_shutter": {"model": "shear", "skew_px_per_row": 0.1}}, [-1.95, 0.0]),
    ],
)
def test_what_is_laid_on_moves_points_as_it_says(effects, moved):
    """Fails if an effect is laid on with the wrong size or sign: the same name and seed have the same shift without it."""
    off = place(retaken(effects))[0] - place(retaken({}))[0]
    assert np.abs(off - moved).max() < 0.12


def test_a_third_are_nulls_and_effects_come_equally_often():
    """Fails if nulls are fewer than a third, or an effect is never laid on."""
    laid = [laid_effect(k, "seed") for k in range(NULLS * len(LAID_ON))]
    assert laid.count(None) == len(LAID_ON)
    assert sorted(n for n in laid if n) == sorted(2 * LAID_ON)
    grey = {laid_effect(k, "seed", in_colour=False) for k in range(NULLS * len(LAID_ON))}
    assert grey == {None, *LAID_ON} - {"lateral_chromatic_aberration", "bayer_demosaic", "colour_balance"}


def test_a_shutter_is_drawn_as_a_shear():
    """Fails if a camera that moves before a scene of unknown depth is laid on."""
    assert {drawn_effect("rolling_shutter", 1.0, CAMERA, f"s{k}")["model"] for k in range(20)} == {"shear"}


@pytest.mark.parametrize("name", LAID_ON)
def test_all_that_is_dealt_can_be_drawn(name):
    """Fails if an effect with several models has none that can be laid on."""
    assert drawn_effect(name, 1.0, CAMERA, "s")


def test_what_cannot_be_laid_on_is_refused_in_words():
    """Fails if an effect of the scene, or of colour on a grey photograph, is pretended."""
    assert "needs the scene" in why_not_laid("rail_sag", True)
    assert "photographs in colour" in why_not_laid("colour_balance", False)
    assert why_not_laid("colour_balance", True) is None
    assert "no effect" in why_not_laid("nonsense", True)
    assert all(why_not_laid(n, True) is None for n in MOVES_POINTS)
    assert sum(why_not_laid(n, True) is None for n in LIBRARY) == 21


def test_what_can_be_laid_on_each_set_is_listed():
    """Fails if colours are laid on grey photographs, or a set that is too small is left out without a word."""
    listed = what_is_laid_on(shared("real")).set_index("campaign").laid_on
    assert listed["chess_studio_control"] == f"all {len(LAID_ON)}"
    assert listed["chess_opencv_left"].startswith(f"{len(LAID_ON) - 3}, grey: not ")
    assert listed["charuco_screen_wide"] == "none: 9 photographs, and 12 are needed"


def test_a_sets_own_calibration_goes_with_its_trial(tmp_path):
    """Fails if a trial of a campaign that names a calibration's file, or has photographs for one, cannot be read."""
    for name in ("lab/cal.yaml", "calibration/c/1.png", "campaign.yaml"):
        (tmp_path / "set" / name).parent.mkdir(parents=True, exist_ok=True)
        (tmp_path / "set" / name).write_text("cameras: {c: {intrinsics: 'lab/cal.yaml#left'}, d: {fx: null}}")
    _copy_calibrations(tmp_path / "set", tmp_path / "trial")
    assert sorted(p.name for p in (tmp_path / "trial").rglob("*") if p.is_file()) == ["1.png", "cal.yaml"]
