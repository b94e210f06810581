"""Turn a folder of photographs into a campaign: find the board or the markers, and write campaign.yaml and the tables.

    python scripts/start_campaign.py FOLDER --square-mm 25
    python scripts/start_campaign.py FOLDER --marker-mm 50

--square-mm is the printed side of a square, --marker-mm that of a marker, for grids and for markers that lie loose on a table:
where these lie is estimated. Measure it on the print. What was guessed has a comment in campaign.yaml. Photographs stay as
they are.
"""

import argparse
import csv
import io
import json
import logging
import re
import shlex
from dataclasses import replace
from pathlib import Path

import numpy as np

import job
from inputs.campaign import load_campaign
from inputs.images import check_captures
from inputs.photo_facts import focal_px
from rig.errors import InputError
from rig.words import with_error
from start.loose import named
from start.patterns import find_pattern, loose_pattern
from start.photographs import by_camera, look_through

log = logging.getLogger("twingap")

RIGS = Path(__file__).resolve().parents[1] / "config/rigs"
MIN_VIEWS = 3  # of a board, by one camera: fewer tell no intrinsics
MAX_NAMED = 20
HEADER = """\
# {about}
# Written by start_campaign.py: lines with a comment were guessed; check them. The format: docs/campaign-format.md
schema: 1
name: {name}
origin: camera
"""
PHOTOGRAPHED = """\
tolerance: unknown # the photographs were taken by hand
light: unknown
exposure: auto
white_balance: auto
reflectance: unknown
"""
IN_TABLE = ("code_m", "plate_m")
CAMERA = """\
  {name}: # {about}
    width: {width}
    height: {height}
    fx: null # unknown: fitted from the photographs{focal}
    fy: null
    cx: null
    cy: null
"""


def start_campaign(folder, square_mm, marker_mm=None):
    """Write campaign.yaml, captures.csv and, of plates and loose markers, markers.csv into a folder of photographs.

    square_mm, marker_mm  printed sides of a square and of a marker, None where they are not known
    Returns (Pattern, {camera: photographs}, [(path, why it is left out)]). Raises InputError where nothing usable is found
    or the folder is a campaign; nothing is left behind then.
    """
    folder = Path(folder)
    for name in ("campaign.yaml", "captures.csv", "markers.csv"):
        if (folder / name).exists():
            raise InputError(f"{folder / name}: is there already; move it away to start anew")
    for name, given in (("square", square_mm), ("marker", marker_mm)):
        if given is not None and not 0.1 <= given <= 10_000:
            raise InputError(f"--{name}-mm {given:g}: allowed are 0.1 to 10000")
    photographs, left_out = look_through(folder)
    if not photographs:
        raise InputError(f"{folder}: no usable photograph; {left_out[0][0]}: {left_out[0][1]}")
    pattern = find_pattern(
        [p.grey for p in photographs],
        square_mm and square_mm / 1000,
        marker_mm and marker_mm / 1000,
        sorted(RIGS.glob("ladders.yaml")),
        lambda found: _loose(found, photographs, marker_mm or square_mm),
    )
    shown = {p.path for p, seen in zip(photographs, pattern.seen, strict=True) if seen}
    what = "the board" if pattern.board else "enough of the markers"
    left_out += [(p.path, f"{what} was not found in it") for p in photographs if p.path not in shown]
    cameras = {}
    for name, group in by_camera([p for p in photographs if p.path in shown]).items():
        least = MIN_VIEWS if pattern.board else 1
        if len(group) >= least:
            cameras[name] = group
            continue
        size = "{} x {}".format(*group[0].size)
        left_out += [
            (p.path, f"{size} pixels, with {len(group)} usable; {least} of one camera and size are needed")
            for p in group
        ]
    if not cameras:
        path, why = left_out[-1]
        raise InputError(f"{folder}: no camera with enough photographs; {path}: {why}")
    _write(folder, pattern, cameras)
    return pattern, cameras, left_out


def _loose(found, photographs, marker_mm):
    """Return the Pattern of loose markers: photographs of one camera share what is estimated of it."""
    groups = list(by_camera(photographs).values())
    camera = {p.path: k for k, group in enumerate(groups) for p in group}
    sizes = [group[0].grey.shape[::-1] for group in groups]
    focals = {k: focal_px(f, sizes[k]) / max(sizes[k]) for k, group in enumerate(groups) if (f := _focal_35mm(group))}
    pattern = loose_pattern(
        found, [p.grey for p in photographs], sizes, [camera[p.path] for p in photographs],
        marker_mm and marker_mm / 1000, focals,
    )  # fmt: skip
    scales = {k: max(group[0].size) / max(sizes[k]) for k, group in enumerate(groups)}
    of_camera = {(g[0].maker, g[0].size): np.multiply(pattern.focals[k], scales[k]) for k, g in enumerate(groups)}
    return replace(pattern, focals=of_camera)


def _focal_35mm(group):
    """Return the focal length, mm of a 35 mm film, that EXIF has of a camera's photographs; None where it has none or several."""
    focals = {p.facts["focal_35mm"] for p in group if p.facts["focal_35mm"]}
    return focals.pop() if len(focals) == 1 else None


