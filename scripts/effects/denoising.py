"""Denoising: smoothing that keeps edges.

A bilateral filter whose range is strength_dn. Source: Tomasi and Manduchi, "Bilateral filtering for gray and color
images" (1998).
"""

import cv2
import numpy as np

from effects.base import Parameter

STAGE, ORDER = "processing", 30
DIAMETER_PX, SIGMA_PX = 5, 1.5
PARAMETERS = {"strength_dn": Parameter("dn", 0.0, 80.0, 0.0, (2.0, 8.0), 0.5, "range within which levels are averaged")}


def apply(image, view, p, rng):
    """Filter each channel."""
    if p["strength_dn"] == 0:
        return image
    planes = [
        cv2.bilateralFilter(np.ascontiguousarray(image[..., c]), DIAMETER_PX, p["strength_dn"], SIGMA_PX)
        for c in range(image.shape[2])
    ]
    return np.stack(planes, axis=-1)
