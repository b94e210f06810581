"""From light on the sensor to grey levels: exposure, electrons, fixed pattern, colour mosaic, white balance,
encoding.
"""

import numpy as np
from scipy.ndimage import convolve

RED, GREEN, BLUE = 0, 1, 2


def encode(linear):
    """Return the sRGB transfer curve (IEC 61966-2-1) of linear values 0..1, as 0..255 unrounded."""
    linear = np.clip(linear, 0.0, 1.0)
    return 255.0 * np.where(linear <= 0.0031308, 12.92 * linear, 1.055 * linear ** (1 / 2.4) - 0.055)


def _mosaic_masks(shape, phase):
    """Return boolean masks (R, G, B) of a Bayer mosaic; ``phase`` = row and column of the first red site."""
    r = (np.arange(shape[0]) + phase[0]) % 2
    c = (np.arange(shape[1]) + phase[1]) % 2
    red = (r == 0)[:, None] & (c == 0)
    blue = (r == 1)[:, None] & (c == 1)
    return red, ~(red | blue), blue


def demosaic(image, p):
    """Sample ``image`` (H, W, 3) through a Bayer mosaic and interpolate: ``bilinear`` or ``malvar`` (Malvar
    2004).
    """
    masks = _mosaic_masks(image.shape[:2], p["first_red"])
    raw = sum(np.where(mask, image[..., k], 0.0) for k, mask in enumerate(masks))
    if p["method"] == "bilinear":
        green = np.array([[0, 1, 0], [1, 4, 1], [0, 1, 0]]) / 4
        other = np.array([[1, 2, 1], [2, 4, 2], [1, 2, 1]]) / 4
        kernels = (other, green, other)
        full = [convolve(np.where(m, raw, 0.0), k, mode="mirror") for m, k in zip(masks, kernels, strict=True)]
    else:
        at_green = (
            np.array([[0, 0, -1, 0, 0], [0, 0, 2, 0, 0], [-1, 2, 4, 2, -1], [0, 0, 2, 0, 0], [0, 0, -1, 0, 0]]) / 8
        )
        along = (
            np.array(
                [
                    [0, 0, 0.5, 0, 0],
                    [0, -1, 0, -1, 0],
                    [-1, 4, 5, 4, -1],
                    [0, -1, 0, -1, 0],
                    [0, 0, 0.5, 0, 0],
                ]
            )
            / 8
        )
        cross = (
            np.array(
                [
                    [0, 0, -1.5, 0, 0],
                    [0, 2, 0, 2, 0],
                    [-1.5, 0, 6, 0, -1.5],
                    [0, 2, 0, 2, 0],
                    [0, 0, -1.5, 0, 0],
                ]
            )
            / 8
        )
        sums = {k: convolve(raw, w, mode="mirror") for k, w in
                (("g", at_green), ("h", along), ("v", along.T), ("x", cross))}  # fmt: skip
        red, green_sites, blue = masks
        red_rows = red.any(1)[:, None]
        in_red_row, in_blue_row = green_sites & red_rows, green_sites & ~red_rows
        full = [
            np.where(red, raw, np.where(blue, sums["x"], np.where(in_red_row, sums["h"], sums["v"]))),
            np.where(green_sites, raw, sums["g"]),
            np.where(blue, raw, np.where(red, sums["x"], np.where(in_blue_row, sums["h"], sums["v"]))),
        ]
    return (1 - p["share"]) * image + p["share"] * np.stack(full, -1)


def read_out(image, camera, effects, campaign_rng, capture_rng):
    """Return encoded values 0..255, unrounded (H, W, 3), of linear light (H, W, 1 or 3) times the nominal
    exposure.

    ``campaign_rng`` draws what is the same in every capture (fixed pattern), ``capture_rng`` what is not.
    """
    if image.shape[2] == 1 and {"bayer_demosaic", "colour_balance"} & effects.keys():
        image = np.repeat(image, 3, axis=2)
    if p := effects.get("exposure"):
        image = image * p["scale"]
    if p := effects.get("mains_flicker"):
        phase = capture_rng.uniform(0, 2 * np.pi)
        rows = np.arange(camera.height)[:, None, None]
        image = image * (1 + p["depth"] * np.sin(2 * np.pi * rows / p["period_rows"] + phase))
    if {"sensor_noise", "fixed_pattern_noise", "hot_pixels"} & effects.keys():
        # One electron count a site and channel: a three-chip camera, or the mosaic below picks one of the
        # three.
        image = np.repeat(image, 3, axis=2) if image.shape[2] == 1 else image
    if p := effects.get("fixed_pattern_noise"):
        gain = campaign_rng.standard_normal(image.shape[:2])[..., None]
        offset = campaign_rng.standard_normal(image.shape[1])[None, :, None]
        image = image * (1 + p["pixel_gain_std"] * gain) + p["column_offset_std"] * offset
    if p := effects.get("sensor_noise"):
        image = np.clip(image, 0.0, 1.0)
        electrons = capture_rng.poisson(image * p["full_well_e"])
        image = (electrons + p["read_noise_e"] * capture_rng.standard_normal(image.shape)) / p["full_well_e"]
    if p := effects.get("hot_pixels"):
        draw = campaign_rng.random(image.shape[:2])
        image = np.where((draw < p["share"] / 2)[..., None], 1.0, image)
        image = np.where((draw > 1 - p["share"] / 2)[..., None], 0.0, image)
    image = np.clip(image, 0.0, 1.0)
    if p := effects.get("bayer_demosaic"):
        image = demosaic(image, p)
    if p := effects.get("colour_balance"):
        image = image * np.array([p["red"], p["green"], p["blue"]])
    encoded = encode(image)
    return np.repeat(encoded, 3, axis=2) if encoded.shape[2] == 1 else encoded
