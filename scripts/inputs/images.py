"""Open untrusted images: size and completeness are checked before anything is decoded."""

import contextlib
import struct
import warnings
import zlib
from collections import Counter
from pathlib import Path

import cv2
import numpy as np
from PIL.ExifTags import Base
from PIL.TiffImagePlugin import ImageFileDirectory_v2

from inputs import heic
from inputs.videos import NO_VIDEO, is_video
from rig.errors import InputError

LARGEST_PIXELS = 100_000_000
UNPACKED_AT_ONCE = 1 << 20
PNG_END = b"\0\0\0\0IEND\xaeB`\x82"
PNG_START = b"\x89PNG\r\n\x1a\n"
TIFF_STARTS, TIFF_SHORT = (b"II*\0", b"MM\0*"), 3
PNG_CHANNELS = {0: 1, 2: 3, 3: 1, 4: 2, 6: 4}  # samples a pixel by colour type; a palette's index is one
HOW = cv2.IMREAD_ANYDEPTH | cv2.IMREAD_ANYCOLOR | cv2.IMREAD_IGNORE_ORIENTATION


class OtherSize(InputError):
    """An image whose ``size`` (width, height) is not its camera's."""

    def __init__(self, path, size, declared):
        super().__init__(f"{path}: {size[0]} x {size[1]} pixels, but its camera has {declared[0]} x {declared[1]}")
        self.size = size


def read_header(path):
    """Return (width, height, bits, channels) from the header of a PNG, JPEG, TIFF or HEIC, nothing decoded.

    Along the sensor's axes, however the file says it was held. Raises InputError for other files and for broken headers.
    """
    path = Path(path)
    if not path.is_file():
        raise InputError(f"{path}: no such image")
    with open(path, "rb") as file:
        head = file.read(32)
        # Not by Pillow's Image.open: it calls a PNG of 3 x 16 bits "RGB", refuses a JPEG of 12 bits or a TIFF of floats as no
        # image, without their size, and unpacks a PNG's texts first. Its reader of TIFF's tags does serve.
        try:
            if head[:8] == PNG_START:
                width, height, bits, colour = struct.unpack(">IIBB", head[16:26])
                return width, height, bits, 3 if colour == 3 else PNG_CHANNELS[colour]
            if head[:2] == b"\xff\xd8":
                return _jpeg_header(file)
            if head[:4] in TIFF_STARTS:
                return _tiff_header(file)
        except (struct.error, LookupError, TypeError, SyntaxError):
            raise InputError(f"{path}: its header is broken or cut off") from None
    if heic.is_heic(head):
        return heic.header_of(path)
    if is_video(head):
        raise InputError(f"{path}: {NO_VIDEO}")
    raise InputError(f"{path}: not a PNG, JPEG, TIFF or HEIC image")


def _jpeg_header(file):
    file.seek(2)
    while True:
        marker = file.read(2)
        while marker == b"\xff\xff":
            marker = b"\xff" + file.read(1)
        if len(marker) < 2 or marker[0] != 0xFF:
            raise IndexError
        code = marker[1]
        if code in (0x01, *range(0xD0, 0xD8)):
            continue
        (length,) = struct.unpack(">H", file.read(2))
        if 0xC0 <= code <= 0xCF and code not in (0xC4, 0xC8, 0xCC):
            bits, height, width, channels = struct.unpack(">BHHB", file.read(6))
            return width, height, bits, channels
        file.seek(length - 2, 1)


def _tiff_header(file):
    file.seek(0)
    tags = ImageFileDirectory_v2(file.read(8))
    with warnings.catch_warnings(action="ignore"):  # a tag that is cut off is missing, and that is said
        file.seek(tags.next)
        tags.load(file)
    width, height, channels = tags[Base.ImageWidth], tags[Base.ImageLength], tags.get(Base.SamplesPerPixel, 1)
    bits = tags.get(Base.BitsPerSample, (1,))[0]
    if not all(isinstance(v, int) for v in (width, height, bits, channels)):
        raise KeyError
    return width, height, bits, channels


def check_complete(path, data):
    """Raise InputError where a PNG's or JPEG's data (bytes) ends too early or a PNG is damaged.

    OpenCV fills what is missing with black or grey and says nothing.
    """
    if data[:8] == PNG_START:
        _check_png(path, data)
    elif data[:2] == b"\xff\xd8":
        # in coded data 0xFF is followed by 0 or a restart marker: this one is the end of the image
        scan = data.find(b"\xff\xda")
        if scan < 0 or data.find(b"\xff\xd9", scan) < 0:
            raise InputError(f"{path}: truncated JPEG ({len(data)} bytes, no end)")


def _check_png(path, data):
    position, pixels = 8, []
    while position + 12 <= len(data):
        (length,) = struct.unpack(">I", data[position : position + 4])
        end = position + 12 + length
        if end > len(data):
            break
        kind, body = data[position + 4 : position + 8], data[position + 4 : end - 4]
        if zlib.crc32(body) != struct.unpack(">I", data[end - 4 : end])[0]:
            raise InputError(f"{path}: damaged PNG (checksum of the chunk at byte {position} is wrong)")
        if kind == b"IEND":
            break
        if kind == b"IDAT":
            pixels.append(body[4:])
        position = end
    else:
        raise InputError(f"{path}: truncated PNG ({len(data)} bytes, no end)")
    if data[position + 4 : position + 8] != b"IEND":
        raise InputError(f"{path}: truncated PNG ({len(data)} bytes, no end)")
    if not _holds_all_rows(data, pixels):
        raise InputError(f"{path}: damaged PNG (its rows are not complete)")


