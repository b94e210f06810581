"""Put a camera's map of rays into the lens model of a format: as it is, or refitted, with what that costs in pixels."""

import contextlib
from dataclasses import replace

import numpy as np
from scipy.optimize import least_squares

from calibrations.lens import Calibration, project
from rig.errors import InputError

ACROSS, DOWN = 33, 25  # points of the frame that a fit is held to
EXACT_PX = 1e-3  # from here on a model with fewer coefficients is preferred
LARGEST_ERROR_PX = 0.5
MIN_SEEN = 0.5  # of the frame


def frame_points(width, height):
    """Return pixels (n, 2) evenly over a frame, its corners included."""
    x, y = np.meshgrid(np.linspace(0, width - 1, ACROSS), np.linspace(0, height - 1, DOWN))
    return np.stack([x.ravel(), y.ravel()], axis=1)


def refit(rays, pixels, start, lens, count, fixed=()):
    """Return (Calibration, RMS px, max px) of a lens model fitted to where rays (n, 2) land, pixels (n, 2).

    start  Calibration whose pinhole the fit starts at
    fixed  "aspect": fx and fy are one
    """
    one_focal = "aspect" in fixed
    own = start.coefficients if start.lens == lens else ()
    first = np.zeros(count)
    first[: min(count, len(own))] = own[:count]

    def made(values):
        fx, fy, cx, cy = (values[0], values[0], *values[1:3]) if one_focal else values[:4]
        return replace(
            start, fx=float(fx), fy=float(fy), cx=float(cx), cy=float(cy), lens=lens,
            coefficients=tuple(map(float, values[3 if one_focal else 4 :])),
        )  # fmt: skip

    def misses(values):
        return np.nan_to_num((project(made(values), rays) - pixels).ravel(), nan=1e6, posinf=1e6, neginf=-1e6)

    pinhole = [start.fx, start.cx, start.cy] if one_focal else [start.fx, start.fy, start.cx, start.cy]
    begin = np.array([*pinhole, *first])
    if np.abs(misses(begin)).max() < 1e-9:
        return made(begin), 0.0, 0.0
    scale = np.array([*(max(abs(v), 1.0) for v in pinhole), *np.full(count, 0.1)])
    fit = least_squares(misses, begin, jac="3-point", x_scale=scale, xtol=1e-15, ftol=1e-15, gtol=1e-15, max_nfev=200)
    lengths = np.linalg.norm(fit.fun.reshape(-1, 2), axis=1)
    return made(fit.x), float(np.sqrt(np.mean(lengths**2))), float(lengths.max())


def fitting(module, rays, pixels, start):
    """Return (Calibration, RMS px, max px) of the simplest of a format's models that is exact, else of the best one.

    The model that the camera has already is tried first.
    """
    held = sorted(module.HOLDS, key=lambda model: model != (start.lens, len(start.coefficients)))
    best = None
    for lens, count in held:
        found = refit(rays, pixels, start, lens, count, getattr(module, "FIXED", ()))
        if best is None or found[2] < best[2]:
            best = found
        if best[2] < EXACT_PX:
            break
    return best


def check_error(best, title, allowed_px):
    """Raise InputError where a refitted camera is farther off than what is allowed."""
    calibration, rms, largest = best
    if largest > allowed_px:
        raise InputError(
            f"{title} can't hold this lens: its best model, {calibration.lens} with {len(calibration.coefficients)} "
            f"coefficients, misses by up to {largest:.3g} px (RMS {rms:.3g}); --largest-error-px {largest + 0.01:.2f} "
            "writes it all the same"
        )


def rays_of_frame(calibration):
    """Return (rays (n, 2), pixels (n, 2)) of a Calibration, even over its frame: Gauss-Newton on its own projection.

    Raises InputError where there are rays to less than half of the frame: no camera is like that.
    """
    pixels = frame_points(calibration.width, calibration.height)
    pinhole = np.array([calibration.fx, calibration.fy])
    rays = (pixels - [calibration.cx, calibration.cy]) / pinhole
    step = 1e-6
    with np.errstate(all="ignore"), contextlib.suppress(np.linalg.LinAlgError):  # a lens that folds: no rays there
        for _ in range(50):
            landed = project(calibration, rays)
            error = pixels - landed
            if np.abs(error).max() < 1e-10:
                break
            J = np.stack([(project(calibration, rays + np.eye(2)[k] * step) - landed) / step for k in (0, 1)], axis=2)
            rays = rays + np.clip(np.linalg.solve(J, error[..., None])[..., 0], -0.3, 0.3)
    good = np.linalg.norm(project(calibration, rays) - pixels, axis=1) < 1e-6
    if good.mean() < MIN_SEEN:
        raise InputError(
            f"a calibration whose lens takes rays to {good.mean():.0%} of its frame only: is it one of this camera?"
        )
    return rays[good], pixels[good]


def pinhole_like(width, height, K):
    """Return the Calibration of a 3 x 3 matrix without distortion."""
    return Calibration(width, height, float(K[0, 0]), float(K[1, 1]), float(K[0, 2]), float(K[1, 2]))
