"""Pictures of what has changed between two sets of captures: arrows where points lie off, or a square of the board."""

from pathlib import Path

import cv2
import numpy as np

from case_files import read_capture
from gap.measure.places import code_sides_px
from gap.signatures.signature_changes import laid_on_numbers
from inputs import tables

ARROW = 0.05  # of the picture's width, its longest arrows
SQUARE_PX = 300


def arrows_on(found, before, after, campaigns):
    """Return ([picture (H, W, 3) of each campaign], {before, after: capture, times: factor}) of Changes.

    Shown are the later photograph that the earlier camera's twin is farthest off, and the earlier one that is most like it.
    """
    off = {k: {i: found.residuals_of_points(i) for i in found.captures_of(k)} for k in (0, 1)}
    later = max(off[1], key=lambda i: np.median(np.linalg.norm(off[1][i][1], axis=1)))
    middle = off[1][later][0].mean(0)
    earlier = min(off[0], key=lambda i: np.linalg.norm(off[0][i][0].mean(0) - middle))
    longest = np.quantile(np.linalg.norm(off[1][later][1], axis=1), 0.9)
    width = found.problem.captures[later].view.width
    times = float(max(1, round(ARROW * width / max(longest, 1e-3), -1)))
    pictures, shown = [], {"times": times}
    for name, k, i, paths in (("before", 0, earlier, before), ("after", 1, later, after)):
        shown[name] = found.problem.captures[i].view.capture.split("/", 1)[1]
        table = tables.read_table(Path(paths[0]).parent / "captures.csv", tables.CAPTURES).set_index("capture")
        image = read_capture(campaigns[k], table.loc[shown[name], "image"])
        pictures.append(with_arrows(image, *off[k][i], times))
    return pictures, shown


def squares_of(what):
    """Return ([picture of each set], {before, after: capture}) of a WhatChanged: one square of the board in both, enlarged.

    Beside that of the earlier set, or of the later one where the first change is less of something, it is with that laid on.
    """
    change = what.signatures[0]
    pairs = (
        (_sides_px(a)[plate] - abs(_sides_px(a)[plate] - _sides_px(b)[plate]), -i, -j, plate)
        for i, a in enumerate(what.photographs[0])
        for j, b in enumerate(what.photographs[1])
        for plate in set(a.plates.tolist()) & set(b.plates.tolist())
    )
    _, i, j, plate = max(pairs)
    photographs = what.photographs[0][-i], what.photographs[1][-j]
    pictures = []
    for k, photograph in enumerate(photographs):
        images = [photograph.image]
        if change.less == bool(k):
            images.append(photograph.whole(change.laid, laid_on_numbers(photograph)))
        pictures.append(np.hstack([_square(image, photograph, plate) for image in images]))
    names = [p.view.capture for p in photographs]
    return pictures, {"before": names[0], "after": names[1], "square": True}


def _sides_px(photograph):
    """Return {plate: its code's shortest side, pixels} of a photograph."""
    sides = code_sides_px(photograph.features[:, :8].reshape(-1, 4, 2))
    return dict(zip(photograph.plates.tolist(), sides.tolist(), strict=True))


def _square(image, photograph, plate):
    """Return a picture (SQUARE_PX, SQUARE_PX, 3), blue first, of what lies about a plate of a photograph."""
    corners = photograph.features[photograph.plates.tolist().index(plate), :8].reshape(4, 2)
    half = 0.8 * _sides_px(photograph)[plate]
    x, y = corners.mean(0)
    scale = 2 * half / SQUARE_PX
    crop = np.array([[scale, 0, x - half + scale / 2 - 0.5], [0, scale, y - half + scale / 2 - 0.5]])
    flags = cv2.INTER_NEAREST | cv2.WARP_INVERSE_MAP
    return cv2.warpAffine(
        _blue_first(image), crop, (SQUARE_PX, SQUARE_PX), flags=flags, borderMode=cv2.BORDER_REPLICATE
    )


def _blue_first(image):
    """Return a picture (H, W, 3), 8 bits, blue first, of grey levels (H, W, 1 or 3), red first."""
    picture = np.repeat(image, 3 // image.shape[2], axis=2)[..., ::-1]
    return np.ascontiguousarray(picture.clip(0, 255).astype(np.uint8))


def with_arrows(image, seen, off, times):
    """Return a picture (H, W, 3), blue first, of an image (H, W, C), red first, with arrows that end at points (p, 2) seen.

    They begin where the points were expected, ``off`` (p, 2) longer by a factor.
    """
    picture = _blue_first(image)
    thick = max(1, picture.shape[1] // 640)
    for end, move in zip(seen, off, strict=True):
        points = [tuple(int(v) for v in np.rint(p)) for p in (end - times * move, end)]
        cv2.arrowedLine(picture, *points, (40, 40, 235), thick, cv2.LINE_AA, tipLength=0.25)
    return picture