def _holds_all_rows(data, pixels):
    """Return whether a PNG's compressed chunks unpack to as many bytes as its rows need, or to their proper end."""
    width, height, bits, colour, _, _, interlaced = struct.unpack(">IIBBBBB", data[16:29])
    needed = height * (1 + -(-width * bits * PNG_CHANNELS[colour] // 8))
    unpacker, unpacked = zlib.decompressobj(), 0
    try:
        for chunk in pixels:
            while chunk and unpacked < needed:
                unpacked += len(unpacker.decompress(chunk, UNPACKED_AT_ONCE))
                chunk = unpacker.unconsumed_tail
    except zlib.error:
        return False
    return unpacker.eof if interlaced else unpacked >= needed


def check_header(path, size=None):
    """Return (width, height) after checking what the header says against ``size`` and against what is read at all."""
    width, height, bits, _ = read_header(path)
    if width * height > LARGEST_PIXELS or width < 1 or height < 1:
        raise InputError(f"{path}: {width} x {height} pixels; at most {LARGEST_PIXELS:,} pixels are read")
    if size is not None and (width, height) != tuple(size):
        raise OtherSize(path, (width, height), size)
    if bits not in (1, 2, 4, 8, 16):
        raise InputError(f"{path}: {bits} bits a channel; 8 or 16 are read")
    return width, height


def check_captures(campaign):
    """Raise InputError for the first capture of an inputs.campaign.Campaign whose header or end is wrong.

    Cheap enough for every start: a failing job would take its earlier results away. All pixels are checked when they
    are read.
    """
    table = campaign.folder / campaign.file.captures
    for c in campaign.captures.itertuples():
        camera = campaign.file.cameras[c.camera]
        path = campaign.folder / c.image
        try:
            check_header(path, (camera.width, camera.height))
            if not _ends_well(path):
                check_complete(path, path.read_bytes())
        except OtherSize as error:
            mine = campaign.captures[campaign.captures.camera == c.camera]
            advice = advice_on_sizes([campaign.folder / image for image in mine.image], error.size)
            raise InputError(f"{table}, capture {c.capture}, column image: {error}; {advice}") from None
        except InputError as error:
            raise InputError(f"{table}, capture {c.capture}, column image: {error}") from None


def advice_on_sizes(paths, found):
    """Return what to do about a camera's images at ``paths``, one of which has the size ``found`` and not the declared one."""
    sizes = Counter()
    for path in paths:
        with contextlib.suppress(InputError):  # what is no image is said when its turn comes
            sizes[read_header(path)[:2]] += 1
    if len(sizes) == 1:
        return f"all images of this camera are {found[0]} x {found[1]}: write that as its width and height in campaign.yaml"
    listed = ", ".join(f"{width} x {height} ({count})" for (width, height), count in sizes.most_common())
    return (
        f"this camera's images have the sizes {listed}: take those of one size, neither cropped, scaled nor turned by a "
        "program, and describe others as another camera's"
    )


def _ends_well(path):
    """Return whether a file's last bytes are the end of a PNG or JPEG: it was not cut off. Others have no end to see."""
    with open(path, "rb") as file:
        head = file.read(32)
        if head[:2] in (b"II", b"MM") or heic.is_heic(head):
            return True
        file.seek(max(path.stat().st_size - 64, 0))
        tail = file.read()
    return tail.endswith(PNG_END) or b"\xff\xd9" in tail


def read_image(path, size=None):
    """Return the pixels of an image as OpenCV has them: uint8 or uint16, (H, W) where grey, else (H, W, 3) BGR.

    size (width, height) that is declared for it. As the sensor saw it: no note of how the camera was held is applied.
    Raises InputError for another size, other depths than 8 and 16 bits, too many pixels, truncation, nothing decoded.
    """
    width, height = check_header(path, size)
    data = Path(path).read_bytes()
    check_complete(path, data)
    image = heic.decode(path) if heic.is_heic(data[:32]) else decode(path, data)
    if image.shape[:2] != (height, width):
        raise InputError(f"{path}: the image can't be decoded")
    return image


def _not_turned(data):
    """Return the bytes of a TIFF whose note of how it was held says upright: OpenCV turns it, whatever it is told."""
    order, out = "<" if data[:2] == b"II" else ">", bytearray(data)
    (at,) = struct.unpack_from(f"{order}I", data, 4)
    (count,) = struct.unpack_from(f"{order}H", data, at)
    for entry in range(at + 2, at + 2 + 12 * count, 12):
        if struct.unpack_from(f"{order}H", data, entry)[0] == Base.Orientation:
            struct.pack_into(f"{order}HHIHH", out, entry, Base.Orientation, TIFF_SHORT, 1, 1, 0)
    return bytes(out)


def decode(path, data):
    """Return the pixels in the bytes of an image of any format that OpenCV knows, as read_image gives them."""
    if data[:4] in TIFF_STARTS:
        try:
            data = _not_turned(data)
        except struct.error:
            raise InputError(f"{path}: its header is broken or cut off") from None
    try:
        image = cv2.imdecode(np.frombuffer(data, np.uint8), HOW) if data else None
    except cv2.error:
        image = None
    if image is None or image.dtype not in (np.uint8, np.uint16):
        raise InputError(f"{path}: the image can't be decoded")
    return image


def is_checked(path):
    """Return whether a file begins as the formats whose headers are read here do: PNG, JPEG, TIFF, HEIC."""
    with open(path, "rb") as file:
        head = file.read(32)
    known = head[:8] == PNG_START or head[:2] == b"\xff\xd8" or head[:4] in TIFF_STARTS
    return known or heic.is_heic(head)
