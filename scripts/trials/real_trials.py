"""Trials on real photographs: of a campaign of a board every other photograph is the baseline, and on the rest an effect is laid,
or none. ``python scripts/trials/real_trials.py FOLDER`` prints which effects can be laid on which campaign of a folder.
"""

import argparse
import csv
import json
import re
import shutil
import sys
from dataclasses import dataclass
from pathlib import Path

ROOT = Path(__file__).resolve().parents[2]
sys.path[:0] = [str(ROOT / "scripts"), str(ROOT / "tests/bench")]

import cv2
import pandas as pd

import job
from generator import draw_effect, nominal
from generator.photographs import LAID_ON, Retaken, is_in_colour, why_not_laid
from inputs.campaign import load_campaign
from inputs.images import read_image
from inputs.safe_yaml import load_yaml
from rig.errors import InputError
from trials.trial_names import BASELINE, CHANGED, identity

MIN_PHOTOGRAPHS = 12  # of a campaign, half of them in each set
NULLS = 3  # every so many trials nothing is laid on


@dataclass(frozen=True)
class Source:
    """A campaign of photographs of a board by one camera: its folder, the camera's name and size, the captures' rows."""

    folder: Path
    camera: str
    size: tuple
    captures: list


def sources_in(folder):
    """Return ([Source], {folder's name: why it is none}) of a folder of campaigns; raises InputError where there is none."""
    found, refused = [], {}
    for path in sorted(p for p in Path(folder).glob("*") if (p / "campaign.yaml").is_file()):
        campaign = load_campaign(path)
        cameras = sorted(set(campaign.captures.camera))
        if campaign.file.target is None or len(cameras) > 1:
            refused[path.name] = "photographs of one board by one camera are needed"
        elif len(campaign.captures) < MIN_PHOTOGRAPHS:
            refused[path.name] = f"{len(campaign.captures)} photographs, and {MIN_PHOTOGRAPHS} are needed"
        else:
            camera = campaign.file.cameras[cameras[0]]
            rows = campaign.captures.sort_values("capture")[["capture", "image"]].to_dict("records")
            found.append(Source(path, cameras[0], (camera.width, camera.height), rows))
    if not found:
        raise InputError(f"{folder}: no campaign of a board with {MIN_PHOTOGRAPHS} photographs or more in it")
    return found, refused


