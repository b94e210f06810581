"""One marker of a sequence: as it is reported, and as a tracker follows it from frame to frame."""

from dataclasses import dataclass

import cv2
import numpy as np

from detectors.bart.motion import points_at, project
from detectors.contract import Detection


@dataclass(frozen=True, eq=False)
class Tracked(Detection):
    """A marker in a frame of a sequence.

    seen      False where it is bridged: extrapolated by its motion, through an occlusion
    poses     as measured, both planar ones (rvec, tvec, reprojection RMS); empty without K, code_m or when not seen
    rvec, tvec  ``T_cam_marker`` after filter and flip; None without K and code_m
    """

    seen: bool
    poses: list
    rvec: np.ndarray | None
    tvec: np.ndarray | None


class Track:
    """One marker's corners and their speed in the image, and its pose filter."""

    def __init__(self, detection, pose_filter, seen):
        self.name, self.id = detection.dictionary, detection.id
        self.corners = detection.corners
        self.speed = np.zeros((4, 2))  # pixels a second
        self.before = None  # corners, speed and pose (R, t or None) of the last frame
        self.along = True  # moved with the other markers when last seen
        self.coasted = False  # with the camera, in the present frame
        self.seen = seen  # in the present frame
        self.confirmed = seen  # False while found in an older frame only
        self.missed = 0  # frames since it was seen
        self.looked_for = -1  # the last frame in which there was time to
        self.unseen_s = 0.0
        self.filter = pose_filter
        self.poses = []

    def advance(self, dt):
        """Move on by ``dt`` seconds: where the marker is expected, and not yet seen."""
        known = self.filter is not None and self.filter.x is not None
        self.before = self.corners, self.speed, (self.filter.R, self.filter.x[:3]) if known else None
        self.corners = self.corners + dt * self.speed
        self.unseen_s += dt
        self.seen = self.coasted = False
        if self.filter is not None:
            self.filter.predict(dt)

    def points_before(self, K, dist):
        """Return the corners (4, 3) of the last frame in its camera's frame: as seen, at the depth of its pose."""
        corners, _, (R, t) = self.before
        return points_at(corners, self.filter.square @ R[2] + t[2], K, dist)

    def coast(self, motion, K, dist, dt):
        """Go on with the camera's motion (rotation, place) from where the marker was in the last frame."""
        corners, _, (R, t) = self.before
        turn = cv2.Rodrigues(motion[0])[0]
        self.corners = project(self.points_before(K, dist)[None], turn, motion[1], K, dist)[0]
        self.speed = (self.corners - corners) / dt
        self.filter.coast(R, t, *motion, dt)
        self.coasted = True

    def see(self, corners):
        """Take in the corners measured in the present frame."""
        if self.confirmed and self.unseen_s > 0:
            # Corners are exact, their speed is not: half of what was unexpected goes into it.
            self.speed = self.speed + 0.5 * (corners - self.corners) / self.unseen_s
        self.corners = corners
        self.seen = self.confirmed = True
        self.missed, self.unseen_s = 0, 0.0
        self.coasted = False

    def miss(self):
        """Note that the marker was not seen: it goes on, ever more slowly where nothing tells how."""
        self.missed += 1
        if not self.coasted:
            self.speed = 0.9 * self.speed
        self.poses = []
