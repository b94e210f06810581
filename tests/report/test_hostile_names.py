"""Untrusted names and texts on the pages: refused where they name files, shown as text where they do not."""

import json
import sys

import pandas as pd
import pytest
import yaml

from build_explorer import build_explorer
from inputs.campaign import load_campaign
from inputs.photo_facts import photo_facts
from inputs.tables import FILES
from reporting.pages import render
from rig.errors import InputError
from tiny_campaign import write_campaign
from workflow_runs import PROJECT

SCRIPT = "<script>alert(1)</script>"


def test_html_names_no_campaign_camera_capture_or_marker(tmp_path):
    """Fails if a name that a page, a path or a script would carry on may hold markup."""
    for k, (name, old, new, word) in enumerate(
        [
            ("campaign.yaml", "name: tiny", f"name: {SCRIPT}", "name"),
            ("campaign.yaml", "  left:", f"  {SCRIPT}:", "camera"),
            ("captures.csv", "left_a,", f"{SCRIPT},", "column capture"),
            ("markers.csv", "DICT_5X5_1000", SCRIPT, "column dictionary"),
        ]
    ):
        campaign = write_campaign(tmp_path / str(k))
        text = (campaign / name).read_text()
        assert old in text
        (campaign / name).write_text(text.replace(old, new, 1))
        with pytest.raises(InputError, match=word) as error:
            load_campaign(campaign)
        assert str(error.value).isprintable()


def test_the_page_to_explore_shows_names_as_text(tmp_path):
    """Fails if a name in a run's tables, wherever it came from, could begin an element or end its script."""
    row = "3,0.07,0.1,-0.1,0.4,0,0,0,0"
    (tmp_path / "markers.csv").write_text(f"dictionary,id,code_m,plate_m,x,y,z,rx,ry,rz\n{SCRIPT},{row}\n")
    (tmp_path / "scene.json").write_text(json.dumps({"name": SCRIPT, "origin": "camera", "target": None}))
    (tmp_path / "table1.csv").write_text(f"camera,algorithm\n{SCRIPT},{SCRIPT}\n")
    page = tmp_path / "report/explore.html"
    build_explorer(
        tmp_path / "markers.csv", tmp_path / "scene.json", tmp_path / "table1.csv", [SCRIPT], [SCRIPT],
        PROJECT / "scripts/reporting/explore", page,
    )  # fmt: skip
    for file in (page, page.parent / "explore/index.js"):
        assert "<script>alert" not in file.read_text(encoding="utf-8")
    assert "&lt;script&gt;alert(1)" in page.read_text(encoding="utf-8")


def test_the_report_shows_names_as_text():
    """Fails if a template takes a foreign text for markup."""
    html = render(
        PROJECT / "scripts/reporting/report_template.html.j2", title=SCRIPT, compared=[SCRIPT], headlines=[SCRIPT], sections=[],
        verdicts=[(SCRIPT, SCRIPT, SCRIPT)], ladder=([SCRIPT], [[SCRIPT]]), explorer=SCRIPT,
        provenance={
            "git": {"commit": SCRIPT, "changed_files": []}, "render": {SCRIPT: {SCRIPT: SCRIPT}}, "packages": {SCRIPT: SCRIPT},
            "data_md5": {SCRIPT: SCRIPT}, "twins_sha256": {SCRIPT: SCRIPT}, "seed": SCRIPT,
            "python": SCRIPT, "lock_sha256": SCRIPT,
        },
    )  # fmt: skip
    assert "<script>" not in html and "&lt;script&gt;" in html


def test_exif_of_a_photograph_is_text_on_its_page(tmp_path, monkeypatch):
    """Fails if a camera's name in EXIF could be markup on the page of photographs."""
    from PIL import Image
    from PIL.ExifTags import Base

    monkeypatch.setattr(sys, "path", [str(PROJECT / "notebooks"), *sys.path])
    import photograph_figures

    exif = Image.Exif()
    exif[Base.Make], exif[Base.Model] = SCRIPT, "\x1b[31mPhone\u202e"
    Image.new("RGB", (16, 16)).save(tmp_path / "a.jpg", exif=exif)
    facts = photo_facts(tmp_path / "a.jpg")
    assert facts["make"] == SCRIPT and facts["model"].isprintable()
    files = tmp_path / "register/left/files.csv"
    files.parent.mkdir(parents=True)
    pd.DataFrame([{"capture": "a"} | facts])[list(FILES.columns)].to_csv(files, index=False)
    (tmp_path / "register/left.json").write_text(json.dumps({"messages": [SCRIPT]}))
    cameras = pd.DataFrame([{"camera": "left", "width": 16, "height": 16}])
    shown = photograph_figures.words(tmp_path, cameras).data
    assert "<script>" not in shown and shown.count("&lt;script&gt;") == 2


def test_a_camera_s_name_in_exif_can_not_write_yaml(tmp_path):
    """Fails if EXIF could add keys to the campaign.yaml that is started from a folder."""
    from inputs.campaign import CalibrationBoard
    from start.patterns import Pattern
    from start_campaign import _description

    board = CalibrationBoard(type="chessboard", columns=9, rows=6, square_m=0.03)

    class Photograph:
        size, facts, maker = (64, 48), {"focal_35mm": None}, "a\nname: stolen\r# {x} \u2028b: *c"

    text = _description(tmp_path, Pattern(board, None), {"left": [Photograph()]})
    data = yaml.safe_load(text)
    assert data["name"] != "stolen" and set(data["cameras"]) == {"left"}
