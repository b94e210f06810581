"""Bad input through the real workflow: exit status 1, one message, no traceback, earlier results untouched.

tests/rig, tests/effects and tests/register have all the ways to be bad; here is what a user sees of them.
"""

import json
import shutil
import struct
import subprocess
import sys
import zlib

import cv2
import numpy as np
import pytest
import yaml

from tiny_campaign import SEEN_HEIGHT, SEEN_WIDTH, write_campaign, write_seen_campaign
from workflow_runs import copy_project, snakemake

TWIN = "effects:\n  - effect: lens_blur\n    parameters: {sigma_px: 0.8}\n"
FULL = """
mount -t tmpfs -o size={kib}k tmpfs results/tiny/render && cp -r {kept}/. results/tiny/render/ || exit 77
"$@"; status=$?
rm -r {kept} && cp -r results/tiny/render {kept}
exit $status
"""


@pytest.fixture(scope="module")
def project(tmp_path_factory):
    """Return a copy of the project, with a result from before, for all tests of this file."""
    project = copy_project(tmp_path_factory.mktemp("project") / "a copy")
    (project / "results/tiny/tables").mkdir(parents=True)
    (project / "results/tiny/tables/table1.csv").write_text("from before\n")
    return project


def message_of(status, said):
    """Hold a run to exit status 1, one error line and no traceback; return that line."""
    assert status == 1, said
    assert "Traceback" not in said and 'File "' not in said, said
    (message,) = [line for line in said.splitlines() if line.startswith("error: ")]
    return message


def refused(project, *arguments):
    """Run snakemake, which is to end before any job and to leave what is there; return its one message."""
    message = message_of(*snakemake(project, "--cores", 1, *arguments))
    left = [str(p.relative_to(project)) for p in (project / "results").rglob("*") if p.is_file()]
    assert left == ["results/tiny/tables/table1.csv"]
    assert (project / left[0]).read_text() == "from before\n"
    return message


def changed(name, old, new):
    """Return what replaces text in a campaign's file."""

    def change(campaign):
        text = (campaign / name).read_text()
        assert old in text
        (campaign / name).write_text(text.replace(old, new, 1))

    return change


def image_becomes(make):
    """Return what replaces the bytes of an image by ``make(bytes)``."""

    def change(campaign):
        path = campaign / "images/left/b.png"
        path.write_bytes(make(path.read_bytes()))

    return change


def with_size(width, height):
    """Return what puts another size into the header of a PNG, its checksum right."""

    def make(png):
        header = b"IHDR" + struct.pack(">II", width, height) + png[24:29]
        return png[:12] + header + struct.pack(">I", zlib.crc32(header)) + png[33:]

    return make


IMAGE = "captures.csv, capture left_b, column image: "
BAD = {
    "a missing folder": (shutil.rmtree, ["tiny", "no such"]),
    "a truncated PNG": (image_becomes(lambda png: png[:-40]), [IMAGE, "truncated"]),
    "another size": (image_becomes(with_size(63, 48)), [IMAGE, "63 x 48 pixels, but its camera has 64 x 48"]),
    "a huge header": (image_becomes(with_size(40_000, 40_000)), [IMAGE, "40000 x 40000 pixels; at most"]),
    "a duplicate capture": (changed("captures.csv", "left_b,", "left_a,"), ["row 3, column capture", "row 2"]),
    "an image twice": (changed("captures.csv", "left/b.png", "left/a.png"), ["row 3, column image", "row 2"]),
    "a marker twice": (changed("markers.csv", "DICT_ARUCO_ORIGINAL", "DICT_5X5_1000"), ["row 3, column id", "row 2"]),
    "an unknown dictionary": (changed("markers.csv", "DICT_5X5_1000", "DICT_9X9"), ["row 2, column dictionary"]),
    "an unknown camera": (changed("captures.csv", "left_b,left", "left_b,top"), ["row 3, column camera", "'top'"]),
    "no number": (changed("markers.csv", "0.07,0.1,-0.1", "0.07,0.1,nan"), ["row 2, column x", "'nan'"]),
    "text in a number": (changed("captures.csv", "0.3,45,1", "low,45,1"), ["row 3, column height_m", "'low'"]),
    "an absolute path": (changed("captures.csv", "images/left/b.png", "/etc/passwd"), ["row 3, column image"]),
    "a path that leaves": (changed("captures.csv", "images/left/b.png", "../b.png"), ["row 3, column image"]),
    "YAML that builds objects": (
        lambda campaign: (campaign / "campaign.yaml").write_text("!!python/object/apply:os.system ['touch owned']"),
        ["campaign.yaml, line 1"],
    ),
}


@pytest.mark.parametrize("what", BAD)
def test_a_bad_campaign_stops_before_any_job(project, tmp_path, what):
    change, words = BAD[what]
    campaign = write_campaign(tmp_path / "tiny")
    change(campaign)
    message = refused(project, "--config", f"campaign={campaign}")
    for word in words:
        assert word in message
    assert not (project / "owned").exists()


