"""Camera calibration from board points: pinhole, 5 and 8 coefficients, with uncertainties (OpenCV, Zhang 2000)."""

import cv2
import numpy as np

from rig.errors import InputError
from rig.geometry import camera_matrix

NO_DISTORTION = cv2.CALIB_ZERO_TANGENT_DIST | cv2.CALIB_FIX_K1 | cv2.CALIB_FIX_K2 | cv2.CALIB_FIX_K3
MODELS = {"pinhole": NO_DISTORTION, "5": 0, "8": cv2.CALIB_RATIONAL_MODEL}
INTRINSICS = ("fx", "fy", "cx", "cy")
NAMES = (*INTRINSICS, "k1", "k2", "p1", "p2", "k3", "k4", "k5", "k6")
MIN_VIEWS = 3
STARTS = (0.6, 0.9, 1.2, 2.0)  # focal lengths tried, in widths: the constrained fit has local minima


def calibrate(views, size, flags, K=None, distortion=None):
    """Fit one model to views, a dict of register.boards.BoardPoints, of an image size (width, height).

    K (3, 3) and distortion are where the fit starts; without K OpenCV finds a start, for flat boards only.
    Return {"rms_px", "parameters", "se", "views_rms_px"}: the RMS length of the residuals, over all and a view,
    and one standard deviation of each parameter. Raises InputError where OpenCV finds no camera for the points.
    """
    board = [v.board.astype(np.float32) for v in views.values()]
    image = [v.image.astype(np.float32) for v in views.values()]
    flags |= cv2.CALIB_USE_INTRINSIC_GUESS if K is not None else 0
    K = None if K is None else K.copy()  # OpenCV fits in place
    try:
        rms, K, dist, _, _, se, _, per_view = cv2.calibrateCameraExtended(
            board, image, size, K, distortion, flags=flags
        )
    except cv2.error as error:
        raise InputError(
            f"no camera sees the board's points where the photographs show them ({error.err}): compare the description of "
            "the board with the print, and take photographs from different sides"
        ) from None
    count = 8 if flags & cv2.CALIB_RATIONAL_MODEL else 5
    values = [K[0, 0], K[1, 1], K[0, 2], K[1, 2], *np.ravel(dist)[:count]]
    return {
        "rms_px": float(rms),
        "parameters": dict(zip(NAMES, map(float, values), strict=False)),
        "se": dict(zip(NAMES, map(float, np.ravel(se)[: 4 + count]), strict=False)),
        "views_rms_px": dict(zip(views, map(float, np.ravel(per_view)), strict=True)),
    }


def matrix_of(fit):
    """Return the camera matrix (3, 3) of a fit."""
    return camera_matrix(*[fit["parameters"][k] for k in INTRINSICS])


def calibrate_all(views, size, K=None):
    """Return {model: fit} of MODELS, empty with fewer than three views.

    A model that holds the one before it and still fits worse has stuck: it is fitted again from there.
    """
    fits, before = {}, None
    for name, flags in MODELS.items() if len(views) >= MIN_VIEWS else ():
        fit = calibrate(views, size, flags, K)
        if before and fit["rms_px"] > before["rms_px"]:
            distortion = np.array([before["parameters"][k] for k in NAMES[4:9]])
            if flags & cv2.CALIB_RATIONAL_MODEL:
                distortion = np.concatenate([distortion, np.zeros(3)])
            fit = min(fit, calibrate(views, size, flags, matrix_of(before), distortion), key=lambda f: f["rms_px"])
        fits[name] = before = fit
    return fits


def ideal_pinhole(views, size, exif_px=None):
    """Fit the ideal twin of unknown intrinsics: fx = fy, principal point in the centre of the image, no distortion.

    exif_px is the focal length in pixels that EXIF says, from which a fit starts as well; None where it says nothing.
    """
    width, height = size
    flags = NO_DISTORTION | cv2.CALIB_FIX_PRINCIPAL_POINT | cv2.CALIB_FIX_ASPECT_RATIO
    fits = []
    for f in [*([exif_px] if exif_px else []), *(start * max(size) for start in STARTS)]:
        fits.append(calibrate(views, size, flags, camera_matrix(f, f, (width - 1) / 2, (height - 1) / 2)))
    return min(fits, key=lambda fit: fit["rms_px"])


def guess(size, exif_px=None):
    """Return plain intrinsics with which a coverage of 0 can be reported: nothing can be fitted, EXIF says what is known."""
    return [float(exif_px or max(size))] * 2 + [(size[0] - 1) / 2, (size[1] - 1) / 2]


def ideal_intrinsics(views, boards_of_folder, size, messages, exif_px=None):
    """Return (fx, fy, cx, cy) of the ideal twin where nothing is known, from the captures or else the calibration, or EXIF."""
    for source in (views, boards_of_folder):
        if len(source) >= MIN_VIEWS:
            fit = ideal_pinhole(source, size, exif_px)
            messages.append(f"ideal pinhole fitted to {len(source)} images: residual {fit['rms_px']:.3f} px")
            return [fit["parameters"][k] for k in INTRINSICS]
    used = "EXIF's focal length" if exif_px else "a guess"
    messages.append(f"intrinsics unknown and fewer than {MIN_VIEWS} images to fit them: {used} is used")
    return guess(size, exif_px)
