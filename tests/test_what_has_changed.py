"""One run says what has changed since an earlier campaign, and makes that campaign's results where they are missing."""

import json

import cv2
import numpy as np
import pandas as pd
import pytest
import yaml

from generator.photographs import decode
from generator.sensor import encode
from seen_boards import EMBEDDED, embedded
from workflow_runs import copy_project, snakemake

CAMERA = EMBEDDED.name
BLUR_PX = 1.5
DIAGNOSE = "diagnose={candidates: [lens_blur, focal_length, vignetting]}"


def blurred(image, blur_px):
    """Return an image (H, W, 3) of 8 bits whose linear light is blurred (encoding: IEC 61966-2-1)."""
    return np.rint(encode(cv2.GaussianBlur(decode(image), (0, 0), blur_px))).astype(np.uint8)


def campaign_of(folder, rows, blur_px):
    """Make a campaign of some of the embedded photographs, as they are or behind a lens that has become dirty."""
    folder.mkdir(parents=True)
    captures = pd.read_csv(embedded() / "captures.csv", dtype=str).iloc[rows]
    for row in captures.itertuples():
        image = cv2.imread(str(EMBEDDED / row.image))
        cv2.imwrite(str(folder / f"{row.capture}.png"), blurred(image, blur_px) if blur_px else image)
    captures.assign(image=captures.capture + ".png").to_csv(folder / "captures.csv", index=False)
    facts = yaml.safe_load((EMBEDDED / "campaign.yaml").read_text()) | {"name": folder.name}
    (folder / "campaign.yaml").write_text(yaml.safe_dump(facts))
    return folder


@pytest.fixture(scope="module")
def results(tmp_path_factory):
    """Return the results' folder after a run on blurred photographs with sharp ones, never looked at, as the baseline."""
    folder = tmp_path_factory.mktemp("changed")
    project = copy_project(folder / "project")
    june = campaign_of(folder / "june", slice(0, None, 2), 0)
    july = campaign_of(folder / "july", slice(1, None, 2), BLUR_PX)
    status, said = snakemake(
        project, "--cores", 2, "diagnose", "--config", f"campaign={july}", f"baseline={june}", DIAGNOSE
    )
    assert status == 0, said[-4000:]
    return project / "results"


def test_what_has_changed_is_named(results):
    """Fails if the verdict isn't that of the comparison, or it doesn't say from how much to how much a lens blurs."""
    verdict = json.loads((results / f"july/diagnosis/{CAMERA}.json").read_text())
    assert (verdict["verdict"], verdict["baseline"]) == ("explained", "june")
    (step,) = verdict["steps"]
    assert step["effect"] == "lens_blur"
    sigma = step["parameters"]["sigma_px"]
    assert sigma["from"] < sigma["to"] and sigma["to"] - sigma["from"] == pytest.approx(BLUR_PX, abs=0.5)
    assert sigma["se"] > 0


def test_the_earlier_results_are_made_in_the_same_run(results):
    """Fails if the earlier campaign must be diagnosed first, by another command."""
    assert json.loads((results / f"june/diagnosis/{CAMERA}.json").read_text())["campaign"] == "june"


def test_both_are_seen(results):
    """Fails if a change comes without its two pictures, or both are of one campaign."""
    before, after = (
        cv2.imread(str(results / f"july/diagnosis/{CAMERA}/change_{when}.png")) for when in ("before", "after")
    )
    assert cv2.Laplacian(after, cv2.CV_64F).var() < 0.7 * cv2.Laplacian(before, cv2.CV_64F).var()
