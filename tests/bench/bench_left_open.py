"""Rigs whose light, exposure, white balance or reflectances nobody declared: python tests/bench/bench_left_open.py [--seed NAME].

Each of the four is open alone, then all but the light, then all; in each way nothing is hidden once, and once an effect that is
drawn. Every capture has its own exposure (half to 1.16 of the nominal), gains (up to 20 % off) and lamp (2.5 m up, anywhere
about the rig, up to half of the light). Prints a line a campaign; figures are recorded (record.py).
"""

import argparse
import logging
import os
import sys
import tempfile
from pathlib import Path

os.environ["OPENBLAS_NUM_THREADS"] = "1"  # before numpy is loaded: threads cost small matrices more than they bring
ROOT = Path(__file__).resolve().parents[2]
sys.path[:0] = [str(ROOT / "scripts"), str(ROOT / "tests/bench")]

import cv2  # noqa: E402

from effects import library  # noqa: E402
from gap.select.select_effects import verdict  # noqa: E402
from generator import LIBRARY, draw_effect, generate_campaign, nominal  # noqa: E402
from generator.left_open import WORDS  # noqa: E402
from record import record  # noqa: E402
from trials.observe_trial import observe_trial, observed_cases  # noqa: E402

OPEN = [*((what,) for what in WORDS), tuple(what for what in WORDS if what != "light"), tuple(WORDS)]


def diagnosed(left_open, hidden, seed):
    """Return (verdict, names, gap) of a campaign that leaves some things open and hides some effects."""
    camera = nominal.RIGS["standard"].cameras[0]
    effects = [(name, draw_effect(name, 1.0, camera, seed)) for name in hidden]
    with tempfile.TemporaryDirectory() as folder:
        campaign, kept = Path(folder) / "left_open", Path(folder) / "kept"
        generate_campaign(campaign, Path(folder) / "truth", effects, seed, left_open=left_open)
        observe_trial(campaign, kept)
        *_, outcome = verdict(observed_cases(kept)[0], threads=2)
    return outcome.verdict, [step.effect for step in outcome.steps], outcome.twin.gap


def drawn(left_open, seed):
    """Return an effect that a campaign may hide that leaves some things open."""
    own = {*dict(library.own_where_open(left_open)), *library.shared_where_open(left_open)}
    names = [name for name in LIBRARY if name not in own]
    return names[nominal.rng_of("hidden", seed, *left_open).integers(len(names))]


def main(argv=None):
    """Read the command line, diagnose, record."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--seed", default="hawthorn")
    args = parser.parse_args(argv)
    cv2.setNumThreads(1)
    logging.disable()
    right, false = [], []
    for left_open in OPEN:
        for hidden in ([drawn(left_open, args.seed)], []):
            said, names, gap = diagnosed(left_open, hidden, args.seed)
            print(", ".join(left_open), hidden, said, names, f"gap {gap:.2f}", sep=" | ", flush=True)
            (right if hidden else false).append(names == hidden if hidden else bool(names))
    what = f"campaigns, seed {args.seed}: each of four open alone, all but the light, all"
    record(
        [
            ("rigs that leave things open: exactly what is hidden is named", f"{sum(right)} of {len(right)}", what),
            ("rigs that leave things open, nothing hidden: something named", f"{sum(false)} of {len(false)}", what),
        ],
        f"python tests/bench/bench_left_open.py --seed {args.seed}",
    )


if __name__ == "__main__":
    main()
