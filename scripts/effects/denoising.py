"""Denoising: smoothing that keeps edges.

A bilateral filter, range strength_dn, reach in space reach_px. Source: Tomasi and Manduchi, "Bilateral filtering for gray
and color images" (1998).
"""

import cv2
import numpy as np

from effects.base import Parameter

STAGE, ORDER = "processing", 30
DIAMETER_PX = 7
PARAMETERS = {
    "strength_dn": Parameter(
        "dn", 0.0, 80.0, 0.0, (2.0, 8.0, 20.0), 0.5, "standard deviation of levels that are averaged"
    ),
    "reach_px": Parameter(
        "px", 0.4, 3.0, 1.5, (1.5,), 0.1, "standard deviation of the distance over which they are", qualifies=True
    ),
}


def apply(image, view, p, rng):
    """Filter each channel."""
    if p["strength_dn"] == 0:
        return image
    planes = [
        cv2.bilateralFilter(np.ascontiguousarray(image[..., c]), DIAMETER_PX, p["strength_dn"], p["reach_px"])
        for c in range(image.shape[2])
    ]
    return np.stack(planes, axis=-1)
