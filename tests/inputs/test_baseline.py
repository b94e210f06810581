"""A baseline that cannot be one is refused before any job, in one line that says what to do."""

import cv2
import numpy as np
import pandas as pd
import pytest
import yaml
from PIL import Image
from PIL.ExifTags import Base

from inputs.baseline import check_baseline
from inputs.campaign import load_campaign
from rig.errors import InputError


def campaign(folder, number=5, first=0, **changes):
    """Write a campaign of photographs of a chessboard, each of its own noise; return its folder."""
    folder.mkdir()
    camera = {"width": 64, "height": 48, "fx": None, "fy": None, "cx": None, "cy": None}
    facts = {
        "schema": 1, "name": folder.name, "origin": "camera", "captures": "captures.csv", "cameras": {"phone": camera},
        "target": {"type": "chessboard", "columns": 9, "rows": 6, "square_m": 0.025},
    }  # fmt: skip
    for key, value in changes.items():
        facts[key] = value
    width, height = (next(iter(facts["cameras"].values()))[k] for k in ("width", "height"))
    names = [f"p{k}" for k in range(first, first + number)]
    for k, name in enumerate(names, first):
        pixels = np.random.default_rng(k).integers(0, 255, (height, width), dtype=np.uint8)
        cv2.imwrite(str(folder / f"{name}.png"), pixels)
    table = {"capture": names, "camera": next(iter(facts["cameras"])), "image": [f"{n}.png" for n in names]}
    pd.DataFrame(table).to_csv(folder / "captures.csv", index=False)
    (folder / "campaign.yaml").write_text(yaml.safe_dump(facts))
    return folder


@pytest.fixture
def now(tmp_path):
    """A campaign that is compared with others."""
    return load_campaign(campaign(tmp_path / "now", first=100))


def refused(now, folder):
    """Return why a baseline is refused: one line."""
    with pytest.raises(InputError) as error:
        check_baseline(now, str(folder))
    assert "\n" not in str(error.value)
    return str(error.value)


def test_other_photographs_of_the_same_are_a_baseline(now, tmp_path):
    """Fails if a fitting baseline is refused."""
    check_baseline(now, campaign(tmp_path / "then"))


def test_a_campaign_is_no_baseline_of_itself(now, tmp_path):
    """Fails if a campaign can be compared with itself, under its own or another path, or with a copy of a photograph."""
    assert "is the campaign itself" in refused(now, tmp_path / "now")
    assert "is the campaign itself" in refused(now, tmp_path / "now" / ".." / "now")
    assert "the same photograph as" in refused(now, campaign(tmp_path / "copy", first=104))
    assert "give one of the two another" in refused(now, campaign(tmp_path / "other", name="now"))


def test_a_missing_baseline_is_named(now, tmp_path):
    """Fails if a folder that is not there is not said by its path."""
    assert str(tmp_path / "nowhere") in refused(now, tmp_path / "nowhere")


def test_another_camera_size_or_board_is_refused(now, tmp_path):
    """Fails if a baseline is taken whose camera or board is another one: every difference would be a change."""
    camera = {"width": 64, "height": 48, "fx": None, "fy": None, "cx": None, "cy": None}
    assert "camera 'phone' took no capture there" in refused(now, campaign(tmp_path / "a", cameras={"gopro": camera}))
    larger = campaign(tmp_path / "b", cameras={"phone": camera | {"width": 80}})
    assert "80 x 48 pixels" in refused(now, larger)
    known = campaign(
        tmp_path / "c", cameras={"phone": {"width": 64, "height": 48, "fx": 50.0, "fy": 50.0, "cx": 1.0, "cy": 1.0}}
    )
    assert "other nominal intrinsics" in refused(now, known)
    board = {"type": "chessboard", "columns": 8, "rows": 6, "square_m": 0.025}
    assert "target is not that of" in refused(now, campaign(tmp_path / "d", target=board))


def taken_with(folder, *said):
    """Write make and model, a pair a photograph, None for nothing, into a campaign's photographs; return its folder."""
    for path, makers in zip(sorted(folder.glob("*.png")), said, strict=False):
        with Image.open(path) as image:
            exif = Image.Exif()
            exif.update({k: v for k, v in zip((Base.Make, Base.Model), makers, strict=True) if v})
            image.save(path, exif=exif)
    return folder


def test_a_camera_that_files_say_is_another_is_refused(now, tmp_path):
    """Fails if photographs by another camera, under the same name, are compared: all that the two differ in would be a change."""
    taken_with(now.folder, *[("Maker", "Phone 3")] * 5)
    message = refused(now, taken_with(campaign(tmp_path / "a"), *[("Maker", "Phone 4")] * 5))
    assert "another camera, Maker Phone 4, than those of" in message and "Maker Phone 3;" in message
    edited = taken_with(campaign(tmp_path / "c"), (None, None), *[("Maker", "Phone 4")] * 4)
    assert "another camera, Maker Phone 4, than" in refused(now, edited)  # the first says nothing any more
    assert "another camera, Other, than" in refused(now, taken_with(campaign(tmp_path / "b"), *[("Other", None)] * 5))


@pytest.mark.parametrize(
    "said", [[("Maker", "Phone 4"), ("Maker", "Phone 3")], [("Maker", None)] * 5, [(None, "Phone 3")] * 5, []]
)
def test_what_does_not_contradict_is_no_other_camera(now, tmp_path, said):
    """Fails if one photograph by another camera, a missing model or make, or files that say nothing, end a comparison."""
    taken_with(now.folder, *[("Maker", "Phone 3")] * 5)
    check_baseline(now, taken_with(campaign(tmp_path / "then"), *said))


def test_too_few_captures_are_refused(now, tmp_path):
    """Fails if four photographs, whose p-values cannot be small, are compared."""
    assert "4 captures by 'phone'; at least 5 are needed" in refused(now, campaign(tmp_path / "few", number=4))
