"""From pixels to rays: the lens map inverted ray by ray, and the camera's pose row by row."""

import numpy as np
from numba import njit
from scipy.spatial.transform import Rotation


@njit(cache=True)
def _undo_brown(x, y, k1, k2, p1, p2):
    """Replace distorted (x, y) by the undistorted, in place: Newton on Brown's polynomial (OpenCV's k1, k2,
    p1, p2).
    """
    for n in range(x.size):
        xd, yd = x.flat[n], y.flat[n]
        u, v = xd, yd
        for _ in range(30):
            r2 = u * u + v * v
            g = 1.0 + r2 * (k1 + r2 * k2)
            dg = k1 + 2.0 * k2 * r2
            ex = u * g + 2.0 * p1 * u * v + p2 * (r2 + 2.0 * u * u) - xd
            ey = v * g + p1 * (r2 + 2.0 * v * v) + 2.0 * p2 * u * v - yd
            jxx = g + 2.0 * u * u * dg + 2.0 * p1 * v + 6.0 * p2 * u
            jxy = 2.0 * u * v * dg + 2.0 * p1 * u + 2.0 * p2 * v
            jyy = g + 2.0 * v * v * dg + 6.0 * p1 * v + 2.0 * p2 * u
            det = jxx * jyy - jxy * jxy
            su, sv = (jyy * ex - jxy * ey) / det, (jxx * ey - jxy * ex) / det
            u -= su
            v -= sv
            if su * su + sv * sv < 1e-24:
                break
        x.flat[n], y.flat[n] = u, v


def pixel_directions(u, v, camera, effects, channel):
    """Return camera-frame directions x, y (z = 1) seen at the pixel coordinates ``u``, ``v`` of channel 0, 1,
    2 (R, G, B).

    Undone in the order from sensor to scene: local warp, channel magnification, principal point and focal
    length, lens.
    """
    u, v = np.array(u, float), np.array(v, float)
    if warp := effects.get("local_warp"):
        centres, widths, pushes = (np.array(warp[k]) for k in ("centres_px", "widths_px", "pushes_px"))
        du, dv = np.zeros_like(u), np.zeros_like(v)
        for (cu, cv), width, (pu, pv) in zip(centres, widths, pushes, strict=True):
            bump = np.exp(-((u - cu) ** 2 + (v - cv) ** 2) / (2 * width**2))
            du, dv = du + pu * bump, dv + pv * bump
        u, v = u + du, v + dv
    magnification = 1.0
    if colour := effects.get("lateral_chromatic_aberration"):
        magnification = (colour["red"], 1.0, colour["blue"])[channel]
    shift = effects.get("principal_point", {"dx_px": 0.0, "dy_px": 0.0})
    focal = camera.fx * effects.get("focal_length", {"ratio": 1.0})["ratio"] * magnification
    # Channels grow about the optical axis, which goes through the true principal point.
    x = (u - camera.cx - shift["dx_px"]) / focal
    y = (v - camera.cy - shift["dy_px"]) / focal
    radial = effects.get("radial_distortion", {"model": "brown", "k1": 0.0, "k2": 0.0})
    tangential = effects.get("tangential_distortion", {"p1": 0.0, "p2": 0.0})
    k1, k2 = (radial["k1"], radial["k2"]) if radial["model"] == "brown" else (0.0, 0.0)
    if any((k1, k2, tangential["p1"], tangential["p2"])):
        x, y = np.ascontiguousarray(x), np.ascontiguousarray(y)
        _undo_brown(x, y, k1, k2, tangential["p1"], tangential["p2"])
    if radial["model"] == "division":
        # Fitzgibbon 2001: undistorted = distorted / (1 + lambda r_distorted^2).
        g = 1.0 + radial["lambda"] * (x * x + y * y)
        x, y = x / g, y / g
    return x, y


def corner_grid(camera, effects, channel, margin, fine):
    """Return the directions at the corners of the pixels, ``fine`` sub-pixels a side, ``margin`` pixels
    around the frame.
    """
    u = np.arange((camera.width + 2 * margin) * fine + 1) / fine - margin - 0.5
    v = np.arange((camera.height + 2 * margin) * fine + 1) / fine - margin - 0.5
    if not {"radial_distortion", "tangential_distortion", "local_warp"} & effects.keys() and (
        "rolling_shutter" not in effects or effects["rolling_shutter"]["model"] != "shear"
    ):
        x, _ = pixel_directions(u, np.zeros_like(u), camera, effects, channel)
        _, y = pixel_directions(np.zeros_like(v), v, camera, effects, channel)
        shape = (len(v), len(u))
        return np.ascontiguousarray(np.broadcast_to(x, shape)), np.ascontiguousarray(np.broadcast_to(y[:, None], shape))
    uu, vv = np.meshgrid(u, v)
    shutter = effects.get("rolling_shutter")
    if shutter and shutter["model"] == "shear":
        uu = uu - shutter["skew_px_per_row"] * (vv - camera.cy)
    return pixel_directions(uu, vv, camera, effects, channel)


def capture_pose(rotation, centre, effects):
    """Return R_cam_world and the centre (m) of a capture after the mount's offset, given in the nominal
    camera's frame.
    """
    if offset := effects.get("camera_pose_offset"):
        centre = centre + rotation.T @ np.array(offset["centre_cam_m"])
        rotation = Rotation.from_rotvec(offset["rotvec_cam_deg"], degrees=True).as_matrix() @ rotation
    return rotation, centre


def row_poses(rotation, centre, camera, effects, margin, fine):
    """Return R_cam_world (n, 3, 3) and centres (n, 3): one for a global shutter, one a (sub-)row for a moving
    camera.
    """
    shutter, fields = effects.get("rolling_shutter"), effects.get("interlacing")
    moving = (shutter and shutter["model"] == "moving camera") or fields
    if not moving:
        return rotation[None], centre[None]
    rows = np.arange((camera.height + 2 * margin) * fine) // fine - margin
    turn, slide = np.zeros((len(rows), 3)), np.zeros((len(rows), 3))
    if shutter:
        lines = (rows - camera.cy)[:, None]
        turn = lines * np.array(shutter["turn_rad_per_row"])
        slide = lines * np.array(shutter["slide_m_per_row"])
    if fields:
        turn = turn + ((rows % 2) - 0.5)[:, None] * np.array(fields["turn_rad_between_fields"])
    return Rotation.from_rotvec(turn).as_matrix() @ rotation, centre + slide @ rotation
