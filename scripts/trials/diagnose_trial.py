"""Diagnose a campaign of markers as the workflow does, in one process:
python scripts/trials/diagnose_trial.py CAMPAIGN [--keep FOLDER] [--out FILE]. Prints (or writes) the verdicts as JSON.
Knows no truth.

``--keep FOLDER`` leaves what was measured in FOLDER/<campaign>; ``--replay FOLDER/<campaign>``, in CAMPAIGN's place,
diagnoses from there without any image.
"""

import argparse
import json
import logging
import os
import sys
import tempfile
import time
from pathlib import Path

sys.path.insert(0, str(Path(__file__).resolve().parents[1]))
os.environ["OPENBLAS_NUM_THREADS"] = "1"  # before numpy is loaded: threads cost small matrices more than they bring

import cv2
import pandas as pd

import job
from diagnose_camera import verdict_record
from find_changes import changes_record
from gap.select.select_effects import verdict
from photograph_changes import PhotographSet, what_changed
from trials.observe_trial import OBSERVATIONS, PHOTOGRAPHS, REFUSED, observe_trial, observed_cases
from trials.trial_names import BASELINE, CHANGED


def diagnose_case(case):
    """Return what diagnosis/CAMERA.json says of a measured Case, but for pictures and suggestions."""
    start = time.perf_counter()
    try:
        search, base, first, outcome = verdict(case)
    except ValueError as why:
        return {"camera": case.camera, "verdict": "unexplained", "why": str(why), "steps": [], "gap": None}
    record = {"camera": case.camera, "share_left": outcome.share_left, "cost": search.cost}
    return record | verdict_record(base, first, outcome) | {"seconds": time.perf_counter() - start}


def diagnose_changes(folder):
    """Return what diagnosis/CAMERA.json says has changed in a trial on real photographs; ``refused``: they show too little."""
    folder = Path(folder)
    camera = pd.read_csv(next(folder.glob("*/expand/captures.csv"))).camera.iloc[0]
    nothing = {"camera": camera, "verdict": "refused", "steps": [], "gap": None}
    if (folder / REFUSED).is_file():
        return nothing | {"why": (folder / REFUSED).read_text(encoding="utf-8").strip()}
    start = time.perf_counter()
    try:
        alone = [{"campaign": part, "camera": camera} for part in (BASELINE, CHANGED)]
        record = changes_record(what_changed(photograph_sets(folder), camera), alone)
    except ValueError as why:
        return nothing | {"why": str(why)}
    return record | {"seconds": time.perf_counter() - start}


def photograph_sets(folder):
    """Return the PhotographSets, the earlier first, of a trial on real photographs as ``observe_trial`` kept it."""
    parts = [Path(folder) / name for name in (BASELINE, CHANGED)]
    register_json = parts[0] / "register.json"  # of both: what is another focal length is found, not calibrated away
    return [PhotographSet(p / PHOTOGRAPHS, p / "expand", register_json, p / OBSERVATIONS) for p in parts]


def replay(folder):
    """Return the verdicts, one a camera, of what ``observe_trial`` left in a folder: a list of dicts."""
    if (Path(folder) / BASELINE).is_dir():
        return [job.clean(diagnose_changes(folder))]
    return [job.clean(diagnose_case(case)) for case in observed_cases(folder)]


def diagnose_campaign(campaign):
    """Return the verdicts of all cameras of a campaign's folder: a list of dicts."""
    with tempfile.TemporaryDirectory() as scratch:
        observe_trial(campaign, Path(scratch) / "observed")
        return replay(Path(scratch) / "observed")


def main(argv=None):
    """Read the command line."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    source = parser.add_mutually_exclusive_group(required=True)
    source.add_argument("campaign", nargs="?")
    source.add_argument("--replay", help="FOLDER/<campaign> that --keep left")
    parser.add_argument("--keep", help="folder for what was measured")
    parser.add_argument("--out")
    arguments = parser.parse_args(argv)
    if arguments.keep and arguments.replay:
        parser.error("--keep goes with a campaign: what is replayed is kept already")
    cv2.setNumThreads(1)
    logging.getLogger("twingap").setLevel(logging.WARNING)
    with job.one_message():
        if arguments.keep:
            kept = Path(arguments.keep) / Path(arguments.campaign).resolve().name
            observe_trial(arguments.campaign, kept)
            verdicts = replay(kept)
        elif arguments.replay:
            verdicts = replay(arguments.replay)
        else:
            verdicts = diagnose_campaign(arguments.campaign)
        text = json.dumps(verdicts, indent=1) + "\n"
        if not arguments.out:
            print(text)
            return
        with job.write_atomically(arguments.out) as file:
            file.write(text)


if __name__ == "__main__":
    main()
