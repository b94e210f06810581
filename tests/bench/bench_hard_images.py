"""BART where images are hard: ``python tests/bench/bench_hard_images.py [--images N]``.

Markers of 25 to 200 px on textures and dense clutter, beside OpenCV's detectors, as bench_detectors.py measures them; and what
it costs BART to read all of OpenCV's sizes of codes and AprilTag's in one pass.
"""

import argparse
import sys
from pathlib import Path

ROOT = Path(__file__).resolve().parents[2]
sys.path[:0] = [str(ROOT / "scripts"), str(ROOT / "tests")]

import cv2
import numpy as np

from bench.bench_detectors import ACCURACY_HEAD, NAMES, accuracy_rows, measure, table
from bench.detector_figures import found_words, median_ms, rms_px
from bench.marker_scenes import clutter, scene, texture
from detectors import contract
from record import record

SIDE_PX = (25, 200)
PIECES = 500  # of clutter
SIZES = (
    "DICT_4X4_1000",
    "DICT_5X5_1000",
    "DICT_6X6_1000",
    "DICT_7X7_1000",
    "DICT_ARUCO_ORIGINAL",
    "DICT_APRILTAG_36h11",
)
USUAL = ("DICT_5X5_1000", "DICT_ARUCO_ORIGINAL")


def hard_scene(number):
    """Return (uint8 image, list of Truth): every other one on a texture, the others in dense clutter."""
    rng = np.random.default_rng(9000 + number)
    ground = texture(rng, 1080, 1920) if number % 2 else clutter(rng, 1080, 1920, PIECES)
    return scene(rng, side_px=SIDE_PX, ground=ground)


def main():
    """Print the tables and record the figures."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--images", type=int, default=24)
    count = parser.parse_args().images
    cv2.setNumThreads(2)
    sums = measure({name: contract.make(name) for name in NAMES}, (hard_scene(k) for k in range(count)))
    print(table(ACCURACY_HEAD, accuracy_rows(sums)))
    families = {"bart": contract.make("bart", USUAL), "all sizes": contract.make("bart", SIZES)}
    of_sizes = measure(families, (hard_scene(k) for k in range(count)))
    print(table(ACCURACY_HEAD, accuracy_rows(of_sizes)))
    subpixel = median_ms(sums, "bart") / median_ms(sums, "aruco_subpix")
    cost = median_ms(of_sizes, "all sizes") / median_ms(of_sizes, "bart")
    record(
        [
            ("BART, hard images, markers found (ArUco)", found_words(sums), "markers"),
            ("BART, hard images, corners, RMS along an axis", rms_px(sums) / np.sqrt(2), "px"),
            ("BART, hard images, over OpenCV with sub-pixel corners", subpixel, "of its time"),
            ("BART, hard images, false ids", sums["bart"]["false"], f"in {count} images"),
            ("BART, 4x4 to 7x7 and 36h11 in one pass, over two dictionaries", cost, "of the time"),
        ]
    )


if __name__ == "__main__":
    main()
