"""What a photograph's file says of itself: EXIF (CIPA DC-008), and the tables with which a JPEG was compressed.

Files are untrusted: whatever cannot be believed is left out and named in ``notes``; nothing here fails.
"""

import functools
import io
import math
import warnings
from collections import Counter

import numpy as np
import pandas as pd
from PIL import Image, TiffImagePlugin
from PIL.ExifTags import IFD, Base

from effects.own_tables import FACTORS
from inputs import heic

LONGEST_TEXT, MAX_NOTES = 64, 5
# name in the table: (tag, whether in EXIF's own directory, smallest and largest value that is believed)
NUMBERS = {
    "orientation": (Base.Orientation, False, 1, 8),
    "exposure_s": (Base.ExposureTime, True, 1e-7, 86_400),
    "iso": (Base.ISOSpeedRatings, True, 1, 1e7),
    "f_number": (Base.FNumber, True, 0.1, 1000),
    "focal_mm": (Base.FocalLength, True, 0.1, 10_000),
    "focal_35mm": (Base.FocalLengthIn35mmFilm, True, 1, 10_000),
}
TEXTS = {"make": Base.Make, "model": Base.Model}
FORMATS = ("JPEG", "PNG", TiffImagePlugin.TiffImageFile.format)  # the last is unknown until it is imported
JPEG = ("jpeg_quality", "jpeg_tables", "jpeg_sampling", "jpeg_brightness", "jpeg_colour")
SAMPLINGS = {factors: name for name, factors in FACTORS.items()}
FULL_FRAME_MM = math.hypot(36, 24)  # the diagonal to which focal lengths of other sensors are scaled
SENSORS_MM = (1.0, 100.0)  # diagonals that are believed
MM_OF_UNIT = {2: 25.4, 3: 10.0, 4: 1.0, 5: 1e-3}  # of EXIF's resolution in the sensor's plane
NOT_SAID = 0  # what EXIF writes into a number that is unknown


