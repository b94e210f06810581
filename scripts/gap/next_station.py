"""Where to capture next: the station at which two twins, that the captures hardly tell apart, differ most.

T-optimality: A. C. Atkinson and V. V. Fedorov, "The design of experiments for discriminating between two rival models" (1975).
"""

from dataclasses import replace

import numpy as np

from gap.measure.places import wholly_inside
from gap.score import excess_of
from gap.solver import Solver
from job import seed_of
from rig.geometry import rotation_angle_deg, station_pose

HEIGHTS_M = (0.25, 0.5, 0.8, 1.2, 1.6)
TILTS_DEG = (0.0, 15.0, 30.0, 45.0, 60.0)
SAME_M, SAME_DEG = 0.02, 1.15  # from a grid's station up to which a capture was taken there


def suggested_station(case, a, b):
    """Return the station ({height_m, tilt_deg}) at which two twins (lists of effects) differ most, and by how much.

    The difference is the loss above its noise that each twin has in a photograph, noise and all, that the other one takes there,
    poses fitted: the smaller one, as either may be the truth. Stations that were photographed are left out; None where all were.
    """
    poses = {(h, t): station_pose(h, t) for h in HEIGHTS_M for t in TILTS_DEG}
    taken = [capture.view.T_cam_world for capture in case.captures]
    scores = {
        station: _difference(case, pose, a, b)
        for station, pose in poses.items()
        if not any(_is_same(pose, other) for other in taken)
    }
    if not scores:
        return None
    height_m, tilt_deg = best = max(scores, key=scores.get)
    return {"height_m": height_m, "tilt_deg": tilt_deg, "difference": round(float(scores[best]), 2)}


def _is_same(T_cam_world, other):
    """Return whether two cameras stand at the same station."""
    apart_m = np.linalg.norm((T_cam_world @ np.linalg.inv(other))[:3, 3])
    return apart_m < SAME_M and rotation_angle_deg(T_cam_world[:3, :3], other[:3, :3]) < SAME_DEG


def _difference(case, T_cam_world, a, b):
    """Return by what loss two twins differ at a pose at least, each the truth in turn; 0 where no plate is seen."""
    return min(_loss(case, T_cam_world, *pair) for pair in ((a, b), (b, a)))


def _loss(case, T_cam_world, truth, rival):
    """Return the loss above its noise of a rival in the photograph that a true twin takes at a pose."""
    first, zero = case.captures[0], np.zeros(len(case.sigma_pose))
    view = replace(first.view, T_cam_world=T_cam_world, capture="suggested", station="suggested")
    capture = replace(first, view=view, trial=0, observation=None, starts={})
    if not wholly_inside(case.corners_of(capture, truth, zero), view.width, view.height).any():
        return 0.0
    rng = np.random.default_rng(seed_of(case.campaign, case.camera, "suggested station", str(T_cam_world.tolist())))
    image = case.image_of(case.radiance_of(capture, truth, zero), capture, truth, zero, rng)
    case.observe_real(capture, np.broadcast_to(image, (*image.shape[:2], 3)).astype(np.uint8))
    if not capture.observation.measured.any():
        return 0.0
    solver = Solver(replace(case, captures=[capture]))
    _, groups = solver.score(rival, zero[None], [0])
    return sum(excess_of(groups, {}).values())
