"""What may be hidden: the 29 effects of the library's list, and ten outside it (outside.py), each drawn at a strength in
physical units.

``strength`` 1 is *clear*: comfortably visible on this rig. Deviations from the ideal are proportional to it,
so that 0.25, 0.5, 1, 2 make a power curve. Parameters are plain numbers, strings and lists: what is drawn is
what the sealed truth holds.
"""

import numpy as np

from generator import nominal
from generator.draws import direction, sign
from generator.outside import OUTSIDE

# scene


def camera_pose_offset(rng, s, camera):
    """Mounted off its place: the centre by 10 to 20 mm, turned by 1.0 to 1.8 degrees, in the nominal camera's
    frame.
    """
    return {
        "centre_cam_m": s * rng.uniform(0.010, 0.020) * direction(rng, 3),
        "rotvec_cam_deg": s * rng.uniform(1.0, 1.8) * direction(rng, 3),
    }


def marker_scale(rng, s, camera):
    """Codes printed 2.5 to 5 % too large or too small."""
    return {"scale": 1 + s * sign(rng) * rng.uniform(0.025, 0.05)}


def rail_sag(rng, s, camera):
    """Plates on an arc of a circle through y = 0 and y = 2.1 m at height 0, 8 to 18 mm below (or above) it in
    the middle.
    """
    return {"sag_m": s * sign(rng) * rng.uniform(0.008, 0.018), "y_start_m": 0.0, "y_end_m": 2.1}


def ink_spread(rng, s, camera):
    """The outline of black moved outwards by 0.35 to 0.8 mm (Euclidean: outer corners round off), or
    inwards.
    """
    return {"spread_m": s * sign(rng) * rng.uniform(0.00035, 0.0008)}


def ink_reflectance(rng, s, camera):
    """White paper 10 to 20 % darker than nominal, black ink 0.03 to 0.06 brighter."""
    return {
        "white": max(0.8 * (1 - s * rng.uniform(0.10, 0.20)), 0.2),
        "black": 0.05 + s * rng.uniform(0.03, 0.06),
    }


def illumination_gradient(rng, s, camera):
    """A share 0.45 to 0.65 of the light comes from a lamp 1.2 to 1.8 m up, beside or beyond the rig."""
    angle = rng.uniform(0, 2 * np.pi)
    return {
        "share": min(s * rng.uniform(0.45, 0.65), 1.0),
        "x_m": 1.5 * np.cos(angle),
        "y_m": 1.0 + 1.5 * np.sin(angle),
        "z_m": rng.uniform(1.2, 1.8),
    }


def specular_highlight(rng, s, camera):
    """A lamp whose glossy reflection wanders over the plates in the middle of the rail as the camera
    rises.
    """
    return {
        "strength": s * rng.uniform(0.15, 0.35),
        "exponent": rng.uniform(60, 250),
        "x_m": rng.uniform(-0.6, 0.6),
        "y_m": rng.uniform(2.0, 3.5),
        "z_m": rng.uniform(1.2, 2.0),
    }


# lens


def focal_length(rng, s, camera):
    """Focal length 1.5 to 4 % off."""
    return {"ratio": 1 + s * sign(rng) * rng.uniform(0.015, 0.04)}


def principal_point(rng, s, camera):
    """Principal point 10 to 25 px off (of 960 px width)."""
    shift = s * rng.uniform(10, 25) * camera.width / 960 * direction(rng, 2)
    return {"dx_px": shift[0], "dy_px": shift[1]}


def radial_distortion(rng, s, camera):
    """Displaced by 4 to 9 % of the radius in the corners: Brown's polynomial, or a quarter of the time a
    division model.
    """
    r2 = (camera.corner_px / camera.fx) ** 2
    corner = s * sign(rng) * rng.uniform(0.04, 0.09)
    if rng.random() < 0.25:
        return {"model": "division", "lambda": -corner / r2}
    tail = rng.uniform(-0.25, 0.25)
    return {"model": "brown", "k1": corner * (1 - tail) / r2, "k2": corner * tail / r2**2}


def tangential_distortion(rng, s, camera):
    """Decentring p1, p2 that moves the corners by 5 to 11 px (of 960 px width)."""
    r2 = (camera.corner_px / camera.fx) ** 2
    size = s * rng.uniform(5, 11) * camera.width / 960 / (2 * camera.fx * r2)
    p = size * direction(rng, 2)
    return {"p1": p[0], "p2": p[1]}


def lateral_chromatic_aberration(rng, s, camera):
    """Red and blue magnified by 0.15 to 0.35 % more or less than green, mostly to opposite sides."""
    side = sign(rng)
    return {
        "red": 1 + s * side * rng.uniform(0.0015, 0.0035),
        "blue": 1 - s * side * rng.uniform(0.0005, 0.0035),
    }


def lens_blur(rng, s, camera):
    """Gaussian point spread, sigma 0.8 to 1.6 px."""
    return {"sigma_px": s * rng.uniform(0.8, 1.6)}


