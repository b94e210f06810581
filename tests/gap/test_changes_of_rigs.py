"""What has changed between two campaigns of a rig, by their files as the workflow has them: light that falls off, or nothing.

Captures by the generator of tests/bench, which shares no image formation with the effects under test.
"""

import json
import sys
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[2]
sys.path[:0] = [str(ROOT / "scripts"), str(ROOT / "tests/bench")]

from find_changes import find_changes  # noqa: E402
from generator import draw_effect, generate_campaign, nominal  # noqa: E402
from trials.observe_trial import observe_trial  # noqa: E402

CAMERA = nominal.RIGS["tiny"].cameras[0]
STATIONS = [(0.35, 20), (0.45, 30), (0.5, 45)]  # each twice: six captures, of which permutations can tell
CANDIDATES = ["vignetting", "exposure", "focal_length"]
FALL_OFF = draw_effect("vignetting", 1.0, CAMERA, "rigs")


@pytest.fixture(scope="module")
def earlier(tmp_path_factory):
    """Return (folder, paths of what is measured) of the campaign that others are compared with."""
    return campaign_of(tmp_path_factory.mktemp("earlier"), "earlier", [])


def campaign_of(folder, name, effects):
    """Return (folder, paths as find_changes has them) of a campaign by the generator, poses and noise drawn by its name."""
    generate_campaign(folder / "c", folder / "truth", effects, name, "tiny", stations=STATIONS)
    observe_trial(folder / "c", folder / "seen")
    measured, verdict = folder / "seen" / CAMERA.name, folder / "verdict.json"
    alone = {"campaign": name, "camera": CAMERA.name, "verdict": "adequate", "steps": []}
    verdict.write_text(json.dumps(alone))
    made = [measured / part for part in ("expand/scene.json", "register.json", "observations.npz")]
    return folder / "c", [*made, verdict]


def record_of(folder, earlier, later):
    """Return what the result file says of two campaigns, the earlier first; its pictures are there."""
    pictures, out = [folder / f"change_{when}.png" for when in ("before", "after")], folder / "out.json"
    campaigns = [str(campaign) for campaign, _ in (earlier, later)]
    find_changes(earlier[1], later[1], campaigns, CAMERA.name, CANDIDATES, 1, out, pictures)
    assert all(picture.stat().st_size for picture in pictures)
    return json.loads(out.read_text())


def test_a_rig_whose_camera_is_the_same_has_not_changed(earlier, tmp_path):
    """Fails if other poses under the tolerance, or other noise, pass for another camera."""
    record = record_of(tmp_path, earlier, campaign_of(tmp_path, "as before", []))
    assert (record["verdict"], record["steps"]) == ("adequate", [])
    assert record["captures"] == [6, 6] and record["gap"] < 1.2
    assert set(record["least_seen"]) == set(CANDIDATES) and 0 < record["least_seen"]["vignetting"]["a2"] < 0.3


def test_what_a_rig_shows_besides_points_is_named_alone_with_both_values(earlier, tmp_path):
    """Fails if a rig's plates are asked for their points only, as a board's are, if an exposure stands for how light falls off,
    or if the first campaign gets what the later one has.
    """
    record = record_of(tmp_path, earlier, campaign_of(tmp_path, "darker", [("vignetting", FALL_OFF)]))
    assert [step["effect"] for step in record["steps"]] == ["vignetting"] and record["verdict"] == "explained"
    values = record["steps"][0]["parameters"]
    before, after = (sum(p[when] for p in values.values()) for when in ("from", "to"))  # of light lost in the corners
    assert before == pytest.approx(0.0, abs=0.02) and after == pytest.approx(FALL_OFF["corner_falloff"], abs=0.02)
    assert record["gap_as_configured"] > 3 and record["gap"] < 1.2
