"""Open images from strangers: size and completeness are checked before anything is decoded."""

import struct
import zlib
from pathlib import Path

import cv2
import numpy as np

from rig.errors import InputError

LARGEST_PIXELS = 100_000_000


def read_header(path):
    """Return (width, height, bits, channels) from the header of a PNG, JPEG or TIFF, nothing decoded.

    Raises InputError for other files and for broken headers.
    """
    path = Path(path)
    if not path.is_file():
        raise InputError(f"{path}: no such image")
    with open(path, "rb") as file:
        head = file.read(32)
        try:
            if head[:8] == b"\x89PNG\r\n\x1a\n":
                width, height, bits, colour = struct.unpack(">IIBB", head[16:26])
                return width, height, bits, {0: 1, 2: 3, 3: 3, 4: 2, 6: 4}[colour]
            if head[:2] == b"\xff\xd8":
                return _jpeg_header(file)
            if head[:4] in (b"II*\0", b"MM\0*"):
                return _tiff_header(file, "<" if head[:2] == b"II" else ">")
        except (struct.error, KeyError, IndexError):
            raise InputError(f"{path}: its header is broken or cut off") from None
    raise InputError(f"{path}: not a PNG, JPEG or TIFF image")


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


def _tiff_header(file, order):
    file.seek(4)
    (offset,) = struct.unpack(order + "I", file.read(4))
    file.seek(offset)
    (entries,) = struct.unpack(order + "H", file.read(2))
    tags = {258: 1, 277: 1}
    for _ in range(entries):
        tag, kind, count, value = struct.unpack(order + "HHI4s", file.read(12))
        if kind == 3 and count <= 2:
            tags[tag] = struct.unpack(order + "H", value[:2])[0]
        elif kind == 4 and count == 1:
            tags[tag] = struct.unpack(order + "I", value)[0]
        elif tag == 258:
            here = file.tell()
            file.seek(struct.unpack(order + "I", value)[0])
            tags[258] = struct.unpack(order + "H", file.read(2))[0]
            file.seek(here)
    return tags[256], tags[257], tags[258], tags[277]


def check_complete(path):
    """Raise InputError where a PNG or JPEG ends too early or a PNG's chunk is damaged."""
    data = Path(path).read_bytes()
    if data[:4] == b"\x89PNG":
        position, ended = 8, False
        while position + 12 <= len(data):
            (length,) = struct.unpack(">I", data[position : position + 4])
            end = position + 12 + length
            if end > len(data):
                break
            body = data[position + 4 : end - 4]
            if zlib.crc32(body) != struct.unpack(">I", data[end - 4 : end])[0]:
                raise InputError(f"{path}: damaged PNG (checksum of the chunk at byte {position} is wrong)")
            ended = body[:4] == b"IEND"
            position = end
        if not ended:
            raise InputError(f"{path}: truncated PNG ({len(data)} bytes, no end)")
    elif data[:2] == b"\xff\xd8" and b"\xff\xd9" not in data[-64:]:
        raise InputError(f"{path}: truncated JPEG ({len(data)} bytes, no end)")


def read_image(path, size=None):
    """Return the pixels of an image as OpenCV gives them: uint8 or uint16, (H, W) or (H, W, 3) in BGR order.

    size (width, height) that is declared for it. Raises InputError for another size, other depths than 8 and 16
    bits, too many pixels, truncation.
    """
    width, height, bits, _ = read_header(path)
    if width * height > LARGEST_PIXELS or width < 1 or height < 1:
        raise InputError(f"{path}: {width} x {height} pixels; at most {LARGEST_PIXELS:,} pixels are read")
    if size is not None and (width, height) != tuple(size):
        raise InputError(f"{path}: {width} x {height} pixels, but its camera has {size[0]} x {size[1]}")
    if bits not in (1, 2, 4, 8, 16):
        raise InputError(f"{path}: {bits} bits a channel; 8 or 16 are read")
    check_complete(path)
    image = cv2.imdecode(
        np.fromfile(path, np.uint8), cv2.IMREAD_ANYDEPTH | cv2.IMREAD_COLOR | cv2.IMREAD_IGNORE_ORIENTATION
    )
    if image is None or image.dtype not in (np.uint8, np.uint16):
        raise InputError(f"{path}: the image can't be decoded")
    return image
