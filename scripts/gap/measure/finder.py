"""OpenCV's ArUco as it comes, on the codes of the rig: which are in an image, where, and at which pose.

Families that have no OpenCV dictionary are found by a detector that reads them (detectors.contract.finders_of).
"""

import cv2
import numpy as np
from scipy.spatial.transform import Rotation

from detectors import contract
from detectors._opencv import OpenCvDetector
from gap.measure.capture import grey_of
from markers.contract import drawing_of
from rig.geometry import rotation_angle_deg
from rig.plates import marker_corners_plate


class Finder:
    """Finds the codes of a scene's plates in real and twin images alike; no work on a detector under test moves it."""

    def __init__(self, scene, codes, K):
        self.index = {p.name: k for k, p in enumerate(scene.plates)}
        self.half_code = codes.half_code
        self.cells = [_side_of_cells(p.name) for p in scene.plates]
        families = sorted({name.split("/")[0] for name in self.index})
        others = contract.finders_of(families)
        usual = [family for family in families if family not in others]
        self.detectors = [OpenCvDetector(usual, cv2.aruco.DetectorParameters())] if usual else []
        self.detectors += [contract.make(name, [family]) for family, name in others.items()]
        self.K = K

    def corners(self, image):
        """Return {plate index: corners (4, 2) in pixels} of the cells of the codes in a grey-level image (H, W, C)."""
        grey = np.clip(np.rint(grey_of(image)), 0, 255).astype(np.uint8)
        seen = [d for detector in self.detectors for d in detector.detect(grey)]
        found = {self.index.get(f"{d.dictionary}/{d.id}"): d.corners for d in seen}
        found.pop(None, None)
        return {k: _enlarged(corners, self.cells[k]) for k, corners in found.items()}

    def find(self, image):
        """Return {plate index: [(R (3, 3), t (3,)), ...] both planar poses} of a grey-level image (H, W, C)."""
        return {
            k: [
                (Rotation.from_rotvec(np.ravel(r)).as_matrix(), np.ravel(t))
                for r, t, _ in contract.estimate_poses(corners, 2 * self.half_code[k], self.K)
            ]
            for k, corners in self.corners(image).items()
        }

    @staticmethod
    def compare(real, twin, available):
        """Return counts and pose differences of two findings; of planar ambiguities the closest pair counts."""
        wanted = np.flatnonzero(available)
        disagree = sum((k in real) != (k in twin) for k in wanted)
        distance, rotation = [], []
        for k in wanted:
            if real.get(k) and twin.get(k):
                pairs = [(rotation_angle_deg(a[0], b[0]), a, b) for a in real[k] for b in twin[k]]
                angle, a, b = min(pairs, key=lambda p: p[0])
                rotation.append(angle)
                distance.append(100 * abs(np.linalg.norm(a[1]) - np.linalg.norm(b[1])))
        return {
            "available": len(wanted),
            "disagree": disagree,
            "distance": np.array(distance),
            "rotation": np.array(rotation),
        }


def _side_of_cells(name):
    """Return the side of all cells of a plate's code, in sides of the square whose corners trackers report."""
    family, number = name.split("/")
    lines = drawing_of(family, int(number)).lines
    return 1.0 if lines is None else 2 * float(lines[-1])


def _enlarged(corners, times):
    """Return the corners (4, 2) in an image of a square so many times as large as the one of these, about its middle."""
    if times == 1:
        return corners
    square = np.float32(marker_corners_plate(1.0)[:, :2])
    homography = cv2.getPerspectiveTransform(square, np.float32(corners))
    return cv2.perspectiveTransform(times * square[None], homography)[0].astype(float)
