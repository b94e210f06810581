"""What trials hide is dealt evenly, repeats by its seed, and is told by nothing but the truth's file."""

import csv
import json

import numpy as np
import pytest
import yaml
from PIL import Image

from generator import LIBRARY, OUTSIDE, draw_effect, nominal
from inputs.campaign import load_campaign
from trials import generate_trials
from trials.trial_names import names_of

TINY = nominal.RIGS["tiny"].cameras[0]


def test_a_campaign_is_complete_and_tells_nothing(tmp_path):
    """The folder holds what the format asks for, images fit the tables, and neither name nor files tell
    what is hidden.
    """
    out, truths = tmp_path / "out", tmp_path / "truths"
    where = ["--out", str(out), "--truths", str(truths)]
    generate_trials.main([*where, "--kind", "single", "--count", "2", "--seed", "x", "--size", "tiny"])
    folders = sorted(p for p in out.iterdir())
    assert len(folders) == 2
    for folder in folders:
        assert load_campaign(folder).file.name == folder.name  # the project's own reader finds no fault
        settings = yaml.safe_load((folder / "campaign.yaml").read_text())
        assert settings["name"] == folder.name and settings["schema"] == 1
        ((name, camera),) = settings["cameras"].items()
        rows = list(csv.DictReader((folder / "captures.csv").open()))
        assert {r["camera"] for r in rows} == {name} and len({r["capture"] for r in rows}) == len(rows) == 4
        for row in rows:
            image = Image.open(folder / row["image"])
            assert image.size == (camera["width"], camera["height"]) and image.mode == "RGB"
        markers = list(csv.DictReader((folder / "markers.csv").open()))
        assert len({(m["dictionary"], m["id"]) for m in markers}) == 40
        files = {str(p.relative_to(folder)) for p in folder.rglob("*") if p.is_file()}
        tables = {"campaign.yaml", "captures.csv", "markers.csv"}
        assert files == tables | {r["image"] for r in rows}
        truth = json.loads((truths / folder.name / "truth.json").read_text())
        (hidden,) = truth["effects"]
        for table in tables:
            assert hidden["effect"] not in (folder / table).read_text()


def test_every_effect_is_dealt_equally_often():
    """58 single trials hide each of the 29 twice, pairs are two different ones; else some effect is
    never tried.
    """
    names = [generate_trials.hidden_effects("single", i, "s")[0] for i in range(58)]
    assert sorted(names) == sorted([*LIBRARY, *LIBRARY]) and len(LIBRARY) == 29
    assert all(len(set(generate_trials.hidden_effects("pair", i, "s"))) == 2 for i in range(100))
    assert generate_trials.hidden_effects("none", 3, "s") == []
    assert {generate_trials.hidden_effects("outside", i, "s")[0] for i in range(10)} == set(OUTSIDE)


def test_power_trials_share_their_draw(tmp_path):
    """The strengths of one effect differ in strength alone; else a power curve mixes two causes."""
    truths = [
        generate_trials.generate_trial(tmp_path / "o", tmp_path / "e", "power", i, "s", "lens_blur", size="tiny")[1]
        for i in range(3)
    ]
    sigmas = [t["effects"][0]["parameters"]["sigma_px"] for t in truths]
    assert np.array(sigmas) / sigmas[2] == pytest.approx([0.25, 0.5, 1])


def test_open_truths_are_refused(tmp_path):
    """Fails if a truth may lie among the campaigns: it would tell all."""
    with pytest.raises(SystemExit):
        generate_trials.main(["--out", str(tmp_path), "--truths", str(tmp_path / "e"), "--kind", "none",
                              "--seed", "s"])  # fmt: skip


def test_whole_cameras_are_plausible():
    """Four to nine names, so many of each part, none that are alike, every effect of the parts now and then; else a
    trial asks for what no one could tell.
    """
    drawn = [generate_trials.hidden_effects("whole", k, "s") for k in range(300)]
    for names in drawn:
        assert 4 <= len(names) <= 9 and len(set(names)) == len(names) and set(names) <= set(LIBRARY)
        assert 2 <= len({"radial_distortion", "vignetting", "lens_blur", "defocus", "field_curvature",
                         "lateral_chromatic_aberration", "principal_point", "focal_length"} & set(names)) <= 4  # fmt: skip
        assert len({"lens_blur", "defocus", "field_curvature"} & set(names)) <= 1
        assert not {"focal_length", "camera_pose_offset"} <= set(names)
        assert not {"tone_curve", "exposure"} <= set(names)
    assert {len(names) for names in drawn} == {4, 5, 6, 7, 8, 9}
    assert set(LIBRARY) - {name for names in drawn for name in names} == {
        "tangential_distortion",
        "motion_blur",
        "local_warp",
    }


def test_a_whole_camera_repeats_and_tells_its_strengths(tmp_path):
    """Names, strengths and bytes hang on seed, kind and index alone; parameters are those of the strengths that are told."""
    for k in (1, 2):
        name, truth = generate_trials.generate_trial(
            tmp_path / f"o{k}", tmp_path / f"t{k}", "whole", 0, "s", size="tiny"
        )
    assert names_of({k: 0 for k in ("single", "pair", "none", "outside", "power")} | {"whole": 1}, "s", "tiny") == {
        name: ("whole", 0)
    }
    files = [p.relative_to(tmp_path / "o1") for p in (tmp_path / "o1").rglob("*") if p.is_file()]
    assert len(files) == 7
    assert all((tmp_path / "o1" / f).read_bytes() == (tmp_path / "o2" / f).read_bytes() for f in files)
    assert list(truth["strengths"]) == [e["effect"] for e in truth["effects"]]
    assert all(0.25 <= s <= 1 for s in truth["strengths"].values()) and len(set(truth["strengths"].values())) > 1
    for e in truth["effects"]:
        assert e["parameters"] == draw_effect(e["effect"], truth["strengths"][e["effect"]], TINY, truth["seed_name"])
