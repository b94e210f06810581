"""Rows of an untrusted CSV table, as text, and the numbers in them; each mistake names file, row and column."""

import csv
import math
import re

from rig.errors import InputError

NUMBER = r"[+-]?(\d+\.?\d*|\.\d+)([eE][+-]?\d+)?"
LARGEST_ROWS = 200_000
LARGEST_TABLE_BYTES = 64_000_000


def read_rows(path, required, optional=()):
    """Return a CSV's rows as dicts of text; raise InputError for missing, unknown or doubled columns, ragged rows."""
    if not path.is_file():
        raise InputError(f"{path}: no such file")
    if path.stat().st_size > LARGEST_TABLE_BYTES:
        raise InputError(f"{path}: {path.stat().st_size} bytes; at most {LARGEST_TABLE_BYTES} are read")
    try:
        with open(path, newline="", encoding="utf-8-sig") as file:
            reader = csv.reader(file, strict=True)
            header = next(reader, [])
            for name in required:
                if name not in header:
                    raise InputError(f"{path}, row 1: column {name!r} is missing")
            for name in header:
                if name not in (*required, *optional):
                    raise InputError(
                        f"{path}, row 1: unknown column {name!r}; known: {', '.join((*required, *optional))}"
                    )
                if header.count(name) > 1:
                    raise InputError(f"{path}, row 1: column {name!r} stands twice")
            rows = []
            for number, row in enumerate(reader, start=2):
                if not row:
                    continue
                if len(row) != len(header):
                    raise InputError(f"{path}, row {number}: {len(row)} values for {len(header)} columns")
                if len(rows) >= LARGEST_ROWS:
                    raise InputError(f"{path}: more than {LARGEST_ROWS} rows")
                rows.append(dict(zip(header, row, strict=True)) | {"row": number})
    except (UnicodeDecodeError, csv.Error) as error:
        raise InputError(f"{path}: not a CSV table in UTF-8 ({error})") from None
    return rows


def number(path, row, column, low=-math.inf, high=math.inf, whole=False):
    """Return a row's number within [low, high]; raise InputError naming file, row, column and value."""
    text = row.get(column, "").strip()
    good = re.fullmatch(r"[+-]?\d{1,18}" if whole else NUMBER, text, re.ASCII) is not None
    if good:
        value = int(text) if whole else float(text)
        good = math.isfinite(value) and low <= value <= high
    if not good:
        kind = "a whole number" if whole else "a number"
        limits = "" if (low, high) == (-math.inf, math.inf) else f" from {low:g} to {high:g}"
        raise InputError(f"{path}, row {row['row']}, column {column}: {text!r} is not {kind}{limits}")
    return value
