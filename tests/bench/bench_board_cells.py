"""What a board's cells tell of a camera: ``python tests/bench/bench_board_cells.py [SEED]``. Figures are recorded (record.py).

Ten photographs of a drawn board, in a light of each one's own, by the generator's camera: its noise with nothing else, and beside
each effect that can be told from single photographs. All such effects of the library compete.
"""

import argparse
import sys
import time
from pathlib import Path

ROOT = Path(__file__).resolve().parents[2]
sys.path[:0] = [str(ROOT / "scripts"), str(ROOT / "tests/bench")]

from diagnose_patches import PREDICTIONS_EACH, competing  # noqa: E402
from effects.contract import available_effects  # noqa: E402
from gap.select.select_effects import BUDGET, verdict  # noqa: E402
from generator import draw_effect, nominal  # noqa: E402
from record import record  # noqa: E402
from retaken_board import signatures_of  # noqa: E402

NOISE = "sensor_noise"
BESIDE = (
    "lens_blur", "motion_blur", "denoising", "sharpening", "jpeg_compression", "bayer_demosaic", "vignetting",
    "field_curvature",
)  # fmt: skip
ALONE = 4


def named(effects, seed):
    """Return (names that the verdict gives, seconds) of a camera with effects [name], drawn by a seed at their clear strength."""
    camera = nominal.Camera("camera", 320, 240, 420.0)
    start = time.process_time()
    case = signatures_of({n: draw_effect(n, 1.0, camera, f"{seed}/{n}") for n in effects})
    names, _ = competing(case, sorted(available_effects()), set())
    _, _, _, outcome = verdict(case, candidates=names, budget=BUDGET / PREDICTIONS_EACH / case.effort)
    return sorted(step.effect for step in outcome.steps), time.process_time() - start


def main(argv=None):
    """Read the command line, diagnose all, print each, record the sums."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("seed", nargs="?", default="larch", metavar="SEED")
    seed = parser.parse_args(argv).seed
    alone, both, took = 0, 0, []
    for k in range(ALONE):
        found, seconds = named([NOISE], f"{seed}/{k}")
        print(NOISE, found, f"{seconds:.0f} s", flush=True)
        alone += found == [NOISE]
        took.append(seconds)
    for name in BESIDE:
        found, seconds = named([NOISE, name], seed)
        print(NOISE, name, found, f"{seconds:.0f} s", flush=True)
        both += found == sorted([NOISE, name])
        took.append(seconds)
    rows = [
        ("cells of a board, noise alone: exactly that named", f"{alone} of {ALONE}", "cameras"),
        ("cells of a board, noise and one other effect: exactly both named", f"{both} of {len(BESIDE)}", "cameras"),
        (
            "cells of a board: a diagnosis, ten photographs of 320 x 240, CPU",
            f"{sorted(took)[len(took) // 2]:.0f}",
            "s",
        ),
    ]
    record(rows, f"python tests/bench/bench_board_cells.py {seed}")


if __name__ == "__main__":
    main()
