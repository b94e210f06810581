"""What files say of themselves: read as it stands, and left out in words where it cannot be believed."""

import struct

import numpy as np
import pillow_heif
import pytest
from PIL import Image
from PIL.ExifTags import IFD, Base

from inputs.photo_facts import focal_px, photo_facts, said_in_words

PIXELS = np.random.default_rng(0).integers(0, 255, (48, 64, 3), dtype=np.uint8)
ASCII, SHORT, LONG, RATIONAL, SIGNED, DOUBLE = 2, 3, 4, 5, 8, 12
SIZES = {ASCII: 1, SHORT: 2, LONG: 4, RATIONAL: 8, SIGNED: 2, DOUBLE: 8}


def phone(orientation=6):
    """Return the EXIF of a phone's photograph."""
    exif = Image.Exif()
    exif[Base.Make], exif[Base.Model], exif[Base.Orientation] = "Maker ", "Phone 3\0", orientation
    own = {Base.ExposureTime: 1 / 50, Base.ISOSpeedRatings: 320, Base.FNumber: 1.8, Base.FocalLength: 4.25}
    exif.get_ifd(IFD.Exif).update(own | {Base.FocalLengthIn35mmFilm: 26})
    return exif


def raw_exif(first, own=()):
    """Return EXIF as bytes, from (tag, type, count, value bytes) of its first directory and of its own."""
    blocks, where = [], 8
    own_at = 8 + 2 + 12 * (len(first) + 1) + 4
    for entries in ([*first, (IFD.Exif, LONG, 1, struct.pack("<I", own_at))], own):
        data_at = where + 2 + 12 * len(entries) + 4 if entries is not own else where + 2 + 12 * len(own) + 4
        data_at += 10_000 if entries is not own else 0  # behind both directories
        head, data = struct.pack("<H", len(entries)), b""
        for tag, kind, count, value in entries:
            inline = value.ljust(4, b"\0") if len(value) <= 4 else struct.pack("<I", data_at + len(data))
            data += b"" if len(value) <= 4 else value
            head += struct.pack("<HHI", tag, kind, count) + inline
        blocks.append((where, head + struct.pack("<I", 0), data_at, data))
        where = own_at
    out = bytearray(b"II*\0" + struct.pack("<I", 8))
    for at, head, data_at, data in blocks:
        end = max(at + len(head), data_at + len(data)) if data else at + len(head)
        out.extend(bytes(max(0, end - len(out))))
        out[at : at + len(head)] = head
        out[data_at : data_at + len(data)] = data
    return b"Exif\0\0" + bytes(out)


def jpeg(folder, exif=b"", **options):
    """Write a JPEG with these EXIF bytes, unchecked, and return its path."""
    path = folder / "a.jpg"
    Image.fromarray(PIXELS).save(path, **options)
    content = path.read_bytes()
    segment = b"\xff\xe1" + struct.pack(">H", len(exif) + 2) + exif if exif else b""
    path.write_bytes(content[:2] + segment + content[2:])
    return path


@pytest.mark.parametrize("name", ["a.jpg", "a.png", "a.heic"])
def test_what_a_phone_writes_is_read(tmp_path, name):
    """Fails if a format's EXIF is overlooked, or if HEIC's is what libheif makes of it after turning."""
    path = tmp_path / name
    if name == "a.heic":
        pillow_heif.from_pillow(Image.fromarray(PIXELS)).save(path, exif=phone().tobytes())
    else:
        Image.fromarray(PIXELS).save(path, exif=phone())
    facts = photo_facts(path)
    assert (facts["make"], facts["model"], facts["notes"]) == ("Maker", "Phone 3", "")
    numbers = {"orientation": 6, "exposure_s": 0.02, "iso": 320, "f_number": 1.8, "focal_mm": 4.25, "focal_35mm": 26}
    assert {k: facts[k] for k in numbers} == pytest.approx(numbers)
    assert facts["format"] == {"a.jpg": "JPEG", "a.png": "PNG", "a.heic": "HEIC"}[name]
    assert (facts["jpeg_quality"] is not None) == (name == "a.jpg")


