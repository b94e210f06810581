"""Untrusted images: checked before they are decoded, and never silently filled with grey."""

import struct
import zlib

import cv2
import numpy as np
import pillow_heif
import pytest
from PIL import Image

import detect_markers
from inputs.campaign import load_campaign
from inputs.images import check_captures, read_header, read_image
from rig.errors import InputError
from shared_files import shared
from start.photographs import look_through
from tiny_campaign import write_campaign

ORIENTATION = 0x0112  # EXIF's tag
COLOUR = np.random.default_rng(0).integers(0, 255, (60, 80, 3), dtype=np.uint8)


def png(width, height, rows, bits=8, colour=0):
    """Return a PNG's bytes with the given header and raw rows, whether they agree or not."""

    def chunk(kind, body):
        return struct.pack(">I", len(body)) + kind + body + struct.pack(">I", zlib.crc32(kind + body))

    header = struct.pack(">IIBBBBB", width, height, bits, colour, 0, 0, 0)
    return b"\x89PNG\r\n\x1a\n" + chunk(b"IHDR", header) + chunk(b"IDAT", zlib.compress(rows)) + chunk(b"IEND", b"")


@pytest.mark.parametrize("name", ["a.png", "a.jpg", "a.tif"])
def test_header_and_pixels_are_those_of_the_file(tmp_path, name):
    path = tmp_path / name
    cv2.imwrite(str(path), COLOUR)
    assert read_header(path) == (80, 60, 8, 3)
    image = read_image(path, (80, 60))
    assert image.shape == (60, 80, 3)
    if name != "a.jpg":
        assert (image == COLOUR).all()


def test_grey_stays_grey_and_sixteen_bits_stay_sixteen(tmp_path):
    path = tmp_path / "deep.png"
    deep = COLOUR[:, :, 0].astype(np.uint16) * 257
    cv2.imwrite(str(path), deep)
    image = read_image(path)
    assert image.dtype == np.uint16
    assert (image == deep).all()


@pytest.mark.parametrize("name", ["a.png", "a.jpg", "a.tif"])
@pytest.mark.parametrize("share", [0.02, 0.5, 0.99])
def test_a_truncated_file_is_refused(tmp_path, name, share):
    """OpenCV reads such files without a word and fills the rest."""
    path = tmp_path / name
    cv2.imwrite(str(path), COLOUR)
    content = path.read_bytes()
    path.write_bytes(content[: int(share * len(content))])
    with pytest.raises(InputError, match=name):
        read_image(path)


