"""Blind trials: campaigns with a hidden effect are laid down, diagnosed without the truth at hand, then opened.

    python tests/bench/bench_blind.py --kind single|pair|none|outside --count N [--size small|standard]
    python tests/bench/bench_blind.py --campaign FOLDER      a verdict on any campaign of markers

Prints a row a trial and, at the end, how often the right effects were named, and nothing else.
"""

import argparse
import json
import shutil
import sys
import tempfile
import time
from pathlib import Path

HERE = Path(__file__).resolve().parent
sys.path[:0] = [str(HERE), str(HERE.parents[1] / "scripts")]

import cv2

from case_files import load_case, read_capture
from expand_tables import expand_tables
from gap.diagnose import Diagnosis, climb, verdict_of
from lay_down_trials import lay_down_trial
from register_captures import register_captures


def diagnose_folder(campaign, scratch):
    """Return {camera: (verdict, [effects], {effect: parameters}, gap, seconds)} of a campaign's folder."""
    out = {}
    cameras = sorted(p.name for p in (Path(campaign) / "images").iterdir())
    for camera in cameras:
        start = time.perf_counter()
        expand = Path(scratch) / camera
        expand_tables(campaign, None, camera, expand)
        register_captures(expand, campaign, camera, expand / "r.csv", expand / "r.json")
        case, captures = load_case(expand, expand / "r.json", camera)
        images = dict(zip(captures.capture, captures.image, strict=True))
        for capture in case.captures:
            case.observe_real(capture, read_capture(campaign, images[capture.view.capture]))
        diagnosis = Diagnosis(case)
        if not diagnosis.is_usable():
            out[camera] = ("unexplained", [], {}, None, time.perf_counter() - start, [])
            continue
        diagnosis.set_base([])
        steps, _ = climb(diagnosis, diagnosis.try_most_promising(diagnosis.candidates))
        verdict = verdict_of(steps, diagnosis.base_gap, diagnosis.base_gap_se)
        confused = [s.confused_with for s in steps]
        seconds = time.perf_counter() - start
        out[camera] = (
            verdict,
            [s.effect for s in steps],
            dict(diagnosis.effects),
            diagnosis.base_gap,
            seconds,
            confused,
        )
    return out


def trial(kind, index, seed, size, folder):
    """Lay down and diagnose one trial; return (hidden effects, verdict, named effects, gap, seconds)."""
    name, _ = lay_down_trial(folder / "campaigns", folder / "envelopes", kind, index, seed, size=size)
    ((verdict, named, _, gap, seconds, _),) = diagnose_folder(folder / "campaigns" / name, folder / "scratch").values()
    truth = json.loads((folder / "envelopes" / name / "truth.json").read_text())
    shutil.rmtree(folder / "campaigns" / name)
    return [e["effect"] for e in truth["effects"]], verdict, named, gap, seconds


def is_right(kind, hidden, verdict, named):
    """Return whether a verdict is right: the set of effects, nothing, or ``unexplained`` without a name."""
    if kind == "outside":
        return verdict == "unexplained" and not named
    return set(hidden) == set(named)


def main():
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--kind", default="single", choices=["single", "pair", "none", "outside"])
    parser.add_argument("--count", type=int, default=29)
    parser.add_argument("--first", type=int, default=0)
    parser.add_argument("--seed", default="bench")
    parser.add_argument("--size", default="small")
    parser.add_argument("--campaign")
    arguments = parser.parse_args()
    cv2.setNumThreads(1)
    with tempfile.TemporaryDirectory() as scratch:
        if arguments.campaign:
            for camera, found in diagnose_folder(Path(arguments.campaign), scratch).items():
                print(camera, *found, flush=True)
            return
        right = first = 0
        print("| hidden | verdict | named | gap | s |\n|---|---|---|---|---|")
        for index in range(arguments.first, arguments.first + arguments.count):
            hidden, verdict, named, gap, seconds = trial(
                arguments.kind, index, arguments.seed, arguments.size, Path(scratch)
            )
            right += is_right(arguments.kind, hidden, verdict, named)
            first += bool(hidden and named and named[0] in hidden)
            print(
                f"| {', '.join(hidden)} | {verdict} | {', '.join(named)} | {gap or 0:.2f} | {seconds:.0f} |", flush=True
            )
        print(
            f"\n{arguments.kind}: right {right} of {arguments.count}, right effect first {first} of {arguments.count}"
        )


if __name__ == "__main__":
    main()
