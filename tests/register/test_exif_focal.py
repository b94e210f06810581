"""What EXIF says of a focal length is where a fit starts, and what is used where nothing can be fitted."""

import cv2
import numpy as np
import pandas as pd
import pytest
from PIL import Image
from PIL.ExifTags import IFD, Base

from inputs.photo_facts import focal_px, photo_facts
from register.boards import BoardPoints
from register.calibration import ideal_intrinsics, ideal_pinhole
from register_captures import exif_focal_px
from rig.geometry import camera_matrix

SIZE, TELE_PX = (1280, 960), 20_000.0
BOARD = np.array([[x, y, 0.0] for y in range(6) for x in range(8)]) * 0.03
SAID = {
    Base.FocalLength: 50.0, Base.ExifImageWidth: 6000, Base.ExifImageHeight: 4000,
    Base.FocalPlaneXResolution: 6000 / 2.25, Base.FocalPlaneYResolution: 4000 / 1.5, Base.FocalPlaneResolutionUnit: 3,
}  # fmt: skip


def photographed(focal):
    """Return {name: BoardPoints} of a board from eight sides by a camera of a focal length in pixels."""
    rng, K, views = np.random.default_rng(1), camera_matrix(focal, focal, 639.5, 479.5), {}
    for k in range(8):
        turn = rng.uniform(-0.6, 0.6, 3)
        t = np.array([0, 0, focal * 0.24 / 700]) - cv2.Rodrigues(turn)[0] @ BOARD.mean(0)
        xy = cv2.projectPoints(BOARD, turn, t, K, None)[0][:, 0]
        views[str(k)] = BoardPoints(BOARD, xy + rng.normal(0, 0.1, xy.shape), 0)
    return views


def test_a_fit_starts_where_exif_says_as_well():
    """Fails if a long lens is sought from wide ones alone: the fit then ends on its way."""
    views = photographed(TELE_PX)
    alone, with_exif = (ideal_pinhole(views, SIZE, said) for said in (None, 1.1 * TELE_PX))
    assert with_exif["rms_px"] < 0.145 < alone["rms_px"]  # 0.1 px of noise along each axis
    assert ideal_pinhole(photographed(900.0), SIZE, 1.5 * 900.0)["parameters"]["fx"] == pytest.approx(900.0, rel=0.01)


def test_what_exif_says_is_used_where_nothing_can_be_fitted():
    """Fails if two photographs have a focal length of a guess though their files say it, or if it is not said."""
    few = dict(list(photographed(900.0).items())[:2])
    for said, fx, words in ((950.0, 950.0, "EXIF's focal length is used"), (None, 1280.0, "a guess is used")):
        messages = []
        assert ideal_intrinsics(few, {}, SIZE, messages, said) == [fx, fx, 639.5, 479.5]
        assert messages[0].endswith(words)


@pytest.mark.parametrize(
    ("changes", "expected"),
    [
        ({}, 80.0),  # 22.5 x 15 mm
        ({Base.FocalPlaneResolutionUnit: 2}, 31.5),
        ({Base.FocalLengthIn35mmFilm: 75}, 75.0),
        ({Base.FocalPlaneXResolution: 0.0}, None),
        ({Base.FocalPlaneXResolution: 1e7, Base.FocalPlaneYResolution: 1e7}, None),
    ],
    ids=["by the sensor", "inches", "said itself", "no resolution", "no such sensor"],
)
def test_a_sensors_size_tells_what_is_not_said(tmp_path, changes, expected):
    """Fails if units are mixed up, what is said itself is passed over, or a sensor of a tenth of a millimetre is believed."""
    exif = Image.Exif()
    exif.get_ifd(IFD.Exif).update(SAID | changes)
    Image.new("RGB", (600, 400)).save(tmp_path / "a.jpg", exif=exif)
    facts = photo_facts(tmp_path / "a.jpg")
    assert facts["focal_35mm"] == (expected and pytest.approx(expected, rel=0.002))
    if not changes:
        assert focal_px(facts["focal_35mm"], (600, 400)) == pytest.approx(50.0 / 22.5 * 600, rel=0.002)
    assert facts["notes"] == ""


def test_a_photograph_that_was_edited_does_not_silence_the_others(tmp_path):
    """Fails if the focal length is asked of the first file alone, which has lost what the others say."""
    exif = Image.Exif()
    exif.get_ifd(IFD.Exif).update(SAID | {Base.FocalLengthIn35mmFilm: 75})
    for name, kept in (("a.jpg", None), ("b.jpg", exif), ("c.jpg", exif)):
        Image.new("RGB", (600, 400)).save(tmp_path / name, **({"exif": kept} if kept is not None else {}))
    captures = pd.DataFrame({"image": ["a.jpg", "b.jpg", "c.jpg"]})
    assert exif_focal_px(tmp_path, captures, (600, 400)) == pytest.approx(focal_px(75.0, (600, 400)))
    assert exif_focal_px(tmp_path, captures.iloc[:1], (600, 400)) is None
