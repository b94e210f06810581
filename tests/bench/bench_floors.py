"""The floor of photographs of a board that nobody repeated, against what repeats show: python tests/bench/bench_floors.py
[--seed NAME].

Each campaign has STATIONS poses of a chessboard, drawn in light finer than its pixels and taken twice, mounted anew as a rig
is, by the generator's camera, whose noise, lens, blur and codec are drawn. Repeats tell how far points lie apart; without
repeats the product tells it from the first photograph of each pose alone. Prints a line a campaign; figures are recorded
(record.py).
"""

import argparse
import logging
import shutil
import sys
import tempfile
from pathlib import Path

ROOT = Path(__file__).resolve().parents[2]
sys.path[:0] = [str(ROOT / "scripts"), str(ROOT / "tests/bench")]

import cv2
import numpy as np

from case_files import load_measured
from expand_tables import expand_tables
from gap.boards.board import FEWEST_POINTS, polynomial_terms
from generator import draw_effect, nominal, optics
from generator.photographs import Retaken
from record import record
from register_captures import register_captures

CAMPAIGNS, STATIONS = 20, 14
RIG = nominal.RIGS["standard"]  # for its tolerances
CAMERA = nominal.Camera("camera", 640, 480, 700.0)
COLUMNS, ROWS, SQUARE_M = 9, 6, 0.025  # inner corners of the board
ALSO = ("radial_distortion", "lens_blur", "jpeg_compression")  # beside noise, each in half of the campaigns
WITHIN = 0.1
AROUND_M = 0.005  # white paper about the squares
WHITE, BLACK, GROUND = 0.8, 0.05, 0.35
CAMPAIGN = f"""schema: 1
name: floors
origin: camera
target: {{type: chessboard, columns: {COLUMNS}, rows: {ROWS}, square_m: {SQUARE_M}}}
captures: captures.csv
cameras:
  camera: {{width: {CAMERA.width}, height: {CAMERA.height}, fx: null, fy: null, cx: null, cy: null}}
encoding: srgb
"""


def pose(rng):
    """Return a rotation vector (3,) and the place (3,) of a board's middle before the camera: x right, y down, z ahead."""
    rotation = np.array([*rng.uniform(-0.6, 0.6, 2), rng.uniform(-0.4, 0.4)])
    return rotation, np.array([*rng.uniform(-0.03, 0.03, 2), rng.uniform(0.34, 0.5)])


def mounted(rotation, place, rng):
    """Return R (3, 3), t (3,) of a board mounted at a rotation (3,) and a place of its middle, to a rig's tolerances."""
    turned = rotation + rng.normal(0, np.radians(RIG.tolerance_angle_deg), 3)
    R = cv2.Rodrigues(turned)[0]
    middle = np.array([(COLUMNS + 1) / 2, (ROWS + 1) / 2, 0.0]) * SQUARE_M
    return R, place + rng.normal(0, RIG.tolerance_position_m, 3) - R @ middle


def light_at(x, y, R, t, fine_px):
    """Return the light of the board at directions x, y of rays (rows, columns); edges are soft over a fine sample."""
    H = np.linalg.inv(np.column_stack([R[:, 0], R[:, 1], t]))
    u, v, w = (H[k, 0] * x + H[k, 1] * y + H[k, 2] for k in range(3))
    u, v = u / w / SQUARE_M, v / w / SQUARE_M  # in squares, from the board's corner
    soft = fine_px * t[2] / CAMERA.fx / SQUARE_M
    checker = _side(u, soft) * _side(v, soft)
    inside = _within(u, COLUMNS + 1, soft, 0.0) * _within(v, ROWS + 1, soft, 0.0)
    around = AROUND_M / SQUARE_M
    paper = _within(u, COLUMNS + 1, soft, around) * _within(v, ROWS + 1, soft, around)
    on_paper = WHITE + inside * ((WHITE + BLACK) / 2 - (WHITE - BLACK) / 2 * checker - WHITE)
    return (GROUND + paper * (on_paper - GROUND)).astype(np.float32)


def _side(u, soft):
    """Return 1 and -1 on even and odd squares, and what lies between near a line."""
    to_line = np.abs(u - np.rint(u))
    return np.where(np.floor(u) % 2 == 0, 1.0, -1.0) * np.clip(to_line / soft, 0.0, 1.0)


def _within(u, n, soft, beyond):
    """Return 1 from -beyond to n + beyond, 0 outside, and what lies between near the ends."""
    return np.clip((n / 2 + beyond - np.abs(u - n / 2)) / soft + 0.5, 0.0, 1.0)


