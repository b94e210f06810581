"""Measure a campaign of markers once, so that it can be diagnosed again without its images:
python scripts/trials/observe_trial.py CAMPAIGN --out FOLDER.

Makes FOLDER/CAMERA/ for every camera: expand/ (the tables of rules/expand.smk), register.csv, register.json and
observations.npz, written last.
"""

import argparse
import logging
import os
import shutil
import sys
import tempfile
from pathlib import Path

sys.path.insert(0, str(Path(__file__).resolve().parents[1]))

import cv2

import job
from case_files import load_case, load_observations
from expand_tables import expand_tables
from inputs.baseline import MIN_CAPTURES
from inputs.campaign import load_campaign
from observe_captures import observe_captures
from register_captures import register_captures
from rig.errors import InputError
from trials.trial_names import BASELINE, CHANGED

OBSERVATIONS = "observations.npz"
REFUSED = "refused.txt"
PHOTOGRAPHS = "photographs"  # of a trial on a board's: an effect is laid on them to see whether it makes the difference


def observe_camera(campaign, camera, folder):
    """Register and measure the captures of a camera; write to the folder all that a fit needs of them."""
    expand_tables(campaign, None, camera, folder / "expand")
    register_captures(folder / "expand", campaign, camera, folder / "register.csv", folder / "register.json")
    observe_captures(folder / "expand", folder / "register.json", campaign, camera, folder / OBSERVATIONS)


def observe_trial(campaign, out):
    """Write ``out``/CAMERA/ for every camera of a campaign's folder; ``out`` is there whole or not at all."""
    campaign, out = Path(campaign), Path(out)
    observe = _observe_real if (campaign / BASELINE).is_dir() else _observe_rig
    out.parent.mkdir(parents=True, exist_ok=True)
    with tempfile.TemporaryDirectory(dir=out.parent, prefix=f".{out.name}.") as scratch:
        whole = Path(scratch) / out.name
        observe(campaign, whole)
        if out.exists():
            shutil.rmtree(out)
        os.replace(whole, out)


def _observe_rig(campaign, out):
    """Write ``out``/CAMERA/ for every camera of a campaign of markers."""
    if not (campaign / "images").is_dir():
        raise InputError(f"{campaign}/images: no such folder; a campaign of markers with photographs is needed")
    for images in sorted((campaign / "images").iterdir()):
        observe_camera(campaign, images.name, out / images.name)


def _observe_real(folder, out):
    """Write ``out``/baseline/ and ``out``/changed/ of a trial on photographs of a board, or why they show too little.

    The photographs themselves are kept as well.
    """
    for part in (BASELINE, CHANGED):
        camera = load_campaign(folder / part).captures.camera.iloc[0]
        of_part = out / part
        _keep_photographs(folder / part, of_part / PHOTOGRAPHS)
        expand_tables(folder / part, None, camera, of_part / "expand")
        try:
            made = of_part / "register.csv", of_part / "register.json", of_part / OBSERVATIONS
            register_captures(of_part / "expand", folder / part, camera, *made, least=MIN_CAPTURES)
        except InputError as error:
            (out / REFUSED).write_text(f"{error}\n", encoding="utf-8")
            return


def _keep_photographs(campaign, out):
    """Link a campaign's files to a folder, or copy them where that cannot be."""
    out.mkdir(parents=True)
    for path in sorted(p for p in campaign.iterdir() if p.is_file()):
        try:
            os.link(path, out / path.name)
        except OSError:
            shutil.copy2(path, out / path.name)


def observed_cases(folder):
    """Return the Cases, measured, of what ``observe_trial`` wrote; raises InputError where that is not whole."""
    cases = []
    for camera in sorted(p for p in Path(folder).glob("*") if p.is_dir()):
        if not (camera / OBSERVATIONS).is_file():
            raise InputError(f"{camera}/{OBSERVATIONS}: no such file; observe_trial.py writes it")
        case, _ = load_case(camera / "expand", camera / "register.json", camera.name)
        load_observations(camera / OBSERVATIONS, case)
        cases.append(case)
    if not cases:
        raise InputError(f"{folder}: no observations in it; observe_trial.py writes them")
    return cases


def main():
    """Read the command line."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("campaign")
    parser.add_argument("--out", required=True, help="folder for what was measured")
    arguments = parser.parse_args()
    cv2.setNumThreads(1)
    logging.getLogger("twingap").setLevel(logging.WARNING)
    with job.one_message():
        observe_trial(arguments.campaign, arguments.out)


if __name__ == "__main__":
    main()
