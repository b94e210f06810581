"""Real photographs taken again with something changed: resampled in linear light, averaged over pixels, read out, processed.

The photograph stands for the light before the lens; what the camera did when it was taken stays in it. Every photograph goes
this way, those with nothing changed too, each moved by pixels and a fraction, so that neither interpolation nor where the blocks lie of
a codec that the photograph went through is ever the change.
"""

import cv2
import numpy as np

from generator import nominal, optics, processing, rays, sensor
from generator.vocabulary import LIBRARY

COLOUR = (
    "lateral_chromatic_aberration",
    "bayer_demosaic",
    "colour_balance",
)  # nothing of them shows on a grey photograph
SCENE = (
    "camera_pose_offset", "marker_scale", "rail_sag", "ink_spread", "ink_reflectance", "illumination_gradient",
    "specular_highlight", "defocus",
)  # fmt: skip
MOVES_POINTS = (
    "focal_length", "principal_point", "radial_distortion", "tangential_distortion", "rolling_shutter", "local_warp",
)  # fmt: skip
LAID_ON = tuple(name for name in LIBRARY if name not in SCENE)
MAX_SHIFT_PX = 4.0  # half a block of ITU-T T.81 each way


def why_not_laid(name, in_colour):
    """Return why an effect cannot be laid on photographs, None where it can."""
    if name not in LIBRARY:
        return f"{name} is no effect of the library"
    if name in SCENE:
        return f"{name} needs the scene or its depth, and photographs show it as it was"
    if name in COLOUR and not in_colour:
        return f"{name} needs photographs in colour"
    return None


def decode(values):
    """Return linear light 0..1 of encoded values 0..255 (IEC 61966-2-1)."""
    v = np.asarray(values, np.float32) / 255
    return np.where(v <= 0.04045, v / 12.92, ((v + 0.055) / 1.055) ** 2.4).astype(np.float32)


def is_in_colour(image):
    """Return whether a photograph (H, W, 3) has channels that differ."""
    return bool((image[..., :1] != image[..., 1:]).any())


class Retaken:
    """A camera that takes photographs again, with some effects (name: parameters) laid on; all is seeded by a name."""

    def __init__(self, camera, effects, seed_name):
        self.camera, self.effects, self.seed_name = camera, effects, seed_name
        self.margin = optics.margin_of(camera, effects)
        self.order = processing.drawn_order(effects, seed_name)
        channels = (0, 1, 2) if "lateral_chromatic_aberration" in effects else (1,)
        self.maps = [self._sources(channel) for channel in channels]

    def _sources(self, channel):
        """Return where in the photograph (x, y float32) each fine sample of the frame and its margin comes from."""
        fine, m, c = optics.FINE, self.margin, self.camera
        u = (np.arange((c.width + 2 * m) * fine) + 0.5) / fine - m - 0.5
        v = (np.arange((c.height + 2 * m) * fine) + 0.5) / fine - m - 0.5
        u, v = np.meshgrid(u, v)
        if shutter := self.effects.get("rolling_shutter"):
            u = u - shutter["skew_px_per_row"] * (v - c.cy)
        x, y = rays.pixel_directions(u, v, c, self.effects, channel)
        return (c.cx + c.fx * x).astype(np.float32), (c.cy + c.fx * y).astype(np.float32)

    def photograph(self, image, name):
        """Return the 8-bit image (H, W, 3), red first, of a photograph's (H, W, 3) taken again; noise is seeded by its name."""
        own = nominal.rng_of("retaken", self.seed_name, name)
        shift = own.uniform(-MAX_SHIFT_PX, MAX_SHIFT_PX, 2).astype(np.float32)
        light, moved = decode(image), [(x + shift[0], y + shift[1]) for x, y in self.maps]
        fine = (
            cv2.remap(light[..., k], *moved[k % len(moved)], cv2.INTER_CUBIC, borderMode=cv2.BORDER_REFLECT)
            for k in range(3 if is_in_colour(image) else 1)
        )
        return self.of_light(fine, own)

    def of_light(self, fine, own):
        """Return the 8-bit image (H, W, C) of light before the lens: a plane a channel, fine samples of the frame and its margin.

        ``own`` is the photograph's generator of random numbers.
        """
        planes = [self._on_pixels(plane) for plane in fine]
        linear = optics.stray_light(np.stack(planes, axis=-1), self.camera, self.effects, self.margin)
        m = self.margin
        linear = linear[m : m + self.camera.height, m : m + self.camera.width]
        shared = nominal.rng_of("sensor", self.seed_name)
        encoded = sensor.read_out(linear, self.camera, self.effects, shared, own)
        return processing.process(encoded, self.effects, self.order)

    def _on_pixels(self, fine):
        """Return the light on pixels: spread where an effect says so, then averaged over each pixel."""
        if self.effects.keys() & set(optics.SPREADS):
            return optics.spread(fine, None, self.camera, self.effects, self.margin)
        n = optics.FINE
        return fine.reshape(fine.shape[0] // n, n, -1, n).mean((1, 3))