def defocus(rng, s, camera):
    """Thin lens focused at 0.5 to 2 m; the disc for a point 0.6 m away or at 2 m has a radius of 2 to
    3.5 px.
    """
    focus = rng.uniform(0.5, 2.0)
    worst = max(abs(1 / 0.6 - 1 / focus), abs(1 / 2.0 - 1 / focus))
    return {"focus_m": focus, "aperture_m": s * 2 * rng.uniform(2.0, 3.5) / (camera.fx * worst)}


def field_curvature(rng, s, camera):
    """Sharp in the centre, a disc that grows with the square of the image radius to 2.5 to 5 px in the
    corners.
    """
    return {"corner_radius_px": s * rng.uniform(2.5, 5.0)}


def vignetting(rng, s, camera):
    """A power of the cosine of the field angle, 20 to 45 % darker in the corners."""
    falloff = min(s * rng.uniform(0.20, 0.45), 0.9)
    tangent2 = (camera.corner_px / camera.fx) ** 2
    return {"power": -2 * np.log(1 - falloff) / np.log(1 + tangent2), "corner_falloff": falloff}


def veiling_glare(rng, s, camera):
    """5 to 14 % of the image's light spread over all of it."""
    return {"share": s * rng.uniform(0.05, 0.14)}


# shutter


def motion_blur(rng, s, camera):
    """Straight uniform motion of 3 to 6 px."""
    return {"length_px": s * rng.uniform(3.0, 6.0), "angle_deg": rng.uniform(0, 180)}


def rolling_shutter(rng, s, camera):
    """Rows read one after the other: a uniform shear, or a camera that turns (mostly pans) and slides; 0.006
    to 0.014 px a row.
    """
    skew = s * sign(rng) * rng.uniform(0.006, 0.014)
    if rng.random() < 0.5:
        return {"model": "shear", "skew_px_per_row": skew}
    return {
        "model": "moving camera",
        "turn_rad_per_row": [0.0, skew / camera.fx, 0.0],
        "slide_m_per_row": [s * rng.uniform(-1, 1) * 2e-6, 0.0, 0.0],
    }


# sensor


def exposure(rng, s, camera):
    """15 to 30 % too dark, or 12 to 35 % too bright (white clips)."""
    change = -rng.uniform(0.15, 0.30) if rng.random() < 0.5 else rng.uniform(0.12, 0.35)
    return {"scale": max(1 + s * change, 0.1)}


def sensor_noise(rng, s, camera):
    """Shot noise of a full well of 600 to 2500 electrons and 5 to 15 electrons of read noise."""
    return {"full_well_e": rng.uniform(600, 2500) / s**2, "read_noise_e": rng.uniform(5, 15) / s}


def fixed_pattern_noise(rng, s, camera):
    """Gain of each pixel 1.2 to 2.5 % and offset of each column 0.002 to 0.005 of full scale, the same in
    every capture.
    """
    return {
        "pixel_gain_std": s * rng.uniform(0.012, 0.025),
        "column_offset_std": s * rng.uniform(0.002, 0.005),
    }


def bayer_demosaic(rng, s, camera):
    """Bayer mosaic, bilinear or Malvar interpolation; a strength below 1 blends with the full image (no such
    thing above 1).
    """
    return {
        "method": str(rng.choice(["bilinear", "malvar"])),
        "first_red": [int(k) for k in rng.integers(0, 2, 2)],
        "share": min(s, 1.0),
    }


# processing


def colour_balance(rng, s, camera):
    """White balance in linear light: red and blue off by 6 to 15 %, green kept."""
    side = sign(rng)
    return {
        "red": 1 + s * side * rng.uniform(0.06, 0.15),
        "green": 1.0,
        "blue": 1 - s * side * rng.uniform(0.06, 0.15),
    }


def tone_curve(rng, s, camera):
    """A monotone spline on encoded values through 0 and 255, bent by 10 to 20 DN: an arch, or an S."""
    x = np.array([0.0, 64.0, 128.0, 192.0, 255.0])
    shape = np.array([0, 0.8, 1, 0.7, 0]) if rng.random() < 0.5 else np.array([0, -1.0, 0, 0.9, 0])
    y = x + s * sign(rng) * rng.uniform(10, 20) * shape
    return {"in_dn": x, "out_dn": np.maximum.accumulate(np.clip(y, 0, 255))}


def sharpening(rng, s, camera):
    """Unsharp mask: 0.5 to 1.2 times the difference from a Gaussian of 0.8 to 1.6 px."""
    return {"amount": s * rng.uniform(0.5, 1.2), "sigma_px": rng.uniform(0.8, 1.6)}


