"""A first idea of where loose markers lie and where photographs were taken from, to start a bundle adjustment at.

One marker alone has two poses that look nearly alike (IPPE, Collins and Bartoli 2014); what several photographs agree on
tells which. From the marker that is seen most, others are added as photographs show them together.
"""

import cv2
import numpy as np

from register.registration import pose_from_markers
from rig.geometry import invert_pose, make_pose, project
from rig.plates import marker_corners_plate
from start.bundle import BEHIND_PX

MAX_TRIED = 12  # photographs from which a marker's pose is proposed


def first_poses(sightings, side_m, Ks):
    """Return (T_cam_world of each photograph, T_world_marker of each marker) as dicts by number; what stays unconnected lacks.

    Ks  a camera matrix (3, 3) for each camera; the world is the frame of the marker that is seen most
    """
    counts = np.bincount(sightings.marker)
    reference = int(np.argmax(counts))
    seen = _Seen(sightings, side_m, Ks)
    markers, views = {reference: np.eye(4)}, {}
    partner = seen.partner(reference)
    if partner is None:
        return views, markers
    markers[partner] = seen.relative(reference, partner)
    while True:
        found = seen.views_of(markers, views, 2) or seen.views_of(markers, views, 1)
        views |= found
        more = seen.markers_of(markers, views, 2) or seen.markers_of(markers, views, 1)
        markers |= more
        if not found and not more:
            return views, markers


class _Seen:
    """Sightings by photograph and marker, each with the two poses that its four corners allow."""

    def __init__(self, sightings, side_m, Ks):
        self.side_m, self.plate = side_m, marker_corners_plate(side_m)
        self.K = [Ks[c] for c in sightings.camera]
        self.quads, self.poses = {}, {}
        for view, marker, quad in zip(sightings.view, sightings.marker, sightings.quads, strict=True):
            _, rvecs, tvecs, _ = cv2.solvePnPGeneric(
                self.plate, np.ascontiguousarray(quad, float), self.K[view], None, flags=cv2.SOLVEPNP_IPPE_SQUARE
            )
            self.quads[view, marker] = quad
            self.poses[view, marker] = [make_pose(r.ravel(), t.ravel()) for r, t in zip(rvecs, tvecs, strict=True)]
        self.views_with = {int(m): [v for v, k in self.quads if k == m] for m in np.unique(sightings.marker)}
        self.markers_in = {int(v): [k for w, k in self.quads if w == v] for v in np.unique(sightings.view)}

    def partner(self, marker):
        """Return the marker that is seen most often together with one, None where none is."""
        both = [m for v in self.views_with[marker] for m in self.markers_in[v] if m != marker]
        return max(sorted(set(both)), key=both.count) if both else None

    def errors_px(self, view, marker, T_cam_marker):
        """Return the RMS distances (n,) of corners from where poses (n, 4, 4) have them."""
        points = self.plate @ np.swapaxes(T_cam_marker[:, :3, :3], 1, 2) + T_cam_marker[:, None, :3, 3]
        off = project(self.K[view], np.eye(4), points) - self.quads[view, marker]
        return np.sqrt((np.nan_to_num(off, nan=BEHIND_PX) ** 2).mean(axis=(1, 2)))

    def relative(self, a, b):
        """Return T_a_b (4, 4) of two markers: of all pairs of their poses the one that most photographs agree with."""
        shared = [v for v in self.views_with[a] if (v, b) in self.quads]
        proposals = [
            invert_pose(Ta) @ Tb for v in shared[:MAX_TRIED] for Ta in self.poses[v, a] for Tb in self.poses[v, b]
        ]
        return self._best(proposals, [(v, b, self.poses[v, a]) for v in shared])

    def _best(self, proposals, places):
        """Return the pose in the world that fits best at (photograph, marker, possible T_cam_world), by the median."""

        T = np.array(proposals)
        errors = [np.min([self.errors_px(v, m, Tc @ T) for Tc in cameras], axis=0) for v, m, cameras in places]
        return T[int(np.argmin(np.median(errors, axis=0)))]

    def views_of(self, markers, views, least):
        """Return {photograph: T_cam_world} of those that show at least so many markers of known pose."""
        found = {}
        for view, shown in self.markers_in.items():
            known = [m for m in shown if m in markers]
            if view in views or len(known) < least:
                continue
            world = [self.plate @ markers[m][:3, :3].T + markers[m][:3, 3] for m in known]
            quads = [self.quads[view, m] for m in known]
            T = pose_from_markers(world, quads, self.K[view], [self.side_m] * len(known))
            if T is not None:
                found[view] = T
        return found

    def markers_of(self, markers, views, least):
        """Return {marker: T_world_marker} of those that at least so many photographs of known pose show."""
        found = {}
        for marker, shown in self.views_with.items():
            known = [v for v in shown if v in views]
            if marker in markers or len(known) < least:
                continue
            proposals = [invert_pose(views[v]) @ T for v in known[:MAX_TRIED] for T in self.poses[v, marker]]
            found[marker] = self._best(proposals, [(v, marker, [views[v]]) for v in known])
        return found