@pytest.mark.parametrize(
    ("setting", "words"),
    [
        ("render={device: tpu}", ["render.device is 'tpu'", "'cpu' or 'gpu'"]),
        ("detectors={bart: {speed: 2}}", ["detectors.bart", "no parameter 'speed'", "multi_scale"]),
        ("detectors={bart: {window_px: wide}}", ["detectors.bart", "'wide'", "int"]),
        ("detectors={nobody: {}}", ["detectors", "'nobody'", "aruco"]),
        ("diagnose={candidates: [haze]}", ["diagnose.candidates", "'haze'", "lens_blur"]),
    ],
)
def test_a_bad_configuration_stops_before_any_job(project, tmp_path, setting, words):
    message = refused(project, "--config", f"campaign={write_campaign(tmp_path / 'tiny')}", setting)
    for word in words:
        assert word in message


@pytest.mark.parametrize(
    ("path", "text", "words"),
    [
        ("config/twins/tiny/left.yaml", TWIN.replace("lens_blur", "haze"), ["left.yaml", "unknown effect 'haze'"]),
        ("config/twins/tiny/left.yaml", TWIN.replace("0.8", "80"), ["left.yaml", "sigma_px is 80 px; allowed are"]),
        ("config/twins/tiny/left.yaml", TWIN.replace("sigma_px", "sigma_mm"), ["left.yaml", "'sigma_mm'", "sigma_px"]),
        ("config/twins/tiny/left.yaml", TWIN + "  - effect: lens_blur\n", ["left.yaml", "'lens_blur' stands twice"]),
        ("scripts/effects/haze.py", "import nothing_of_this_name\n", ["haze.py", "nothing_of_this_name"]),
        ("scripts/effects/haze.py", '"""Haze."""\n', ["haze.py", "STAGE"]),
    ],
)
def test_a_bad_twin_or_effect_stops_before_any_job(project, tmp_path, path, text, words):
    campaign, path = write_campaign(tmp_path / "tiny"), project / path
    path.parent.mkdir(parents=True, exist_ok=True)
    path.write_text(text)
    try:
        message = refused(project, "--config", f"campaign={campaign}")
    finally:
        path.unlink()
    for word in words:
        assert word in message


def test_a_full_disk_while_rendering_is_one_message_and_costs_no_station(tmp_path):
    """A station cut short that passes for a render would spoil every number after it."""
    project, campaign = copy_project(tmp_path / "project"), write_campaign(tmp_path / "tiny")
    target = ("results/tiny/render/right.json", "--cores", 1, "--config", f"campaign={campaign}")
    status, said = snakemake(project, *target, "render={edge_samples: 16}")
    assert status == 0, said[-3000:]
    render, kept = project / "results/tiny/render", tmp_path / "kept"
    shutil.copytree(render, kept)
    before = {p.name: p.read_bytes() for p in (kept / "right").iterdir()}
    assert len(before) == 2
    kib = sum(-(-p.stat().st_size // 4096) * 4 for p in kept.rglob("*") if p.is_file()) + 12
    changed("captures.csv", "right_b,right,0.6,", "right_b,right,0.5,")(campaign)
    command = [sys.executable, "-m", "snakemake", *map(str, target), "render={edge_samples: 16}"]
    script = FULL.format(kib=kib, kept=f"'{kept}'")
    done = subprocess.run(
        ["unshare", "-rm", "sh", "-c", script, "sh", *command], cwd=project, capture_output=True, text=True, check=False
    )
    if done.returncode in (77, 127) or "unshare" in done.stderr:
        pytest.skip("needs the right to mount a small disk (unshare -rm)")
    message = message_of(done.returncode, done.stdout + done.stderr)
    assert "No space left" in message or "disk is full" in message
    assert {p.name: p.read_bytes() for p in (kept / "right").iterdir()} == before


def test_captures_that_show_nothing_end_in_a_verdict_that_says_so(tmp_path):
    """Black, saturated, too few to hold any out: no crash, and no effect blamed on a guess."""

    campaign = write_seen_campaign(tmp_path / "tiny")
    description = campaign / "campaign.yaml"
    data = yaml.safe_load(description.read_text())
    data["cameras"]["few"] = dict(data["cameras"]["left"])
    description.write_text(yaml.safe_dump(data))
    black, white = (np.full((SEEN_HEIGHT, SEEN_WIDTH), level, np.uint8) for level in (0, 255))
    rng = np.random.default_rng(0)
    for path in sorted((campaign / "images/left").glob("*.png")):
        cv2.imwrite(str(path), black + rng.integers(0, 2, black.shape, dtype=np.uint8))
    for path in sorted((campaign / "images/right").glob("*.png")):
        cv2.imwrite(str(path), white - rng.integers(0, 2, black.shape, dtype=np.uint8))
    with open(campaign / "captures.csv", "a") as file:
        file.write("few_1,few,0.3,40,0,images/few.png\n")
    cv2.imwrite(str(campaign / "images/few.png"), black + 90)
    project = copy_project(tmp_path / "project")
    status, said = snakemake(
        project, "diagnose", "--cores", 2, "--config", f"campaign={campaign}", "diagnose={candidates: [lens_blur]}"
    )
    assert status == 0, said[-4000:]
    for camera in ("left", "right", "few"):
        verdict = json.loads((project / f"results/tiny/diagnosis/{camera}.json").read_text())
        assert verdict["verdict"] == "unexplained" and verdict["steps"] == [], (camera, verdict)
        assert verdict["why"], camera