def test_a_tiffs_tags_are_read(tmp_path):
    """Fails if TIFF is a format that only an earlier import of something else makes known."""
    Image.fromarray(PIXELS).save(tmp_path / "a.tif", exif=phone(1))
    facts = photo_facts(tmp_path / "a.tif")
    assert (facts["format"], facts["model"], facts["notes"]) == ("TIFF", "Phone 3", "")


@pytest.mark.parametrize(("quality", "subsampling", "sampling"), [(30, 2, "4:2:0"), (85, 1, "4:2:2"), (95, 0, "4:4:4")])
def test_a_jpegs_own_tables_tell_its_quality(tmp_path, quality, subsampling, sampling):
    """Fails if tables are read in zigzag order, or if quality is that of another encoder."""
    facts = photo_facts(jpeg(tmp_path, quality=quality, subsampling=subsampling))
    assert (facts["jpeg_quality"], facts["jpeg_tables"], facts["jpeg_sampling"]) == (quality, "libjpeg", sampling)
    steps = [int(step) for step in facts["jpeg_brightness"].split()]
    assert len(steps) == 64 and steps == list(Image.open(tmp_path / "a.jpg").quantization[0])


@pytest.mark.parametrize(
    ("factors", "sampling"), [((0x22, 0x12), "4:2:2"), ((0x22, 0x21), "4:4:0"), ((0x42, 0x11), "4x2")]
)
def test_sampling_is_how_brightness_and_colour_differ(tmp_path, factors, sampling):
    """Fails if a camera that samples brightness twice down, colour too, is taken for one that halves colour down."""
    of_brightness, of_colour = factors
    data = jpeg(tmp_path, subsampling=0).read_bytes()
    at = data.index(b"\xff\xc0") + 10
    file = bytearray(data)
    file[at + 1 : at + 9 : 3] = of_brightness, of_colour, of_colour
    (tmp_path / "b.jpg").write_bytes(file)
    assert photo_facts(tmp_path / "b.jpg")["jpeg_sampling"] == sampling


def test_tables_of_a_camera_are_its_own(tmp_path):
    """Fails if a camera's own tables pass for libjpeg's, or are taken for no JPEG's."""
    with Image.open(jpeg(tmp_path, quality=80)) as image:
        tables = [list(image.quantization[k]) for k in (0, 1)]
    tables[0][5] += 2
    facts = photo_facts(jpeg(tmp_path, qtables=tables))
    assert (facts["jpeg_quality"], facts["jpeg_tables"]) == (80, "own")


def test_a_grey_jpeg_has_one_table(tmp_path):
    """Fails if what has no colour is given a colour's sampling."""
    Image.fromarray(PIXELS[..., 0]).save(tmp_path / "g.jpg", quality=70)
    facts = photo_facts(tmp_path / "g.jpg")
    assert (facts["jpeg_quality"], facts["jpeg_sampling"], facts["jpeg_colour"]) == (70, "grey", None)


OF_IT = {
    "a negative orientation": ([(Base.Orientation, SIGNED, 1, struct.pack("<h", -3))], [], "orientation"),
    "a huge orientation": ([(Base.Orientation, LONG, 1, struct.pack("<I", 4_000_000_000))], [], "orientation"),
    "text in a number": ([], [(Base.ExposureTime, ASCII, 5, b"fast\0")], "exposure_s"),
    "digits as text": ([], [(Base.ISOSpeedRatings, ASCII, 4, b"100\0")], "iso"),
    "division by zero": ([], [(Base.FNumber, RATIONAL, 1, struct.pack("<II", 5, 0))], "f_number"),
    "infinity": ([], [(Base.FocalLength, DOUBLE, 1, struct.pack("<d", float("inf")))], "focal_mm"),
    "no number at all": ([], [(Base.FocalLength, DOUBLE, 1, struct.pack("<d", float("nan")))], "focal_mm"),
    "a maker without end": ([(Base.Make, ASCII, 50_000, b"M" * 50_000)], [], "make"),
    "a number as a name": ([(Base.Model, SHORT, 1, b"\1\0")], [], "model"),
}


