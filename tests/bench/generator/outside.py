"""Ten effects outside the library, each drawn at a strength in physical units as those of vocabulary.py."""

import numpy as np

from generator.draws import sign


def lens_flare(rng, s, camera):
    """Ghost discs on a line through the centre and a star, from a light outside the picture, the same in
    every capture.
    """
    angle, reach = rng.uniform(0, 2 * np.pi), rng.uniform(0.25, 0.4) * camera.width
    ghosts = [
        [
            camera.cx + k * reach * np.cos(angle),
            camera.cy + 0.5 * k * reach * np.sin(angle),
            camera.width * rng.uniform(0.03, 0.09),
            s * rng.uniform(0.08, 0.16),
        ]
        for k in (-0.9, -0.35, 0.4)
    ]
    star = [
        camera.cx + 1.1 * reach * np.cos(angle),
        camera.cy + 0.55 * reach * np.sin(angle),
        0.08 * camera.width,
        s * rng.uniform(0.3, 0.5),
    ]
    return {"ghosts": ghosts, "star": star}


def plate_curl(rng, s, camera):
    """Every plate bent to an arch (or a trough), its middle 4 to 8 mm off its edges."""
    return {"rise_m": s * sign(rng) * rng.uniform(0.004, 0.008), "axis": int(rng.integers(0, 2))}


def mains_flicker(rng, s, camera):
    """Rows brighter and darker by 6 to 12 %, a period of 110 to 260 rows, a new phase in every capture."""
    return {"depth": s * rng.uniform(0.06, 0.12), "period_rows": rng.uniform(110, 260)}


def hot_pixels(rng, s, camera):
    """0.3 to 0.8 % of the pixels stuck at full or at nothing, the same in every capture."""
    return {"share": s * rng.uniform(0.003, 0.008)}


def print_skew(rng, s, camera):
    """Codes printed out of square: sheared by 2.5 to 5 %, and longer than wide by 0 to 3 %."""
    return {
        "shear": s * sign(rng) * rng.uniform(0.025, 0.05),
        "stretch": s * sign(rng) * rng.uniform(0.0, 0.03),
    }


def plate_tilt_jitter(rng, s, camera):
    """Each plate at its own tilt and twist, 2 to 4 degrees standard deviation per axis."""
    return {"angle_deg": s * rng.uniform(2.0, 4.0)}


def lens_dust(rng, s, camera):
    """Four to seven soft dark spots, 25 to 50 % deep, at the same places in every capture."""
    n = int(rng.integers(4, 8))
    place = rng.uniform(0.1, 0.9, (n, 2)) * [camera.width, camera.height]
    size = rng.uniform(0.015, 0.04, n) * camera.width
    depth = np.minimum(s * rng.uniform(0.25, 0.5, n), 0.95)
    return {"spots": np.column_stack([place, size, depth])}


def haze(rng, s, camera):
    """Light lost and air-light gained with distance: 0.12 to 0.3 a metre, air-light 0.5 to 0.7."""
    return {"per_m": s * rng.uniform(0.12, 0.3), "airlight": rng.uniform(0.5, 0.7)}


def interlacing(rng, s, camera):
    """Odd and even rows taken one after the other by a turning camera: 2 to 5 px apart."""
    turn = s * sign(rng) * rng.uniform(2, 5) / camera.fx
    return {"turn_rad_between_fields": [0.0, turn, 0.0]}


def ghost_double(rng, s, camera):
    """A second image, 10 to 20 % of the light, 8 to 22 px away."""
    angle, reach = rng.uniform(0, 2 * np.pi), rng.uniform(8, 22)
    return {
        "share": s * rng.uniform(0.10, 0.20),
        "dx_px": round(reach * np.cos(angle)),
        "dy_px": round(reach * np.sin(angle)),
    }


_OUTSIDE = (lens_flare, plate_curl, mains_flicker, hot_pixels, print_skew, plate_tilt_jitter, lens_dust, haze,
            interlacing, ghost_double)  # fmt: skip

OUTSIDE = {f.__name__: f for f in _OUTSIDE}