def dealt(names, index, *seed):
    """Deal names like a shuffled pack, a new pack after each round, so that every name comes equally often."""
    names = list(names)
    order = nominal.rng_of("pack", index // len(names), *seed).permutation(len(names))
    return names[order[index % len(names)]]


def can_be_laid(in_colour):
    """Return the names of the effects that can be laid on photographs that are ``in_colour`` or not."""
    return [n for n in LAID_ON if why_not_laid(n, in_colour) is None]


def laid_effect(index, seed, effect=None, in_colour=True):
    """Return the name of what is laid on in trial ``index``, None where nothing is: a third of the trials.

    It is dealt out of what can be laid on photographs that are ``in_colour`` or not.
    """
    if index % NULLS == NULLS - 1:
        return None
    names = can_be_laid(in_colour)
    return effect or dealt(names, index - index // NULLS, seed, "laid")


def drawn_effect(name, strength, camera, seed_name):
    """Return the parameters of an effect drawn for a nominal.Camera; a shutter's as a shear, for want of the scene's depth."""
    for k in range(100):
        p = draw_effect(name, strength, camera, f"{seed_name}/{k}" if k else seed_name)
        if p.get("model") != "moving camera":
            return p
    raise AssertionError(f"{name}: no draw can be laid on")


def what_is_laid_on(folder):
    """Return a DataFrame of a folder's campaigns: campaign, photographs, laid_on: which effects can be, or why none is."""
    found, refused = sources_in(folder)
    rows = [[name, "", f"none: {why}"] for name, why in refused.items()]
    for source in found:
        in_colour = any(is_in_colour(red_first(source.folder / row["image"])) for row in source.captures)
        names = can_be_laid(in_colour)
        left_out = [n for n in LAID_ON if n not in names]
        words = f"all {len(names)}" if in_colour else f"{len(names)}, grey: not {', '.join(left_out)}"
        rows.append([source.folder.name, str(len(source.captures)), words])
    return pd.DataFrame(rows, columns=["campaign", "photographs", "laid_on"]).sort_values("campaign", ignore_index=True)


def generate_real_trial(out, truths, folder, index, seed, effect=None, strength=None):
    """Write two campaigns, ``out``/NAME/baseline and ``out``/NAME/changed, and what is laid on below ``truths``; return NAME.

    Raises InputError where ``folder`` has no campaigns of boards, or the effect cannot be laid on.
    """
    name, trial_seed, strength = identity("real", index, seed, effect, strength)
    source = dealt(sources_in(folder)[0], index, seed, "sources")
    camera = nominal.Camera(source.camera, *source.size, float(max(source.size)))
    images = {row["capture"]: red_first(source.folder / row["image"]) for row in source.captures}
    in_colour = any(map(is_in_colour, images.values()))
    laid = laid_effect(index, seed, effect, in_colour)
    if laid and (why := why_not_laid(laid, in_colour)):
        raise InputError(f"{source.folder}: {why}")
    effects = {laid: drawn_effect(laid, strength, camera, trial_seed)} if laid else {}
    for part, first, acting in ((BASELINE, 0, {}), (CHANGED, 1, effects)):
        retaken = Retaken(camera, acting, f"{trial_seed}/{part}")
        names = [row["capture"] for row in source.captures][first::2]
        _write_campaign(
            Path(out) / name / part, source, f"{name}-{part}", {n: retaken.photograph(images[n], n) for n in names}
        )
    truth = {
        "campaign": name, "camera": source.camera, "kind": "real", "index": index, "strength": strength,
        "source": source.folder.name,
        "effects": [{"effect": n, "in_library": True, "parameters": p, "library_parameters": None} for n, p in effects.items()],
    }  # fmt: skip
    path = Path(truths) / name / "truth.json"
    path.parent.mkdir(parents=True, exist_ok=True)
    path.write_text(json.dumps(truth, indent=1) + "\n", encoding="utf-8")
    return name


def red_first(path):
    """Return an image (H, W, 3) of 8 bits, red first."""
    image = read_image(path)
    image = (image // 257).astype("uint8") if image.dtype == "uint16" else image
    return cv2.cvtColor(image, cv2.COLOR_GRAY2RGB) if image.ndim == 2 else image[..., 2::-1]


def _write_campaign(folder, source, name, images):
    """Write a campaign's folder; campaign.yaml last, so that one that was cut short has none."""
    folder.mkdir(parents=True, exist_ok=True)
    for capture, image in images.items():
        cv2.imwrite(str(folder / f"{capture}.png"), image[..., ::-1], [cv2.IMWRITE_PNG_COMPRESSION, 1])
    with open(folder / "captures.csv", "w", encoding="utf-8", newline="") as file:
        rows = csv.writer(file, lineterminator="\n")
        rows.writerow(["capture", "camera", "image"])
        rows.writerows([capture, source.camera, f"{capture}.png"] for capture in images)
    text = (source.folder / "campaign.yaml").read_text(encoding="utf-8")
    _copy_calibrations(source.folder, folder)
    text = re.sub(r"^name:.*$", f"name: {name}", text, count=1, flags=re.M)
    text = re.sub(r"^captures:.*$", "captures: captures.csv", text, count=1, flags=re.M)
    (folder / "campaign.yaml").write_text(text, encoding="utf-8")


def _copy_calibrations(campaign, folder):
    """Copy to a folder what a campaign's description names, or has by its place: calibrations' files and photographs."""
    cameras = load_yaml(campaign / "campaign.yaml")["cameras"].values()
    for name in {camera["intrinsics"].partition("#")[0] for camera in cameras if camera.get("intrinsics")}:
        (folder / name).parent.mkdir(parents=True, exist_ok=True)
        shutil.copyfile(campaign / name, folder / name)
    if (campaign / "calibration").is_dir():
        shutil.copytree(campaign / "calibration", folder / "calibration", dirs_exist_ok=True)


def main():
    """Read the command line and print the table."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("folder")
    with job.one_message():
        table = what_is_laid_on(parser.parse_args().folder)
        print(table.to_markdown(index=False))


if __name__ == "__main__":
    main()
