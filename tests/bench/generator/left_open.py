"""What a campaign may leave open, drawn for each capture by itself: automatic exposure and white balance, lamps that move."""

import numpy as np

from generator.nominal import rng_of

WORDS = {"light": "unknown", "exposure": "auto", "white_balance": "auto", "reflectance": "unknown"}


def own_effects(left_open, seed_name, capture):
    """Return {effect: parameters} that one capture has for itself where ``left_open`` are open; reflectances are all captures'."""
    rng = rng_of("left open", seed_name, capture)
    scale, red, blue = np.exp([rng.uniform(-0.7, 0.15), rng.uniform(-0.2, 0.2), rng.uniform(-0.2, 0.2)])
    angle, share = rng.uniform(0, 2 * np.pi), rng.uniform(0.1, 0.5)
    lamp = {"share": share, "x_m": 2.5 * np.cos(angle), "y_m": 1.0 + 2.5 * np.sin(angle), "z_m": 2.5}
    own = {
        "exposure": ("exposure", {"scale": scale}),
        "white_balance": ("colour_balance", {"red": red, "green": 1.0, "blue": blue}),
        "light": ("illumination_gradient", lamp),
    }
    return dict(own[what] for what in left_open if what in own)


def shared_effects(left_open, seed_name):
    """Return {effect: parameters} that all captures have where reflectances are open."""
    rng = rng_of("left open", seed_name)
    white, black = rng.uniform(0.6, 0.9), rng.uniform(0.03, 0.1)
    return {"ink_reflectance": {"white": white, "black": black}} if "reflectance" in left_open else {}