def test_a_flipped_bit_is_refused(tmp_path):
    path = tmp_path / "a.png"
    cv2.imwrite(str(path), COLOUR)
    content = bytearray(path.read_bytes())
    content[len(content) // 2] ^= 1
    path.write_bytes(content)
    with pytest.raises(InputError, match="checksum"):
        read_image(path)


def test_missing_rows_behind_good_checksums_are_refused(tmp_path):
    path = tmp_path / "short.png"
    path.write_bytes(png(40, 30, bytes(41) * 20))
    with pytest.raises(InputError, match="rows are not complete"):
        read_image(path)


def test_a_huge_header_is_refused_before_decoding(tmp_path):
    """40,000 x 40,000 pixels would be 1.6 GB; the file has some hundred bytes."""
    path = tmp_path / "huge.png"
    path.write_bytes(png(40_000, 40_000, b"\0"))
    assert read_header(path)[:2] == (40_000, 40_000)
    with pytest.raises(InputError, match="40000 x 40000"):
        read_image(path)


def test_another_size_than_the_cameras_is_refused(tmp_path):
    path = tmp_path / "a.png"
    cv2.imwrite(str(path), COLOUR)
    with pytest.raises(InputError, match="80 x 60 pixels, but its camera has 64 x 48"):
        read_image(path, (64, 48))


@pytest.mark.parametrize(
    "content", [b"", b"hello", b"\xff\xd8", b"\x89PNG\r\n\x1a\n", b"II*\0", b"MM\0*\xff\xff\xff\xff"]
)
def test_what_is_no_image_ends_in_one_message(tmp_path, content):
    path = tmp_path / "odd.png"
    path.write_bytes(content)
    with pytest.raises(InputError, match="odd.png"):
        read_image(path)


@pytest.mark.parametrize("name", ["a.jpg", "a.png"])
def test_exifs_orientation_turns_nothing(tmp_path, name):
    """Were one reader to turn an image and another not, corners and twin would lie in two frames."""
    path = tmp_path / name
    exif = Image.Exif()
    exif[ORIENTATION] = 6  # to be turned by 90 degrees
    Image.fromarray(COLOUR).save(path, exif=exif)
    assert read_image(path, (80, 60)).shape == (60, 80, 3)
    assert (detect_markers.read_image(path) == read_image(path)).all()


@pytest.mark.parametrize("orientation", range(1, 9))
def test_a_heic_photograph_lies_along_the_sensors_axes(tmp_path, orientation):
    """Fails if pixels come as libheif turns them: a photograph held upright would be another camera's."""
    path, smooth = tmp_path / "a.heic", cv2.resize(COLOUR[:6, :8], (80, 60), interpolation=cv2.INTER_NEAREST)
    exif = Image.Exif()
    exif[ORIENTATION] = orientation
    pillow_heif.from_pillow(Image.fromarray(smooth[..., ::-1])).save(path, exif=exif.tobytes(), quality=95, chroma=444)
    assert read_header(path) == (80, 60, 8, 3)
    image = read_image(path, (80, 60))
    assert image.shape == (60, 80, 3) and np.abs(image.astype(int) - smooth).mean() < 2
    assert (detect_markers.read_image(path) == image).all()


@pytest.mark.parametrize("depth", [8, 16])
def test_a_grey_heic_stays_grey_and_keeps_its_depth(tmp_path, depth):
    """Fails if a deep photograph loses its bits, or if 10 bits are taken for full scale 1023."""
    mode, levels = {8: ("L", COLOUR[..., 0]), 16: ("L;16", COLOUR[..., 0].astype(np.uint16) * 257)}[depth]
    pillow_heif.from_bytes(mode, (80, 60), levels.tobytes()).save(tmp_path / "a.heic", quality=-1)
    assert read_header(tmp_path / "a.heic") == (80, 60, depth, 1)
    image = read_image(tmp_path / "a.heic")
    assert image.dtype == levels.dtype and image.shape == (60, 80)
    assert np.abs(image.astype(int) - levels).max() <= (1 if depth == 8 else 64)


@pytest.mark.parametrize("share", [0.02, 0.3, 0.99])
def test_a_truncated_heic_is_refused(tmp_path, share):
    """Fails if a photograph that was cut off on its way from the phone is measured, or ends in a traceback."""
    path = tmp_path / "a.heic"
    pillow_heif.from_pillow(Image.fromarray(COLOUR)).save(path)
    content = path.read_bytes()
    path.write_bytes(content[: int(share * len(content))])
    with pytest.raises(InputError, match="a.heic: .*(broken|cut off|truncated|not a PNG)"):
        read_image(path)


@pytest.mark.parametrize("name", ["a.avi", "a.mp4"])
def test_a_video_is_called_one(tmp_path, name):
    """Fails if what a phone's folder has among its photographs is called a broken image."""
    code = cv2.VideoWriter.fourcc(*{"a.avi": "MJPG", "a.mp4": "mp4v"}[name])
    video = cv2.VideoWriter(str(tmp_path / name), code, 5, (80, 60))
    video.write(COLOUR)
    video.release()
    (tmp_path / name).rename(tmp_path / "a.jpg")
    with pytest.raises(InputError, match="a.jpg: a video, and photographs are needed"):
        read_header(tmp_path / "a.jpg")


@pytest.mark.parametrize("asked", [load_campaign, look_through])
def test_a_file_in_a_folders_place_is_called_what_it_is(tmp_path, asked):
    """Fails if who names a video, or one photograph, where a folder is needed reads that there is no such folder."""
    (tmp_path / "clip.mp4").write_bytes(b"\0\0\0\x18ftypmp42" + bytes(40))
    with pytest.raises(InputError, match="clip.mp4: a video, and photographs are needed; save some"):
        asked(tmp_path / "clip.mp4")
    cv2.imwrite(str(tmp_path / "one.png"), COLOUR)
    with pytest.raises(InputError, match="one.png: a file, and its folder is needed"):
        asked(tmp_path / "one.png")
    with pytest.raises(InputError, match="none: no such"):
        asked(tmp_path / "none")


def test_a_real_video_is_called_one():
    """Fails if only videos that OpenCV wrote are known."""
    with pytest.raises(InputError, match="testcalibration.mp4: a video"):
        read_header(shared("real/charuco5x5_wpical_1080p/testcalibration.mp4"))


def tiff(pixels, orientation, order):
    """Return an RGB image (H, W, 3) as the bytes of a plain TIFF."""
    height, width, _ = pixels.shape
    start = 8 + 2 + 12 * 10 + 4
    tags = {256: width, 257: height, 258: 8, 259: 1, 262: 2, 273: start, 274: orientation, 277: 3, 278: height}
    tags[279] = pixels.size
    entries = b"".join(struct.pack(f"{order}HHII", tag, 4, 1, value) for tag, value in tags.items())
    head = (b"II" if order == "<" else b"MM") + struct.pack(f"{order}HIH", 42, 8, len(tags))
    return head + entries + bytes(4) + pixels.tobytes()


@pytest.mark.parametrize("order", "<>")
@pytest.mark.parametrize("orientation", range(1, 9))
def test_a_turned_tiff_lies_along_the_sensors_axes(tmp_path, orientation, order):
    """Fails if a TIFF is turned as OpenCV does even when told not to."""
    path = tmp_path / "a.tif"
    path.write_bytes(tiff(COLOUR[..., ::-1], orientation, order))
    assert read_image(path, (80, 60)).tolist() == COLOUR.tolist()
    assert (detect_markers.read_image(path) == COLOUR).all()


@pytest.mark.parametrize("name", ["a.tif", "a.jpg"])
def test_other_depths_are_named(tmp_path, name):
    """Fails if a TIFF of floats or a JPEG of 12 bits is called broken, as Pillow's own readers would have it."""
    path = tmp_path / name
    cv2.imwrite(str(path), COLOUR.astype(np.float32) if name == "a.tif" else COLOUR)
    content = bytearray(path.read_bytes())
    if name == "a.jpg":
        content[content.index(b"\xff\xc0") + 4] = 12
    path.write_bytes(content)
    with pytest.raises(InputError, match=f"{name}: (12|32) bits a channel; 8 or 16 are read"):
        read_image(path)


@pytest.mark.parametrize("kind", ["grey 8", "grey 16", "colour 8", "colour 16", "alpha 8", "big-endian 16", "LZW"])
def test_the_tiffs_that_cameras_write_are_read(tmp_path, kind):
    """Fails if the reader of headers knows fewer kinds than OpenCV, which reads the pixels."""
    path = tmp_path / "a.tif"
    grey, deep = COLOUR[..., 0], COLOUR.astype(np.uint16) * 257
    pixels = {"grey 8": grey, "grey 16": deep[..., 0], "colour 16": deep, "alpha 8": np.dstack([COLOUR, grey])}
    if kind == "big-endian 16":
        Image.frombytes("I;16B", (80, 60), deep[..., 0].astype(">u2").tobytes()).save(path)
    elif kind == "LZW":
        Image.fromarray(grey).save(path, compression="tiff_lzw")
    else:
        cv2.imwrite(str(path), pixels.get(kind, COLOUR))
    image = read_image(path, (80, 60))
    assert image.dtype == (np.uint16 if "16" in kind else np.uint8)
    assert (image == (deep if "16" in kind else COLOUR)[..., : 3 if image.ndim == 3 else 1].reshape(image.shape)).all()


def test_formats_that_campaigns_do_not_have_are_left_to_opencv(tmp_path):
    """`detect_markers.py` is for any images."""
    path = tmp_path / "a.bmp"
    cv2.imwrite(str(path), COLOUR)
    assert (detect_markers.read_image(path) == COLOUR).all()
    with pytest.raises(InputError, match="not a PNG, JPEG, TIFF or HEIC"):
        read_image(path)


def test_a_jpeg_with_data_behind_its_end_is_whole(tmp_path):
    """Phones append previews and depth maps to their photographs."""
    path = tmp_path / "a.jpg"
    cv2.imwrite(str(path), COLOUR)
    path.write_bytes(path.read_bytes() + bytes(5000))
    assert read_image(path).shape == (60, 80, 3)


@pytest.mark.parametrize(
    ("content", "words"),
    [
        (lambda png_file: png_file[:-30], "truncated"),
        (lambda png_file: b"", "not a PNG"),
        (lambda png_file: png(40_000, 40_000, b"\0"), "40000 x 40000"),
        (lambda png_file: png(63, 48, bytes(64) * 48), "63 x 48 pixels, but its camera has 64 x 48"),
    ],
)
def test_a_campaign_with_a_bad_capture_is_refused_from_its_first_and_last_bytes(tmp_path, content, words):
    campaign = load_campaign(write_campaign(tmp_path / "c"))
    check_captures(campaign)
    path = campaign.folder / "images/right/a.png"
    path.write_bytes(content(path.read_bytes()))
    with pytest.raises(InputError, match=f"captures.csv, capture right_a, column image: .*{words}"):
        check_captures(campaign)


def test_sizes_that_differ_within_a_camera_are_counted(tmp_path):
    """Fails if the user is sent from one photograph to the next, or told to change the camera's size for one of them."""
    campaign = load_campaign(write_campaign(tmp_path / "c"))
    for name in "ab":
        cv2.imwrite(str(campaign.folder / f"images/left/{name}.png"), np.zeros((64, 48 + (name == "b")), np.uint8))
    with pytest.raises(InputError, match=r"left_a.*48 x 64 pixels.*sizes 48 x 64 \(1\), 49 x 64 \(1\): take those"):
        check_captures(campaign)
    cv2.imwrite(str(campaign.folder / "images/left/b.png"), np.zeros((64, 48), np.uint8))
    with pytest.raises(InputError, match="all images of this camera are 48 x 64: write that as its width and height"):
        check_captures(campaign)
