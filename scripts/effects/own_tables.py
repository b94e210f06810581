"""A JPEG's own tables and sampling, as its file has them, where they are not those of a quality of libjpeg.

They are (tables, each 64 steps row by row, brightness first; sampling). Source: ITU-T T.81; rounding is libjpeg's.
"""

import io
import struct

import cv2
import numpy as np

BLOCK = 8
# Pixels across and down of which colour is stored once; others are named by them, as in 4x2
FACTORS = {"4:4:4": (1, 1), "4:2:2": (2, 1), "4:2:0": (2, 2), "4:4:0": (1, 2), "4:1:1": (4, 1)}
OF_QUALITIES = ((1, 1), (2, 2))
# ITU-T T.871: Y, Cb, Cr of red, green, blue
TO_YCC = np.array([[0.299, 0.587, 0.114], [-0.168736, -0.331264, 0.5], [0.5, -0.418688, -0.081312]], np.float32)
# The same in fixed point as libjpeg has it, exact in float32: with half a level, and the 128 about which colours lie
TO_STORED = np.column_stack([np.rint(TO_YCC.astype(float) * 2**16), [2**15, *2 * [2**23 + 2**15 - 1]]]) / 2**16
TABLE, FRAME, CODES, SCAN = 0xDB, 0xC0, 0xC4, 0xDA  # markers


def factors_of(sampling):
    """Return (pixels across, down) of which colour is stored once, of a sampling as a file's facts name it."""
    return FACTORS.get(sampling) or ((1, 1) if sampling == "grey" else tuple(map(int, sampling.split("x"))))


def own_of(facts):
    """Return the own tables and sampling in what a file says (inputs.photo_facts), None where a quality of libjpeg has them."""
    texts = [facts[key] for key in ("jpeg_brightness", "jpeg_colour")]
    steps = tuple(tuple(map(int, text.split())) for text in texts if isinstance(text, str) and text)
    is_own = facts["jpeg_tables"] == "own" or factors_of(facts["jpeg_sampling"]) not in OF_QUALITIES
    return (steps, facts["jpeg_sampling"]) if steps and is_own else None


def steps_of(own):
    """Return own tables of (brightness, colour), each (8, 8) float32, the same where there is one."""
    steps = [np.reshape(s, (BLOCK, BLOCK)).astype(np.float32) for s in own[0]]
    return steps[0], steps[-1]


def rounds_in_turn(across, down):
    """Return whether libjpeg rounds the means of so many pixels up and down in turn, column by column; else halves go up."""
    return across == 2 and down <= 2


def compressed_as_own(pixels, own):
    """Return uint8 pixels (H, W, 1 or 3; red first) after JPEG with own tables and sampling.

    Pillow's encoder has few samplings: each plane is encoded by itself, and all are scans of one file.
    """
    from PIL import Image  # only here: what is exported of an effect runs without it

    def encoded(plane, steps):
        file = io.BytesIO()
        Image.fromarray(plane).save(file, "JPEG", qtables=[steps.astype(int).ravel().tolist()])
        return file.getvalue()

    brightness, colour = steps_of(own)
    factors = factors_of(own[1]) if pixels.shape[2] == 3 else (1, 1)
    planes = [encoded(p, colour if k else brightness) for k, p in enumerate(_stored(pixels, *factors))]
    return np.asarray(Image.open(io.BytesIO(_of_planes(planes, *factors, pixels.shape)))).reshape(pixels.shape)


def _stored(pixels, across, down):
    """Return the planes, uint8, of pixels (H, W, 1 or 3): brightness, and colours' means over so many pixels."""
    if pixels.shape[2] == 1:
        return [np.ascontiguousarray(pixels[..., 0])]
    y, *colours = cv2.split(cv2.transform(pixels.astype(np.float32), TO_STORED).astype(np.uint8))
    return [y, *(_means(p, across, down) for p in colours)]


def _means(plane, across, down):
    """Return the means of a plane's blocks of pixels, its last row and column again where it has no whole ones."""
    rows, columns = plane.shape
    full = np.pad(plane, ((0, -rows % down), (0, -columns % (BLOCK * across))), mode="edge").astype(np.uint16)
    sums = sum(full[i::down, j::across] for i in range(down) for j in range(across))
    half = across * down // 2
    if rounds_in_turn(across, down):
        half = half - (np.arange(sums.shape[1]) % 2 == 0)
    return ((sums + half) // (across * down)).astype(np.uint8)


def _of_planes(files, across, down, shape):
    """Return the bytes of a JPEG of shape (H, W, C) whose scans are those of ``files``, each the bytes of a plane's."""
    count, tables, scans = len(files), [], []
    for k, file in enumerate(files):
        for segment in _segments(file):
            if segment[1] == TABLE:
                tables.append(segment[:4] + bytes([segment[4] | k]) + segment[5:])
            elif segment[1] == SCAN:
                scans.append(segment[:5] + bytes([k + 1]) + segment[6:])
            elif segment[1] == CODES:
                scans.append(segment)
    planes = [bytes([k + 1, 0x11 if k else across << 4 | down, k]) for k in range(count)]
    frame = struct.pack(">BBHBHHB", 0xFF, FRAME, 8 + 3 * count, 8, *shape[:2], count)
    return b"".join([b"\xff\xd8", *tables, frame, *planes, *scans, b"\xff\xd9"])


def _segments(file):
    """Yield the segments of a JPEG of one scan, bytes from the marker on; the last is the scan."""
    at = 2
    while file[at + 1] != SCAN:
        end = at + 2 + int.from_bytes(file[at + 2 : at + 4])
        yield file[at:end]
        at = end
    yield file[at:-2]
