"""Denoising: smoothing that keeps edges.

A bilateral filter, range strength_dn, reach in space reach_px; and a share median_share of a 3 x 3 median. Sources: Tomasi
and Manduchi, "Bilateral filtering for gray and color images" (1998); Tukey, "Exploratory Data Analysis" (1977).
"""

import cv2
import numpy as np

from effects.base import Parameter

STAGE, ORDER = "processing", 30
AFFECTS = "intensity"
DIAMETER_PX = 9  # of the bilateral filter's window: 7 cut off a reach of 1.8 px
MEDIAN_PX = 3
PARAMETERS = {
    "strength_dn": Parameter(
        unit="dn", lower=0.0, upper=80.0, null=0.0, matters=0.5, doc="standard deviation of levels that are averaged"
    ),
    "reach_px": Parameter(
        unit="px",
        lower=0.4,
        upper=3.0,
        null=1.5,
        matters=0.1,
        doc="standard deviation of the distance over which they are",
        auxiliary=True,
    ),
    "median_share": Parameter(unit="1", lower=0.0, upper=1.0, null=0.0, matters=0.1, doc="share of the median"),
}
STARTS = ({"strength_dn": 2.0}, {"strength_dn": 8.0}, {"strength_dn": 20.0}, {"median_share": 0.7})


def bilateral(plane, p):
    """Return a channel averaged over what is near in place and in level."""
    if p["strength_dn"] == 0:
        return plane
    return cv2.bilateralFilter(plane, DIAMETER_PX, p["strength_dn"], p["reach_px"])


def apply(image, view, p, rng):
    """Filter each channel."""
    if p["strength_dn"] == 0 and p["median_share"] == 0:
        return image
    share = np.float32(p["median_share"])
    planes = []
    for plane in (np.ascontiguousarray(image[..., c]) for c in range(image.shape[2])):
        smooth = bilateral(plane, p)
        planes.append(smooth if share == 0 else smooth + share * (cv2.medianBlur(plane, MEDIAN_PX) - smooth))
    return np.stack(planes, axis=-1)
