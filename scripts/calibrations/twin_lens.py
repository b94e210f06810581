"""What a twin's effects say of its lens, in terms that formats have: a map of rays, magnifications, a fall-off of light."""

from dataclasses import replace

import numpy as np

from calibrations.lens import project
from calibrations.refit import frame_points, pinhole_like
from effects import library, pipeline
from rig.errors import InputError

GREEN = 1


def of_the_lens(twin):
    """Return the twin's effects [(name, parameters)] of the lens."""
    return [(name, p) for name, p in twin.effects if library.effect_named(name).STAGE == "lens"]


def nominal_pinhole(twin):
    """Return the Calibration of the ideal twin."""
    return pinhole_like(twin.width, twin.height, twin.K)


def lens_of(twin):
    """Return (rays (n, 2), pixels (n, 2) where they land, names of the effects that do it), even over the frame.

    Raises InputError where the lens has no rays for some of the frame.
    """
    chosen, view = of_the_lens(twin), twin.view()
    ideal = pipeline.inverse_points(frame_points(twin.width, twin.height), view, chosen, GREEN)
    if not np.isfinite(ideal).all():
        raise InputError(f"{twin.source}: its lens has no ray for some pixels of the frame")
    rays = (ideal - twin.K[:2, 2]) / (twin.K[0, 0], twin.K[1, 1])
    held = {name for name, _ in chosen if library.is_pure_geometry(name)}
    return rays, pipeline.map_points(ideal, view, chosen, GREEN), held


def colours_and_falloff(twin, calibration, module):
    """Return (Calibration with what else of the lens a format holds, names of the effects that this is)."""
    held = set()
    if getattr(module, "SEPARATES_COLOURS", False) and pipeline.is_chromatic(of_the_lens(twin)):
        red, blue = (_magnification(twin, calibration, channel) for channel in (0, 2))
        calibration = replace(calibration, red=red, blue=blue)
        held |= {n for n, _ in of_the_lens(twin) if library.moves_points(n) and not library.is_pure_geometry(n)}
    if getattr(module, "HAS_FALLOFF", False):
        calibration = replace(calibration, falloff=_falloff(twin))
        held |= {n for n, p in of_the_lens(twin) if np.ptp(_flat_field(twin, [(n, p)])) > 1e-4}
    return calibration, held


def _magnification(twin, calibration, channel):
    """Return by what a colour's image is larger than green's about the principal point, least squares."""
    rays, green, _ = lens_of(twin)
    ideal = rays * (twin.K[0, 0], twin.K[1, 1]) + twin.K[:2, 2]
    centre = project(calibration, np.zeros((1, 2)))
    own = pipeline.map_points(ideal, twin.view(), of_the_lens(twin), channel) - centre
    green = green - centre
    return float((own * green).sum() / (green * green).sum())


def _flat_field(twin, chosen):
    """Return what is left of an even light (height, width) behind lens effects."""
    image = np.ones((twin.height, twin.width, 1), np.float32)
    for module, p in pipeline.active(chosen, "apply"):
        image = module.apply(image, twin.view(), p, None)
    return image[..., 0]


def _falloff(twin):
    """Return k1, k2, k3 of the light 1 + k1 r^2 + k2 r^4 + k3 r^6, r in half diagonals, least squares."""
    y, x = np.mgrid[: twin.height : 7, : twin.width : 7].astype(float)
    half = np.hypot(twin.width - 1, twin.height - 1) / 2
    r2 = ((x - (twin.width - 1) / 2) ** 2 + (y - (twin.height - 1) / 2) ** 2).ravel() / half**2
    light = _flat_field(twin, of_the_lens(twin))[::7, ::7].ravel()
    middle, *k = np.linalg.lstsq(np.stack([r2**0, r2, r2**2, r2**3], axis=1), light, rcond=None)[0]
    return tuple(float(value / middle) for value in k)