def denoising(rng, s, camera):
    """Bilateral filter of 12 to 30 DN, 1.2 to 2.2 px; or, less often, a 3 x 3 median."""
    if rng.random() < 0.25:
        return {"method": "median", "share": min(s, 1.0)}
    return {
        "method": "bilateral",
        "radius_px": 3,
        "sigma_px": rng.uniform(1.2, 2.2),
        "sigma_dn": s * rng.uniform(12, 30),
    }


def jpeg_compression(rng, s, camera):
    """libjpeg at a quantisation 1.2 to 2.8 times the standard tables' (quality 42 to 18), with or without
    colour subsampling.
    """
    coarseness = 100 * s * rng.uniform(1.2, 2.8)
    quality = (200 - coarseness) / 2 if coarseness < 100 else 5000 / coarseness
    return {
        "quality": int(np.clip(round(quality), 1, 99)),
        "subsampling": str(rng.choice(["4:4:4", "4:2:0"])),
    }


def local_warp(rng, s, camera):
    """Five smooth bumps, the largest displacement 2.5 to 5 px (of 960 px width): output pixel u shows the
    ideal u + push.
    """
    n = 5
    pushes = np.array([direction(rng, 2) for _ in range(n)]) * rng.uniform(0.5, 1.0, (n, 1))
    pushes *= s * rng.uniform(2.5, 5.0) * camera.width / 960 / np.linalg.norm(pushes, axis=1).max()
    return {
        "centres_px": rng.uniform(0, 1, (n, 2)) * [camera.width, camera.height],
        "widths_px": rng.uniform(0.12, 0.25, n) * camera.width,
        "pushes_px": pushes,
    }


_SCENE = (camera_pose_offset, marker_scale, rail_sag, ink_spread, ink_reflectance, illumination_gradient,
          specular_highlight)  # fmt: skip
_LENS = (focal_length, principal_point, radial_distortion, tangential_distortion,
         lateral_chromatic_aberration, lens_blur, defocus, field_curvature, vignetting,
         veiling_glare)  # fmt: skip
_SHUTTER = (motion_blur, rolling_shutter)
_SENSOR = (exposure, sensor_noise, fixed_pattern_noise, bayer_demosaic)
_PROCESSING = (colour_balance, tone_curve, sharpening, denoising, jpeg_compression, local_warp)

LIBRARY = {f.__name__: f for f in _SCENE + _LENS + _SHUTTER + _SENSOR + _PROCESSING}


def _plain(value):
    if isinstance(value, dict):
        return {k: _plain(v) for k, v in value.items()}
    if isinstance(value, (list, tuple, np.ndarray)):
        return [_plain(v) for v in value]
    return value.item() if isinstance(value, np.generic) else value


def draw_effect(name, strength, camera, seed_name):
    """Return parameters of effect ``name`` drawn at ``strength`` (1: clear) for a ``nominal.Camera``;
    KeyError if unknown.
    """
    draw = LIBRARY.get(name) or OUTSIDE[name]
    return _plain(draw(nominal.rng_of("effect", name, seed_name), float(strength), camera))


# Our parameters are the usual ones; the keys that are handed on.
_SAME = {
    "camera_pose_offset": ("centre_cam_m", "rotvec_cam_deg"),
    "marker_scale": ("scale",),
    "rail_sag": ("sag_m",),
    "ink_spread": ("spread_m",),
    "ink_reflectance": ("white", "black"),
    "focal_length": ("ratio",),
    "principal_point": ("dx_px", "dy_px"),
    "tangential_distortion": ("p1", "p2"),
    "lateral_chromatic_aberration": ("red", "blue"),
    "lens_blur": ("sigma_px",),
    "field_curvature": ("corner_radius_px",),
    "vignetting": ("corner_falloff",),
    "veiling_glare": ("share",),
    "motion_blur": ("length_px", "angle_deg"),
    "exposure": ("scale",),
    "sensor_noise": ("full_well_e", "read_noise_e"),
    "fixed_pattern_noise": ("pixel_gain_std", "column_offset_std"),
    "colour_balance": ("red", "green", "blue"),
    "sharpening": ("amount", "sigma_px"),
    "jpeg_compression": ("quality",),
}


def library_parameters(name, p, camera):
    """Return the parameters in the usual conventions (docs/blind-trials.md), None where none maps exactly."""
    if name in _SAME:
        usual = {key: p[key] for key in _SAME[name]}
        if name == "sensor_noise":  # variance of linear values = slope x value + offset (EMVA 1288)
            usual["variance_slope"] = 1 / p["full_well_e"]
            usual["variance_offset"] = (p["read_noise_e"] / p["full_well_e"]) ** 2
        return usual
    if name == "radial_distortion" and p["model"] == "brown":
        return {"k1": p["k1"], "k2": p["k2"]}
    if name == "rolling_shutter" and p["model"] == "shear":
        return {"skew_px_per_row": p["skew_px_per_row"]}
    if name == "defocus":
        return {"focus_m": p["focus_m"], "blur_diameter_px_m": p["aperture_m"] * camera.fx}
    return None