@pytest.mark.parametrize("what", OF_IT)
def test_what_cannot_be_believed_is_left_out_in_words(tmp_path, what):
    """Fails if hostile EXIF ends in a traceback, in a number that nobody measured, or takes good entries with it."""
    first, own, name = OF_IT[what]
    good = (Base.FocalLengthIn35mmFilm, SHORT, 1, struct.pack("<H", 26))
    facts = photo_facts(jpeg(tmp_path, raw_exif(first, [*own, good])))
    assert facts[name] is None and name in facts["notes"] and "ignored" in facts["notes"]
    assert facts["focal_35mm"] == 26 and facts["jpeg_quality"] == 75


@pytest.mark.parametrize(
    "blob", [b"", b"no EXIF", b"Exif\0\0", b"Exif\0\0II*\0\xff\xff\xff\xff", b"Exif\0\0" + b"\xff" * 60]
)
def test_what_is_no_exif_says_nothing(tmp_path, blob):
    """Fails if a broken segment stops a campaign."""
    facts = photo_facts(jpeg(tmp_path, blob))
    assert facts["make"] is None and facts["iso"] is None and facts["jpeg_quality"] == 75


def test_no_broken_exif_is_an_error(tmp_path):
    """Fails if some byte of EXIF or of a JPEG's head leads to a traceback."""
    rng = np.random.default_rng(1)
    content = jpeg(tmp_path, phone().tobytes()).read_bytes()
    for _ in range(300):
        changed = bytearray(content)
        for at in rng.integers(2, 900, 6):
            changed[at % len(changed)] = rng.integers(256)
        (tmp_path / "b.jpg").write_bytes(changed)
        assert isinstance(photo_facts(tmp_path / "b.jpg")["notes"], str)


def rows(**changes):
    """Return what two files of one camera say, the second one changed."""
    said = {"capture": "a", "make": "Maker", "model": "Phone", "orientation": 1, "exposure_s": 0.01, "iso": 100.0}
    said |= {"f_number": 2.0, "focal_mm": 4.0, "focal_35mm": 26.0, "jpeg_quality": 90, "jpeg_tables": "libjpeg"}
    said |= {"jpeg_sampling": "4:2:0", "notes": ""}
    return [said, said | {"capture": "b"} | changes]


def test_settings_are_told_from_least_to_most():
    """Fails if a range is told of numbers that are the same, or if a missing value counts as one."""
    exif, coding = said_in_words(rows(iso=float("nan"), exposure_s=0.5), (4000, 3000))
    assert (
        exif
        == "EXIF: Maker Phone, exposed 1/100 to 0.5 s, ISO 100, f/2, 4 mm, 3005 px by the focal length for 36 x 24 mm"
    )
    assert coding == "JPEG: libjpeg's tables of quality 90, 4:2:0"
    assert focal_px(26, (4000, 3000)) == pytest.approx(26 / 43.2666 * 5000, rel=1e-4)


@pytest.mark.parametrize(
    ("changes", "words"),
    [
        ({"model": "Other"}, "several cameras: Maker Phone (1), Maker Other (1)"),
        ({"focal_mm": 9.0}, "several focal lengths"),
        ({"orientation": 8}, "notes 1 photographs as turned"),
        ({"notes": "iso is not from 1 to 1e+07: ignored"}, "capture b: iso is not"),
    ],
)
def test_what_does_not_belong_together_is_said(changes, words):
    """Fails if two cameras, two zooms or a turned photograph under one name go unnoticed."""
    assert any(words in line for line in said_in_words(rows(**changes), (4000, 3000)))
    assert len(said_in_words(rows(), (4000, 3000))) == 2


def test_files_that_say_nothing_are_not_spoken_of():
    """Fails if a PNG without EXIF is described by words without content."""
    assert said_in_words([dict.fromkeys(rows()[0]) | {"capture": "a", "notes": ""}], (64, 48)) == []
