"""How the camera moved from one frame to the next, told by the markers that are seen; the others coast with it."""

import cv2
import numpy as np

from kernels import njit

STRAY_PX = 2.0  # RMS of a marker's corners: more, and it does not move with the others
STRAY_SHARE = 0.3  # of the others' speed: as much may a marker differ and still go with them
MIN_MARKERS = 2  # one marker's tilt is too uncertain to tell where another has gone


@njit(cache=True, nogil=True)
def sides_moved(corners, speed, dt):
    """Return by how many of its mean sides a marker moves in ``dt``; corners (4, 2) pixels, their speeds a second."""
    around = 0.0
    for k in range(4):
        j = (k + 1) % 4
        around += np.sqrt((corners[j, 0] - corners[k, 0]) ** 2 + (corners[j, 1] - corners[k, 1]) ** 2)
    vx, vy = speed[:, 0].mean(), speed[:, 1].mean()
    return dt * np.sqrt(vx**2 + vy**2) / max(around / 4, 1.0)


def points_at(corners, depth, K, dist):
    """Return the points (n, 3) of the camera's frame that are seen at pixels (n, 2) at depths (n,), metres."""
    rays = cv2.undistortPoints(np.ascontiguousarray(corners, float).reshape(-1, 1, 2), K, dist).reshape(-1, 2)
    return np.column_stack([rays, np.ones(len(rays))]) * depth[:, None]


def rigid_motion(points, corners, K, dist):
    """Return (rotation 3 x 3, translation (3,)) from the last frame's camera to this one's, or None.

    points   (m, 4, 3) metres, corners of markers in the last frame's camera
    corners  (m, 4, 2) pixels, where they are seen now
    The pose that reprojects best (Levenberg-Marquardt); markers that move otherwise than most are left out. None where
    fewer than MIN_MARKERS agree.
    """
    good = np.ones(len(points), bool)
    for _ in range(2):
        if good.sum() < MIN_MARKERS:
            return None
        _, turn, place = cv2.solvePnP(
            points[good].reshape(-1, 3), corners[good].reshape(-1, 2), K, dist, np.zeros(3), np.zeros(3), True
        )
        off = project(points, turn, place, K, dist) - corners
        off = np.sqrt((off**2).sum(axis=2).mean(axis=1))
        if (off[good] <= STRAY_PX).all():
            return cv2.Rodrigues(turn)[0], place.ravel()
        good = off <= max(STRAY_PX, float(np.median(off)))
    return None


def project(points, turn, place, K, dist):
    """Return the pixels (m, 4, 2) of points (m, 4, 3) after a rotation vector and a translation."""
    return cv2.projectPoints(points.reshape(-1, 3), turn, place, K, dist)[0].reshape(len(points), 4, 2)


def goes_along(centre, speed, centres, speeds, dt):
    """Return whether a marker at ``centre`` (2,) moved with others (m, 2): speeds in pixels a second.

    Speeds of a rig in view change evenly over the image: a plane through those of the others tells what is expected.
    """
    if len(centres) < 3:
        return True
    columns = np.column_stack([np.ones(len(centres)), centres])
    expected = np.append(1.0, centre) @ np.linalg.lstsq(columns, speeds, rcond=None)[0]
    return float(np.linalg.norm(speed - expected)) * dt <= STRAY_PX + STRAY_SHARE * float(np.linalg.norm(expected)) * dt
