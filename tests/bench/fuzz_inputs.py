"""Inputs for the fuzzer: valid files, broken by one to five edits. An input's number decides all that is drawn.

Text is edited by its tokens and lines, so that most of a file stays what its reader expects and errors lie deep; images and
other binary files by bytes, by numbers of two and four bytes, and by their blocks.
"""

import random
import re
import struct
import zlib
from collections.abc import Callable
from dataclasses import dataclass

MAX_EDITS = 5
TOKEN = re.compile(rb"[A-Za-z0-9_.+-]+")
ODD_TEXTS = (
    b"", b"0", b"-1", b"1", b"3.5", b"1e999", b"-1e-999", b"nan", b".nan", b".inf", b"inf", b"0x1F", b"1_000", b"010",
    b"1e5", b"9" * 5000, b"true", b"null", b"~", b"unknown", b"auto", b"fit", b"yes", b"2024-01-32", b"2024-01-01", b"12:30:45",
    b"[]", b"{}", b"[1, [2]]", b"{a: 1}", b"''", b'"', b"'", b"- ", b": ", b"? ", b"&a 1", b"*a", b"<<: *a", b"!!python/name:os",
    b"!!binary aGk=", b"!!set {a}", b"!!timestamp 1", b"!<x>", b"#", b",", b";", b"\t", b"\n", b"\r", b"\n\n  ", b"\0", b"\x1b[31m",
    b"\xff\xfe", b"\xef\xbb\xbf", "ü".encode(), "٣".encode(), "\u2028".encode(), "\U0001f600".encode(), b"\xed\xa0\x80",
    b"../../etc/passwd", b"/etc/passwd", b"a/b/c", b"images", b".", b"%s%n", b"{x}", b"a" * 300, b"[" * 500, b"{" * 500,
    b"<!DOCTYPE a [<!ENTITY b 'c'>]>", b"<a>", b"</a>", b"&lt;", b"&b;", b"]]>", b"<![CDATA[", b"(1,)", b"1j", b"b''", b"-" * 300,
    b"--- \n", b"...\n", b"%YAML 1.1\n---\n",
)  # fmt: skip
ODD_NUMBERS = (0, 1, 2, 3, 7, 8, 0x7F, 0x80, 0xFF, 0x100, 0x7FFF, 0x8000, 0xFFFF, 0x7FFFFFFF, 0x80000000, 0xFFFFFFFF)
LAYOUTS = ("B", ">H", "<H", ">I", "<I")


@dataclass(frozen=True)
class Inputs:
    """Broken files without end, each known by its number: valid ``files`` (bytes), and the edits that break them.

    kinds   of edits, functions; odd: what they put in
    repair  function that puts right what a reader checks first, such as checksums, in half of the inputs; or None
    """

    files: tuple
    kinds: tuple
    odd: tuple
    repair: Callable | None = None

    def drawn(self, number):
        """Return what makes the input of a number: (valid file, another one, edits, whether to repair)."""
        rng = random.Random(number)
        edits = [
            (rng.choice(self.kinds), rng.random(), rng.random(), rng.choice(self.odd), rng.randrange(256))
            for _ in range(rng.randint(1, MAX_EDITS))
        ]
        return rng.choice(self.files), rng.choice(self.files), edits, self.repair is not None and rng.random() < 0.5

    def made(self, file, other, edits, repaired):
        """Return the input, bytes."""
        for kind, where, to, odd, number in edits:
            file = kind(file, where, to, odd, number, other)
        return self.repair(file) if repaired else file


def fewer_edits(drawn):
    """Return what was drawn with one edit less, in each way."""
    file, other, edits, repaired = drawn
    return [(file, other, edits[:k] + edits[k + 1 :], repaired) for k in range(len(edits))]


def text_inputs(files):
    """Return Inputs of broken texts."""
    return Inputs(tuple(files), TEXT_EDITS, ODD_TEXTS)


def binary_inputs(files, repair=None):
    """Return Inputs of broken binary files."""
    return Inputs(tuple(files), BYTE_EDITS, ODD_NUMBERS, repair)


def _token(data, where, to, odd, number, other):
    """Put something odd in the place of a token."""
    found = list(TOKEN.finditer(data))
    if not found:
        return data + odd
    chosen = found[int(where * len(found))]
    return data[: chosen.start()] + odd + data[chosen.end() :]


def _other_token(data, where, to, odd, number, other):
    """Put another token of the file in the place of one: words that a reader knows, where they do not belong."""
    found = list(TOKEN.finditer(data))
    return _token(data, where, to, found[int(to * len(found))].group() if found else odd, number, other)


def _insert(data, where, to, odd, number, other):
    at = int(where * (len(data) + 1))
    return data[:at] + odd + data[at:]


def _line(data, where, to, odd, number, other):
    """Leave a line out, write it twice or many times, move it, or turn it in or out."""
    lines = data.splitlines(keepends=True)
    if not lines:
        return odd
    k, m = int(where * len(lines)), int(to * len(lines))
    line = lines[k]
    if number % 6 == 0:
        del lines[k]
    elif number % 6 == 1:
        lines.insert(m, line)
    elif number % 6 == 2:
        lines[k:k] = [line] * number
    elif number % 6 == 3:
        lines[k], lines[m] = lines[m], line
    elif number % 6 == 4:
        lines[k] = b" " * (number % 5) + line
    else:
        lines[k] = line.lstrip()
    return b"".join(lines)


def _byte(data, where, to, odd, number, other):
    at = int(where * len(data))
    return data[:at] + bytes([number]) + data[at + 1 :]


def _cut(data, where, to, odd, number, other):
    """Leave a piece out, or all from a place on."""
    at, end = sorted((int(where * len(data)), int(to * len(data))))
    return data[:at] if number < 64 else data[:at] + data[end:]


def _splice(data, where, to, odd, number, other):
    """Go on with another file from some place on."""
    return data[: int(where * len(data))] + other[int(to * len(other)) :]


def _number(data, where, to, odd, number, other):
    """Put an odd number of one, two or four bytes somewhere, most often near the head, where sizes and offsets are."""
    layout = LAYOUTS[number % len(LAYOUTS)]
    reach = min(len(data), 64) if number & 64 else min(len(data), 512) if number & 128 else len(data)
    at, size = int(where * reach), struct.calcsize(layout)
    return data[:at] + struct.pack(layout, odd % 256**size) + data[at + size :]


def _piece(data, where, to, odd, number, other):
    """Write a piece of the file twice, or many times."""
    at, end = sorted((int(where * len(data)), int(to * len(data))))
    return data[:end] + data[at:end] * (1 + number % 4) + data[end:]


TEXT_EDITS = (_token, _token, _token, _other_token, _other_token, _insert, _line, _line, _byte, _cut, _splice)
BYTE_EDITS = (_number, _number, _number, _byte, _byte, _cut, _piece, _splice)


def png_with_valid_checksums(data):
    """Return a PNG with the checksums that its chunks should have, so that its reader comes beyond them."""
    out, at = bytearray(data[:8]), 8
    while at + 12 <= len(data):
        (length,) = struct.unpack(">I", data[at : at + 4])
        end = at + 8 + length
        if end + 4 > len(data):
            break
        out += data[at:end] + struct.pack(">I", zlib.crc32(data[at + 4 : end]))
        at = end + 4
    return bytes(out) + data[at:]
