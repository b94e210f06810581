"""Diagnose a campaign of markers as the workflow does, in one process: python tests/bench/diagnose_trial.py CAMPAIGN
[--out FILE]. Prints (or writes) the verdict as JSON. Knows no envelope.
"""

import argparse
import json
import logging
import sys
import tempfile
import time
from pathlib import Path

sys.path.insert(0, str(Path(__file__).resolve().parents[2] / "scripts"))

import cv2

import job
from case_files import load_case, read_capture
from diagnose_camera import ranked, step_records
from expand_tables import expand_tables
from gap.climb import conclude
from gap.diagnose import Diagnosis
from gap.floors import group_gaps
from register_captures import register_captures
from try_effect import clean


def observed_case(campaign, camera, scratch):
    """Return the Case of a camera, its captures registered and measured; ``scratch`` takes the tables."""
    expand = Path(scratch) / camera
    expand_tables(campaign, None, camera, expand)
    register_captures(expand, campaign, camera, expand / "register.csv", expand / "register.json")
    case, captures = load_case(expand, expand / "register.json", camera)
    images = dict(zip(captures.capture, captures.image, strict=True))
    for capture in case.captures:
        case.observe_real(capture, read_capture(campaign, images[capture.view.capture]))
    return case


def diagnose_camera(campaign, camera, scratch):
    """Return what diagnosis/CAMERA.json says of a camera, but for pictures and suggestions."""
    start = time.perf_counter()
    diagnosis = Diagnosis(observed_case(campaign, camera, scratch))
    if not diagnosis.is_usable():
        return {"camera": camera, "verdict": "unexplained", "why": diagnosis.why_unusable(), "steps": [], "gap": None}
    diagnosis.set_base([])
    first, gap = diagnosis.base_groups, diagnosis.base_gap
    promises = diagnosis.promises()
    candidates = [diagnosis.try_promised(name, promises) for name in diagnosis.candidates]
    found = conclude(diagnosis, candidates)
    return {
        "camera": camera,
        "verdict": found.verdict,
        "gap_as_configured": gap,
        "gap": diagnosis.base_gap,
        "gap_se": diagnosis.base_gap_se,
        "share_left": found.share_left,
        "groups": group_gaps(diagnosis.base_groups, diagnosis.floors),
        "steps": step_records(found.steps, first, diagnosis.floors),
        "candidates": ranked(candidates, diagnosis.floors)[:6],
        "candidates_left": ranked(found.left, diagnosis.floors)[:4],
        "promises": promises,
        "floor": diagnosis.floors,
        "seconds": time.perf_counter() - start,
    }


def diagnose_campaign(campaign):
    """Return the verdicts of all cameras of a campaign's folder: a list of dicts."""
    cameras = sorted(p.name for p in (Path(campaign) / "images").iterdir())
    with tempfile.TemporaryDirectory() as scratch:
        return [clean(diagnose_camera(Path(campaign), camera, scratch)) for camera in cameras]


def main():
    """Read the command line."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("campaign")
    parser.add_argument("--out")
    arguments = parser.parse_args()
    cv2.setNumThreads(1)
    logging.getLogger("twingap").setLevel(logging.WARNING)
    with job.one_message():
        verdicts = diagnose_campaign(arguments.campaign)
    text = json.dumps(verdicts, indent=1) + "\n"
    if not arguments.out:
        print(text)
        return
    with job.write_atomically(arguments.out) as file:
        file.write(text)


if __name__ == "__main__":
    main()
