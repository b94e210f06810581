"""Where to capture next: the station at which two twins, that the captures hardly tell apart, differ most.

T-optimality: A. C. Atkinson and V. V. Fedorov, "The design of experiments for discriminating between two rival models" (1975).
"""

from dataclasses import replace

import numpy as np

from gap.bounds import MIN_GAIN
from gap.fit.score import excess_of
from gap.fit.solver import Solver
from gap.fit.split import split_by_station
from gap.measure.places import wholly_inside
from job import seed_of
from rig.geometry import place_name, rotation_angle_deg, station_pose

HEIGHTS_M = (0.25, 0.5, 0.8, 1.2, 1.6)
TILTS_DEG = (0.0, 15.0, 30.0, 45.0, 60.0)
SAME_M, SAME_DEG = 0.02, 1.15  # from a grid's station up to which a capture was taken there


def suggested_station(case, a, b):
    """Return the station ({height_m, tilt_deg}) at which two twins (lists of effects) differ most, and by how much.

    The difference is the loss above its noise that each twin has in a photograph, noise and all, that the other one takes there,
    poses fitted: the smaller one, as either may be the truth. Stations that were photographed are left out; None where all were.
    What is held out decides between twins, so a station that would be fitted is suggested only where no other one tells.
    """
    taken = [capture.view.T_cam_world for capture in case.captures]
    scores = {
        (height_m, tilt_deg): _difference(case, height_m, tilt_deg, a, b)
        for height_m in HEIGHTS_M
        for tilt_deg in TILTS_DEG
        if not any(_is_same(station_pose(height_m, tilt_deg), other) for other in taken)
    }
    if not scores:
        return None
    ranked = sorted(scores, key=scores.get, reverse=True)
    telling = (station for station in ranked if scores[station] >= MIN_GAIN)
    best = next((station for station in telling if _is_held_out(case, *station, a)), ranked[0])
    return dict(zip(("height_m", "tilt_deg"), best, strict=True)) | {"difference": round(float(scores[best]), 2)}


def _is_same(T_cam_world, other):
    """Return whether two cameras stand at the same station."""
    apart_m = np.linalg.norm((T_cam_world @ np.linalg.inv(other))[:3, 3])
    return apart_m < SAME_M and rotation_angle_deg(T_cam_world[:3, :3], other[:3, :3]) < SAME_DEG


def _is_held_out(case, height_m, tilt_deg, twin):
    """Return whether the split holds out a photograph that a twin takes at a station."""
    capture = _photograph(case, height_m, tilt_deg, twin)
    _, held_out = split_by_station(replace(case, captures=[*case.captures, capture]))
    return len(case.captures) in held_out


def _difference(case, height_m, tilt_deg, a, b):
    """Return by what loss two twins differ at a station at least, each the truth in turn; 0 where no plate is seen."""
    return min(_loss(case, _photograph(case, height_m, tilt_deg, truth), rival) for truth, rival in ((a, b), (b, a)))


def _loss(case, capture, rival):
    """Return the loss above its noise of a twin in a photograph, 0 where no plate was measured."""
    if capture.observation is None or not capture.observation.measured.any():
        return 0.0
    solver = Solver(replace(case, captures=[capture]))
    _, groups = solver.score(rival, np.zeros((1, len(case.sigma_pose))), [0])
    return sum(excess_of(groups, {}).values())


def _photograph(case, height_m, tilt_deg, twin):
    """Return the Capture that a twin takes at a station, noise and all; not observed where no plate is wholly in view."""
    first, zero, station = case.captures[0], np.zeros(len(case.sigma_pose)), place_name(height_m, tilt_deg)
    view = replace(first.view, T_cam_world=station_pose(height_m, tilt_deg), capture="suggested", station=station)
    capture = replace(first, view=view, trial=0, observation=None, starts={})
    if wholly_inside(case.corners_of(capture, twin, zero), view.width, view.height).any():
        rng = np.random.default_rng(seed_of(case.campaign, case.camera, "suggested station", station))
        image = case.image_of(case.radiance_of(capture, twin, zero), capture, twin, zero, rng)
        case.observe_real(capture, np.broadcast_to(image, (*image.shape[:2], 3)).astype(np.uint8))
    return capture
