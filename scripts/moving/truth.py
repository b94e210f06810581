"""The exact truth of frames that a moving camera takes: corners row by row, poses, and what an occluder hides."""

import cv2
import numpy as np
import pandas as pd
import pandera.pandas as pa

from moving.trajectories import make_trajectory, project_rolling, row_delay
from rig.geometry import make_pose, project, split_pose, transform
from rig.plates import marker_corners_plate

CORNERS = [f"{axis}{k}" for k in range(4) for axis in "xy"]
POSE = ["rx", "ry", "rz", "tx", "ty", "tz"]
TRUTH = pa.DataFrameSchema(
    {"trajectory": pa.Column(str, coerce=True), "frame": pa.Column(int, coerce=True)}
    | {"t_s": pa.Column(float, coerce=True)}
    | {"dictionary": pa.Column(str, coerce=True), "id": pa.Column(int, coerce=True)}
    | {name: pa.Column(float, nullable=True, coerce=True) for name in [*CORNERS, *POSE, "side_px", "smear_px"]}
    | {"in_frame": pa.Column(bool, coerce=True), "hidden": pa.Column(float, pa.Check.in_range(0, 1), coerce=True)},
    strict=True,
    unique=["trajectory", "frame", "dictionary", "id"],
)
EDGE_PX = 2.0  # a marker is in the frame if its plate lies so far inside
INSTANTS = 5  # of the exposure at which the occluder is looked at
HEIGHTS = 61  # at which the occluder's sides are looked at: it may reach behind the camera
NEAR_M = 0.02


def trajectory_of(moving, name):
    """Return the function t_s -> T_cam_world of a trajectory, seeded by the experiment's seed and names."""
    file = moving.file
    return make_trajectory(
        file.trajectories[name], file.frames / file.fps, file.seed, "moving", file.name, name, "motion"
    )


def occluder_x_m(occluder, t_s):
    """Return x of the occluder's middle at a time (any shape), m."""
    return occluder.start_x_m + occluder.speed_m_s * np.asarray(t_s, float)


def truth_table(moving, name):
    """Return the TRUTH table of a trajectory: a row for each frame and marker.

    x0..y3    where the corners are seen, each in its own row (pixels)
    rx..tz    T_cam_marker when the row of the marker's centre is half exposed
    side_px   mean side of the code in the image; smear_px: length of the motion blur at its centre
    in_frame  the whole plate lies inside the frame and shows its front
    hidden    share of the plate that the occluder covers in the exposure, at most
    """
    trajectory, motion = trajectory_of(moving, name), moving.file.trajectories[name]
    rows = []
    for frame, t_s in enumerate(moving.times_s):
        for marker in moving.markers.itertuples():
            rows.append(
                [name, frame, t_s, marker.dictionary, marker.id, *_seen(moving, trajectory, motion, marker, t_s)]
            )
    return pd.DataFrame(rows, columns=list(TRUTH.columns))


def _seen(moving, trajectory, motion, marker, t_s):
    """Return the values of x0 to hidden of one marker in one frame."""
    file, K, (height, width) = moving.file, moving.K, moving.shape
    T_world_marker = make_pose([marker.rx, marker.ry, marker.rz], [marker.x, marker.y, marker.z])
    outer = transform(T_world_marker, marker_corners_plate(marker.plate_m))
    code = transform(T_world_marker, marker_corners_plate(marker.code_m))
    points = np.concatenate([code, outer, T_world_marker[:3, 3][None]])
    seen = project_rolling(K, trajectory, t_s, points, height, file.readout_s)
    corners, plate, centre = seen[:4], seen[4:8], seen[8]
    time_s = t_s + float(row_delay(centre[1], height, file.readout_s)) if np.isfinite(centre[1]) else t_s
    T_cam_marker = trajectory(time_s) @ T_world_marker
    pose = np.concatenate(split_pose(T_cam_marker))
    side = float(np.linalg.norm(corners - np.roll(corners, 1, axis=0), axis=1).mean())
    ends = [project(K, trajectory(time_s + d), points[8]) for d in (-file.exposure_s / 2, file.exposure_s / 2)]
    blur = float(np.linalg.norm(ends[1] - ends[0]))
    limits = np.array([width, height]) - 1 - EDGE_PX
    facing = T_cam_marker[:3, 2] @ T_cam_marker[:3, 3] < 0
    in_frame = bool(facing and (plate > EDGE_PX).all() and (plate < limits).all())
    hidden = _hidden(K, trajectory, motion.occluder, plate, time_s, file.exposure_s) if in_frame else 0.0
    return [*corners.ravel(), *pose, side, blur, in_frame, hidden]


def _hidden(K, trajectory, occluder, plate, time_s, exposure_s):
    """Return the largest share of a plate's outline (4, 2) that the occluder covers during the exposure."""
    if occluder is None:
        return 0.0
    plate = np.ascontiguousarray(plate, np.float32)
    area = cv2.contourArea(plate)
    largest = 0.0
    for instant in time_s + exposure_s * np.linspace(-0.5, 0.5, INSTANTS):
        outline = _outline(K, trajectory(instant), occluder, instant)
        if outline is not None:
            largest = max(largest, cv2.intersectConvexConvex(outline, plate)[0] / area)
    return min(float(largest), 1.0)


def _outline(K, T_cam_world, occluder, t_s):
    """Return the outline in the image (n, 2) float32 of what of the occluder is before the camera, None if nothing."""
    w, d = occluder.width_m / 2, occluder.thickness_m / 2
    x, y = float(occluder_x_m(occluder, t_s)), occluder.y_m
    heights = np.linspace(0, occluder.height_m, HEIGHTS)
    box = np.array([[x + i * w, y + j * d, z] for i in (-1, 1) for j in (-1, 1) for z in heights])
    box = box[transform(T_cam_world, box)[:, 2] > NEAR_M]
    if not len(box):
        return None
    return cv2.convexHull(project(K, T_cam_world, box).astype(np.float32)).reshape(-1, 2)
