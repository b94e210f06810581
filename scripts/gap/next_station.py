"""Where to capture next: the station at which two twins, that the captures hardly tell apart, differ most."""

from dataclasses import replace

import numpy as np

from gap.measure.places import SMALLEST_SIDE_PX, code_sides_px, wholly_inside
from rig.geometry import station_pose


def suggested_station(case, a, b):
    """Return the station ({height_m, tilt_deg}) at which two twins (lists of effects) differ most, and by how much.

    Corners are compared after each twin's pose was adjusted within its prior, levels by the images' difference;
    the sum is in units of 0.05 px and 1 grey level.
    """
    capture = case.captures[0]
    best = None
    for height_m in (0.25, 0.5, 0.8, 1.2, 1.6):
        for tilt_deg in (0.0, 15.0, 30.0, 45.0, 60.0):
            view = replace(capture.view, T_cam_world=station_pose(height_m, tilt_deg))
            probe = replace(capture, view=view)
            score = _difference(case, probe, a, b)
            if best is None or score > best[0]:
                best = (score, height_m, tilt_deg)
    return {"height_m": best[1], "tilt_deg": best[2], "difference": round(float(best[0]), 2)}


def _difference(case, capture, a, b):
    zero = np.zeros(6)
    pixels = [case.corners_of(capture, effects, zero).reshape(-1, 8) for effects in (a, b)]
    inside = wholly_inside(pixels[0].reshape(-1, 4, 2), capture.view.width, capture.view.height)
    inside &= np.isfinite(pixels[1]).all(1) & (code_sides_px(pixels[0].reshape(-1, 4, 2)) >= SMALLEST_SIDE_PX)
    if not inside.any():
        return 0.0
    d = (pixels[1] - pixels[0])[inside].ravel() / 0.05
    J = []
    for k in range(6):
        h = np.zeros(6)
        h[k] = 1e-5
        J.append((case.corners_of(capture, a, h).reshape(-1, 8)[inside].ravel() - pixels[0][inside].ravel()) / 1e-5)
    J = np.stack(J, axis=1) / 0.05
    prior = np.where(np.isfinite(case.sigma_pose), 1 / case.sigma_pose**2, 0)
    d = d - J @ np.linalg.solve(J.T @ J + np.diag(prior + 1e-9), J.T @ d)
    images = [
        case.image_of(case.radiance_of(capture, effects, zero), capture, effects, zero).mean() for effects in (a, b)
    ]
    return np.sqrt((d**2).mean()) + abs(images[0] - images[1])
