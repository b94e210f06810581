"""Photographs of a drawn board (tests/gap/drawn_board.py) by the generator's camera, and their signatures beside their twins'.

The board is drawn three times finer than pixels, in a light of each photograph's own; what the camera does is the generator's.
"""

import sys
from dataclasses import replace
from pathlib import Path

ROOT = Path(__file__).resolve().parents[2]
sys.path[:0] = [str(ROOT / "scripts"), str(ROOT / "tests/bench"), str(ROOT / "tests/gap")]

import numpy as np  # noqa: E402
from drawn_board import K, board_case, light_of, on_board  # noqa: E402

from case_files import PATCHES  # noqa: E402
from gap.boards.capture_light import photograph_light  # noqa: E402
from gap.boards.photographs import expected_corners  # noqa: E402
from gap.problem import Capture  # noqa: E402
from gap.signatures.signature import Photograph  # noqa: E402
from gap.signatures.signature_case import OF_SLOPES, SignatureCase, seen_patches, twin_photograph  # noqa: E402
from generator import nominal, optics  # noqa: E402
from generator.photographs import Retaken  # noqa: E402
from rig.geometry import project  # noqa: E402

POINTS = np.array([[(i + 1) * 0.03, (6 - j) * 0.03, 0] for j in range(6) for i in range(8)])  # of the board, metres


def taken(case, k, effects, printed=()):
    """Return the 8-bit photograph (H, W, 3) of capture k by the generator's camera with some of its effects, of a board with
    effects ``printed`` [(name, parameters)] of the twin's.
    """
    view, fine = case.captures[k].view, optics.FINE
    camera = nominal.Camera("camera", view.width, view.height, view.K[0, 0])
    retaken = Retaken(camera, effects, "test")
    m, finer = retaken.margin, view.K.copy()
    finer[:2, :2] *= fine
    finer[:2, 2] = (view.K[:2, 2] + 0.5) * fine - 0.5
    v = replace(view, K=finer, width=view.width * fine, height=view.height * fine, margin=m * fine)
    radiance = case.radiance_of(replace(case.captures[k], view=v), list(printed), np.zeros(6))
    x, y = np.meshgrid(*(np.arange(-m * fine, n + m * fine) for n in (v.width, v.height)))
    lit = case.lit(radiance, light_of(k), *on_board(v, x, y))
    return retaken.of_light([np.ascontiguousarray(lit[..., c]) for c in range(3)], nominal.rng_of("test", str(k)))


def signatures_of(effects, number=10, printed=()):
    """Return the SignatureCase of so many photographs by a camera with some of the generator's effects, of a board as ``taken``."""
    case = board_case(number)
    captures, twins, signs = [], [], []
    for k, capture in enumerate(case.captures):
        image, view = taken(case, k, effects, printed), capture.view
        pixels = project(K, view.T_cam_world, POINTS)
        plates, features = case.patches_seen(image.astype(np.float32), expected_corners(POINTS, pixels, case.patches))
        light = photograph_light(image.astype(np.float32), case.scene, POINTS, pixels, case.codes.lut, OF_SLOPES)
        photograph = Photograph(image, view, case.codes, plates, features).fewer(PATCHES)
        captures.append(Capture(view, 1, seen_patches(len(case.patches), photograph.plates, photograph.features)))
        twins.append(twin_photograph(case, view, [], light, photograph.plates, photograph.features, True))
        signs.append(photograph.signature())
    return SignatureCase("c", "camera", captures, twins, np.array(signs), OF_SLOPES, case)
