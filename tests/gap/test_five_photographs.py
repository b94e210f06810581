"""Five photographs of a board, too few for a verdict, are enough to be compared with five others."""

import json
import shutil

import pandas as pd
import pytest
import yaml

from diagnose_camera import diagnose_camera
from expand_tables import expand_tables
from find_changes import find_changes
from gap.changes.changes import MIN_CAPTURES
from register.board_checks import MIN_PHOTOGRAPHS
from register_captures import OF_BASELINE, least_usable, register_captures
from reporting.sentences import verdict_words
from rig.errors import InputError
from seen_boards import embedded
from workflow_runs import PROJECT

CAMERA = "aruco6x6_gridboard"
WHY = "5 of 5 photographs show the board, and a verdict takes 6: take 1 more"


def campaign_of(folder, name, rows):
    """Lay some of the embedded photographs down as a campaign."""
    shutil.copytree(embedded(), folder / name)
    pd.read_csv(folder / name / "captures.csv", dtype=str).iloc[rows].to_csv(
        folder / name / "captures.csv", index=False
    )
    facts = yaml.safe_load((folder / name / "campaign.yaml").read_text()) | {"name": name}
    (folder / name / "campaign.yaml").write_text(yaml.safe_dump(facts))
    return folder / name


def measured(folder, campaign):
    """Return the paths that find_changes reads of a campaign: expand, register, observe and diagnose, as the workflow does."""
    folder /= f"results_{campaign.name}"
    scene, register, seen, verdict = (
        folder / p for p in ("expand/scene.json", "register.json", "observations.npz", "alone.json")
    )
    expand_tables(campaign, None, CAMERA, scene.parent)
    register_captures(scene.parent, campaign, CAMERA, register.with_suffix(".csv"), register, seen, least=MIN_CAPTURES)
    diagnose_camera(
        scene.parent, register, campaign, CAMERA, seen, None, None, [], [], ["focal_length"], 100, 1, [], [],
        folder / "kept", verdict, folder / "ladder.csv", folder / "gaps",
    )  # fmt: skip
    return scene, register, seen, verdict


@pytest.fixture(scope="module")
def compared(tmp_path_factory):
    """Return (verdict on the later campaign alone, what has changed) of five photographs each, no effect laid on."""
    folder = tmp_path_factory.mktemp("five")
    campaigns = [campaign_of(folder, name, slice(k, 20, 4)) for k, name in enumerate(("then", "now"))]
    files = [measured(folder, c) for c in campaigns]
    pictures = [folder / f"{when}.png" for when in ("before", "after")]
    find_changes(*files, campaigns, CAMERA, ["focal_length"], 1, folder / "changes.json", pictures)
    return json.loads(files[1][3].read_text()), json.loads((folder / "changes.json").read_text())


def test_five_are_compared_with_five(compared):
    """Fails if what is enough for a comparison is refused because it is too little for a verdict."""
    _, changes = compared
    assert changes["captures"] == [5, 5] and changes["baseline"] == "then" and changes["verdict"] == "adequate"


def test_five_alone_have_no_verdict_and_are_told_why(compared):
    """Fails if five get a verdict of their own, or the reader of a comparison does not learn that there is none."""
    alone, changes = compared
    assert alone["why"].startswith(WHY) and alone["steps"] == []
    assert f"by themselves nothing could be diagnosed: {WHY}" in verdict_words(changes)


def test_a_verdict_takes_six_wherever_nothing_is_compared():
    """Fails if five photographs alone are registered, of which the run could only say that they are too few, or if either of two
    campaigns that are compared needs six.
    """
    assert least_usable("register_captures", None) == MIN_PHOTOGRAPHS == 6
    assert least_usable("register_captures", "june") == least_usable("before_register_captures", None) == 5
    assert f" as {OF_BASELINE}*\n" in (PROJECT / "rules/baseline.smk").read_text()


def test_four_are_too_few_for_either(tmp_path):
    """Fails if four photographs are compared, or the line tells of a verdict that nobody asked for."""
    campaign = campaign_of(tmp_path, "few", slice(0, 4))
    with pytest.raises(InputError, match="4 photographs, and a comparison takes 5: take 1 more"):
        measured(tmp_path, campaign)