def _write(folder, pattern, cameras):
    """Write the campaign's files; take them away again where they are none."""
    texts = {"campaign.yaml": _description(folder, pattern, cameras), "captures.csv": _captures(cameras)}
    if pattern.markers is not None:
        texts["markers.csv"] = pattern.markers.to_csv(index=False, lineterminator="\n")
    try:
        for name, text in texts.items():
            with job.write_atomically(folder / name) as file:
                file.write(text)
        check_captures(load_campaign(folder))
    except BaseException:
        for name in texts:
            (folder / name).unlink(missing_ok=True)
        raise


def _description(folder, pattern, cameras):
    """Return the text of campaign.yaml."""
    number = sum(map(len, cameras.values()))
    name = re.sub(r"[^A-Za-z0-9_-]+", "_", folder.resolve().name).strip("_")[:64] or "campaign"
    text = HEADER.format(about=f"{number} photographs", name=name)
    if pattern.board is not None:
        text += "target:\n"
        for key, value in pattern.board.model_dump().items():
            if value is not None and (value is not False or key in pattern.guesses):
                shown = str(value).lower() if isinstance(value, bool) else f"{value}"
                text += f"  {key}: {shown}{_comment(pattern.guesses.get(key))}\n"
    else:
        text += f"markers: markers.csv{_comment(pattern.guesses.get('markers'))}\n"
        for key in (k for k in IN_TABLE if k in pattern.guesses):
            text += f"# in markers.csv, {key}: {pattern.guesses[key]}\n"
        text += PHOTOGRAPHED
    text += "captures: captures.csv\ncameras:\n"
    for camera, group in cameras.items():
        width, height = group[0].size
        focal_35mm = _focal_35mm(group)
        focal = f"; by EXIF about {focal_px(focal_35mm, (width, height)):.0f} px" if focal_35mm else ""
        if (estimated := pattern.focals.get((group[0].maker, group[0].size))) is not None:
            focal += f"; as the markers' places were estimated {with_error(*estimated)} px"
        about = " ".join((group[0].maker or "EXIF says nothing of the camera").split())
        about = f"{about}, {len(group)} photographs of this size"
        text += CAMERA.format(name=camera, about=about, width=width, height=height, focal=focal)
    return text + "encoding: srgb # as cameras write it\n"


def _comment(guess):
    return f" # {' '.join(guess.split())}" if guess else ""


def _captures(cameras):
    """Return the text of captures.csv: poses are unknown."""
    file, taken = io.StringIO(), set()
    writer = csv.writer(file, lineterminator="\n")
    writer.writerow(["capture", "camera", "image"])
    for camera, group in cameras.items():
        for photograph in group:
            stem = re.sub(r"[^A-Za-z0-9_-]+", "_", photograph.path.rpartition(".")[0])[-100:].strip("_") or "photograph"
            name, number = stem, 1
            while name in taken:
                number += 1
                name = f"{stem}_{number}"
            taken.add(name)
            writer.writerow([name, camera, photograph.path])
    return file.getvalue()


def tell(folder, pattern, cameras, left_out):
    """Log what was found, what was left out and why, and what to type next."""
    if pattern.board is not None:
        facts = {k: v for k, v in pattern.board.model_dump().items() if v not in (None, False)}
        log.info("found: %s", ", ".join(f"{k} {v}" for k, v in facts.items()))
    else:
        log.info("found: %s", pattern.guesses["markers"])
    for camera, group in cameras.items():
        log.info("camera %s: %d photographs of %d x %d", camera, len(group), *group[0].size)
    for path, why in left_out[:MAX_NAMED]:
        log.info("left out: %s: %s", path, why)
    if len(left_out) > MAX_NAMED:
        log.info("left out: %d more", len(left_out) - MAX_NAMED)
    for marker, why in pattern.left_out[:MAX_NAMED]:
        log.info("left out: %s: %s", named(marker), why)
    if len(pattern.left_out) > MAX_NAMED:
        log.info("left out: %d more markers", len(pattern.left_out) - MAX_NAMED)
    for key, why in pattern.guesses.items():
        if "GUESSED" in why:
            file = "markers.csv" if key in IN_TABLE and pattern.board is None else "campaign.yaml"
            log.info("%s is a guess: measure it on the print, and correct it in %s", key, Path(folder) / file)
    # Snakemake reads the value as YAML, in which " #" begins a comment
    value = json.dumps(str(folder), ensure_ascii=False) if re.search(r" #|: ", str(folder)) else folder
    log.info("next: snakemake --cores 2 --config %s", shlex.quote(f"campaign={value}"))


def main(arguments=None):
    """Read the command line."""
    parser = argparse.ArgumentParser(description="Turn a folder of photographs into a campaign.")
    parser.add_argument("folder", help="folder of photographs: JPEG, PNG, TIFF, HEIC, also in folders below it")
    parser.add_argument("--square-mm", type=float, help="printed side of a square; of a marker, in a grid of markers")
    parser.add_argument(
        "--marker-mm", type=float, help="printed side of a marker, its black frame: in a grid, or lying loose"
    )
    given = parser.parse_args(arguments)
    job.set_up_log()
    with job.one_message():
        tell(given.folder, *start_campaign(given.folder, given.square_mm, given.marker_mm))


if __name__ == "__main__":
    main()