def a_few(paths):
    """Return the first, the middle and the last of some paths: one that was edited has lost what the others say."""
    return [paths[k] for k in sorted({0, len(paths) // 2, len(paths) - 1})]


def photo_facts(path):
    """Return a dict of what an image file says of itself, None where it says nothing or nothing that can be believed.

    ``format``; ``make``, ``model``; NUMBERS (seconds, ISO 12232, f-number, mm, mm for 36 x 24, or by the sensor's size where that
    is all that is said, EXIF's 1 to 8);
    ``jpeg_quality`` (libjpeg's, 1 to 100, with these tables or the nearest to them), ``jpeg_tables`` (``libjpeg``: exactly
    those, ``own``: the camera's), ``jpeg_sampling``, ``jpeg_brightness`` and ``jpeg_colour`` (64 steps in words, row by row);
    ``notes``, what was left out and why.
    """
    facts = dict.fromkeys(("format", *TEXTS, *NUMBERS, *JPEG))
    notes = []
    with warnings.catch_warnings(action="ignore"):
        try:
            if _is_heic(path):
                facts["format"], exif = "HEIC", Image.Exif()
                exif.load(heic.opened(path).info.get("exif") or b"")
                _read_exif(exif, facts, notes)
            else:
                with Image.open(path, formats=FORMATS) as image:
                    facts["format"] = "JPEG" if image.format == "MPO" else image.format
                    _read_jpeg(image, facts, notes)
                    _read_exif(image.getexif(), facts, notes)
        except Exception as error:  # of Pillow's many, on bytes that can be anything
            notes.append(f"EXIF can't be read ({type(error).__name__}): ignored")
    return facts | {"notes": "; ".join(notes)}


def _is_heic(path):
    with open(path, "rb") as file:
        return heic.is_heic(file.read(32))


def _read_exif(exif, facts, notes):
    """Put what can be believed of a PIL.Image.Exif into ``facts``, what can't into ``notes``."""
    own = exif.get_ifd(IFD.Exif)
    for name, tag in TEXTS.items():
        facts[name] = _text(exif.get(tag), name, notes)
    for name, (tag, in_own, low, high) in NUMBERS.items():
        facts[name] = _number((own if in_own else exif).get(tag), name, low, high, notes)
    if facts["focal_mm"] and not facts["focal_35mm"]:
        diagonal_mm = _sensor_diagonal_mm(own)
        facts["focal_35mm"] = diagonal_mm and facts["focal_mm"] * FULL_FRAME_MM / diagonal_mm


def _sensor_diagonal_mm(own):
    """Return the sensor's diagonal by the resolution in its plane that EXIF says, None where none can be believed."""
    unit = MM_OF_UNIT.get(own.get(Base.FocalPlaneResolutionUnit, 2))
    tags = ((Base.ExifImageWidth, Base.FocalPlaneXResolution), (Base.ExifImageHeight, Base.FocalPlaneYResolution))
    sides = [(_number(own.get(n), "", 1, 1e6, []), _number(own.get(per), "", 1e-3, 1e9, [])) for n, per in tags]
    if unit is None or not all(map(all, sides)):
        return None
    diagonal_mm = math.hypot(*(pixels / per * unit for pixels, per in sides))
    return diagonal_mm if SENSORS_MM[0] <= diagonal_mm <= SENSORS_MM[1] else None


def _text(value, name, notes):
    """Return a text without blanks around it, None where there is none that can be shown."""
    if value is None:
        return None
    text = "".join(c for c in value if c.isprintable()).strip() if isinstance(value, str) else None
    if text is None or len(text) > LONGEST_TEXT:
        notes.append(f"{name} is no text of up to {LONGEST_TEXT} characters: ignored")
        return None
    return text or None


def _number(value, name, low, high, notes):
    """Return a number within [low, high], None where there is none."""
    value = value[0] if isinstance(value, tuple) and value else value
    if value is None:
        return None
    try:
        number = math.nan if isinstance(value, str | bytes) else float(value)
    except (TypeError, ValueError, ArithmeticError):
        number = math.nan
    if low <= number <= high:
        return number
    if number != NOT_SAID:
        notes.append(f"{name} is not from {low:g} to {high:g}: ignored")
    return None


def _read_jpeg(image, facts, notes):
    """Put a JPEG's quantisation tables and chroma sampling into ``facts``."""
    if facts["format"] != "JPEG":
        return
    try:
        tables = [np.array(image.quantization[layer[3]], int) for layer in image.layer[:2]]
        sampling, rest = np.divmod(*(np.array(image.layer[k][1:3]) for k in (0, -1)))
        if not all(len(table) == 64 and (table > 0).all() for table in tables) or rest.any() or not sampling.all():
            raise ValueError
    except (KeyError, IndexError, TypeError, ValueError):
        notes.append("its quantisation tables can't be read: ignored")
        return
    quality, exact = libjpeg_quality(tables)
    facts |= {"jpeg_quality": quality, "jpeg_tables": "libjpeg" if exact else "own"}
    facts |= {name: " ".join(map(str, table)) for name, table in zip(JPEG[3:], tables, strict=False)}
    grey, factors = len(image.layer) == 1, tuple(sampling.tolist())
    facts["jpeg_sampling"] = "grey" if grey else SAMPLINGS.get(factors, "{}x{}".format(*factors))


def libjpeg_quality(tables):
    """Return (quality 1 to 100 whose libjpeg tables are nearest to these, whether they are exactly these).

    tables  brightness and, in colour, colour: (64,) each; near is the mean difference of their logarithms
    """
    steps = np.log(np.concatenate(tables))
    known = _libjpeg_tables()[:, : len(tables)].reshape(100, -1)
    distance = np.abs(np.log(known) - steps).mean(axis=1)
    best = int(np.argmin(distance))
    return best + 1, bool(distance[best] < 1e-9)


@functools.cache
def _libjpeg_tables():
    """Return libjpeg's tables (100, 2, 64), brightness and colour, of qualities 1 to 100, read from files it wrote."""
    found = []
    for quality in range(1, 101):
        file = io.BytesIO()
        Image.new("RGB", (8, 8)).save(file, "JPEG", quality=quality)
        with Image.open(file) as image:
            found.append([image.quantization[0], image.quantization[1]])
    return np.array(found, float)


def focal_px(focal_35mm, size):
    """Return the focal length in pixels of an image (width, height) from EXIF's for 36 x 24 mm: diagonals are compared."""
    return focal_35mm * math.hypot(*size) / FULL_FRAME_MM


def said_in_words(rows, size):
    """Return sentences on what a camera's files say of themselves, none where they say nothing.

    rows  dicts of ``photo_facts`` or of inputs.tables.FILES, each with its ``capture``; size (width, height) in pixels
    """
    rows = [{k: None if pd.isna(v) or v == "" else v for k, v in row.items()} for row in rows]
    lines = []
    makers = Counter(" ".join(filter(None, (row["make"], row["model"]))) for row in rows)
    makers.pop("", None)
    if len(makers) > 1:
        listed = ", ".join(f"{name} ({count})" for name, count in makers.most_common())
        lines.append(f"EXIF names several cameras: {listed}; the photographs of one camera belong together")
    settings = [
        _range(rows, "exposure_s", "exposed {} s", _of_a_second), _range(rows, "iso", "ISO {}"),
        _range(rows, "f_number", "f/{}"), _range(rows, "focal_mm", "{} mm"),
        _range(rows, "focal_35mm", "{} px by the focal length for 36 x 24 mm", lambda f: f"{focal_px(f, size):.0f}"),
    ]  # fmt: skip
    said = [*([next(iter(makers))] if len(makers) == 1 else []), *filter(None, settings)]
    if said:
        lines.append(f"EXIF: {', '.join(said)}")
    if len({row["focal_mm"] for row in rows if row["focal_mm"]}) > 1:
        lines.append("EXIF has several focal lengths: a zoom changes the intrinsics, so use photographs of one")
    turned = sum((row["orientation"] or 1) > 1 for row in rows)
    if turned:
        lines.append(f"EXIF notes {turned} photographs as turned: pixels are read along the sensor's axes all the same")
    if any(row["jpeg_quality"] for row in rows):
        tables = {"own": "the camera's own tables, nearest to libjpeg's of", "libjpeg": "libjpeg's tables of"}
        kinds = sorted({tables[row["jpeg_tables"]] for row in rows if row["jpeg_tables"]})
        samplings = sorted({row["jpeg_sampling"] for row in rows if row["jpeg_sampling"]})
        lines.append(f"JPEG: {' or '.join(kinds)} {_range(rows, 'jpeg_quality', 'quality {}')}, {', '.join(samplings)}")
    return lines + [f"capture {row['capture']}: {row['notes']}" for row in rows if row["notes"]][:MAX_NOTES]


def _range(rows, name, words, shown="{:g}".format):
    """Return the smallest and largest of a number that files say, put into words; None where none says it."""
    values = [row[name] for row in rows if row[name]]
    return words.format(" to ".join(dict.fromkeys(shown(v) for v in (min(values), max(values))))) if values else None


def _of_a_second(seconds):
    return f"1/{1 / seconds:.0f}" if seconds < 0.3 else f"{seconds:g}"
