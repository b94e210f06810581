"""Camera calibration from board points: pinhole, 5 and 8 coefficients, with uncertainties (cv2.calibrateCameraExtended)."""

import cv2
import numpy as np

from rig.geometry import make_pose

NO_DISTORTION = cv2.CALIB_ZERO_TANGENT_DIST | cv2.CALIB_FIX_K1 | cv2.CALIB_FIX_K2 | cv2.CALIB_FIX_K3
MODELS = {"pinhole": NO_DISTORTION, "5": 0, "8": cv2.CALIB_RATIONAL_MODEL}
NAMES = ("fx", "fy", "cx", "cy", "k1", "k2", "p1", "p2", "k3", "k4", "k5", "k6")
LEAST_VIEWS = 3


def calibrate(views, size, flags, K=None):
    """Fit one model to views [BoardPoints] of an image size (width, height).

    Return {"rms_px", "parameters", "se", "views_rms_px", "poses"}; poses are T_cam_board (4, 4).
    """
    board = [v.board.astype(np.float32) for v in views]
    image = [v.image.astype(np.float32) for v in views]
    rms, K, dist, rvecs, tvecs, se, _, per_view = cv2.calibrateCameraExtended(
        board, image, size, K, None, flags=flags | (cv2.CALIB_USE_INTRINSIC_GUESS if K is not None else 0)
    )
    count = 8 if flags & cv2.CALIB_RATIONAL_MODEL else 5
    values = [K[0, 0], K[1, 1], K[0, 2], K[1, 2], *np.ravel(dist)[:count]]
    return {
        "rms_px": float(rms),
        "parameters": dict(zip(NAMES, map(float, values), strict=False)),
        "se": dict(zip(NAMES, map(float, np.ravel(se)[: 4 + count]), strict=False)),
        "views_rms_px": [float(v) for v in np.ravel(per_view)],
        "poses": [make_pose(np.ravel(r), np.ravel(t)) for r, t in zip(rvecs, tvecs, strict=True)],
    }


def calibrate_all(views, size):
    """Return {model: fit} of MODELS, empty with fewer than three views."""
    if len(views) < LEAST_VIEWS:
        return {}
    return {name: calibrate(views, size, flags) for name, flags in MODELS.items()}


def ideal_pinhole(views, size):
    """Fit the ideal twin of unknown intrinsics: fx = fy, principal point in the centre of the image, no distortion."""
    width, height = size
    f = 1.2 * max(size)
    K = np.array([[f, 0, (width - 1) / 2], [0, f, (height - 1) / 2], [0, 0, 1]])
    flags = NO_DISTORTION | cv2.CALIB_FIX_PRINCIPAL_POINT | cv2.CALIB_FIX_ASPECT_RATIO
    return calibrate(views, size, flags, K)