def write_campaign(folder, seed):
    """Write a campaign of STATIONS photographs and, as other names, their repeats; return the names of its effects."""
    rng = nominal.rng_of("floors", seed)
    names = ["sensor_noise", *(name for name in ALSO if rng.random() < 0.5)]
    retaken = Retaken(CAMERA, {n: draw_effect(n, float(rng.uniform(0.5, 2.0)), CAMERA, seed) for n in names}, seed)
    x, y = ((m - c) / CAMERA.fx for m, c in zip(retaken.maps[0], (CAMERA.cx, CAMERA.cy), strict=True))
    captures = []
    for k in range(STATIONS):
        station = pose(rng)
        for trial in range(2):
            light = light_at(x, y, *mounted(*station, rng), 1 / optics.FINE)
            capture = f"p{k:02d}-{trial}"
            image = retaken.of_light([light], nominal.rng_of("floors", seed, capture))
            cv2.imwrite(str(folder / f"{capture}.png"), image[..., ::-1])
            captures.append(f"{capture},camera,{capture}.png")
    (folder / "captures.csv").write_text("\n".join(["capture,camera,image", *captures]) + "\n")
    (folder / "campaign.yaml").write_text(CAMPAIGN)
    return names


def measured(folder, out, trials):
    """Return the board.BoardCase of the campaign's photographs of some trials, by the workflow's steps."""
    rows = (folder / "captures.csv").read_text().splitlines()
    chosen = [r for r in rows[1:] if int(r.split(",")[0][-1]) in trials]
    part = out / "campaign"
    part.mkdir(parents=True)
    for row in chosen:
        image = row.split(",")[2]
        shutil.copy(folder / image, part / image)
    (part / "captures.csv").write_text("\n".join([rows[0], *chosen]) + "\n")
    (part / "campaign.yaml").write_text(CAMPAIGN)
    expand_tables(part, None, "camera", out / "expand")
    made = out / "register.csv", out / "register.json", out / "observations.npz"
    register_captures(out / "expand", part, "camera", *made)
    return load_measured(out / "expand", out / "register.json", "camera", out / "observations.npz")


def apart_px(case):
    """Return how far points of repeats lie apart, one standard deviation per axis, pixels: robust, of no model of a camera.

    What a mounting moves is a quadratic polynomial in the pixels: a plane's motion by millimetres.
    """
    pixels = np.array([c.observation.corners[:, 0] for c in sorted(case.captures, key=lambda c: c.view.capture)])
    squares = freedom = 0.0
    for a, b in zip(pixels[0::2], pixels[1::2], strict=True):
        both = np.isfinite(a - b).all(1)
        if both.sum() < FEWEST_POINTS:
            continue
        terms, between = polynomial_terms(a[both] / CAMERA.width, 2), (a - b)[both] / np.sqrt(2)
        left = between - terms @ np.linalg.lstsq(terms, between, rcond=None)[0]
        squares += ((1.4826 * np.median(np.abs(left), axis=0)) ** 2).mean() * len(left)
        freedom += len(left) - terms.shape[1] - 1  # what corners alternate by is out of them
    return float(np.sqrt(squares / freedom))


def main(argv=None):
    """Read the command line, measure, record."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--seed", default="floors")
    args = parser.parse_args(argv)
    cv2.setNumThreads(1)
    logging.disable()
    ratios = []
    for k in range(CAMPAIGNS):
        with tempfile.TemporaryDirectory() as scratch:
            folder = Path(scratch) / "whole"
            folder.mkdir()
            names = write_campaign(folder, f"{args.seed}/{k}")
            by_repeats = apart_px(measured(folder, Path(scratch) / "both", (0, 1)))
            without = measured(folder, Path(scratch) / "first", (0,)).noise_px
        ratios.append(without / by_repeats)
        print(
            f"{k:2d} repeats {by_repeats:.4f} px, without {without:.4f} px, ratio {ratios[-1]:.3f}", *names, flush=True
        )
    near = int((np.abs(np.array(ratios) - 1) <= WITHIN).sum())
    what = f"simulated campaigns; ratio {min(ratios):.2f} to {max(ratios):.2f}, median {np.median(ratios):.2f}"
    record(
        [("floor without repeats within 10 % of the trials' floor", f"{near} of {CAMPAIGNS}", what)],
        f"python tests/bench/bench_floors.py --seed {args.seed}",
    )


if __name__ == "__main__":
    main()
