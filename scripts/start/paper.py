"""How much white paper lies round a marker's code, as photographs show it."""

import cv2
import numpy as np

PX = 64  # of a code's side, once it is straightened
REACH = 1.0  # looked for so far beyond the code, in its sides
WHITE_SHARE = 0.75  # of the paper's level next to the code: darker is no paper
ROUND_SHARE = 0.8  # of a frame round the code must be paper
MAX_SIGHTINGS = 40  # sightings looked at


def plate_over_code(images, views, quads):
    """Return the side of the white plates in sides of their codes, None where no edge of a paper is seen.

    images  grey, uint8; views (n,) in which of them the codes of corners ``quads`` (n, 4, 2) lie
    """
    step = max(1, len(views) // MAX_SIGHTINGS)
    sides = [_plate(images[v], quad) for v, quad in zip(views[::step], quads[::step], strict=True)]
    known = [s for s in sides if s is not None]
    return float(np.median(known)) if len(known) > len(sides) / 2 else None


def _plate(image, quad):
    """Return the side of one plate in sides of its code; None where the white ends nowhere, or at once."""
    margin = round(REACH * PX)
    whole = PX + 2 * margin
    low, high = margin - 0.5, margin + PX - 0.5
    straight = np.float32([[low, low], [high, low], [high, high], [low, high]])
    H = cv2.getPerspectiveTransform(quad.astype(np.float32), straight)
    near = cv2.warpPerspective(image, H, (whole, whole), flags=cv2.INTER_LINEAR, borderValue=0).astype(float)
    y, x = np.abs(np.mgrid[:whole, :whole] - (whole - 1) / 2)
    ring = np.maximum(x, y) - PX / 2  # pixels beyond the code
    white = np.median(near[(ring > 2) & (ring < 6)])
    for distance in range(3, margin - 1):
        if (near[(ring >= distance) & (ring < distance + 1)] > WHITE_SHARE * white).mean() < ROUND_SHARE:
            return 1 + 2 * distance / PX if distance > 3 else None
    return None
