"""Image formation: from Blender's linear radiance through the effects, in physical order, to grey levels.

linear radiance -> lens (points move once, one resampling; blur, shading, glare) -> shutter -> sensor (exposure, clipping,
noise, mosaic) -> encoding to 0..255 -> the campaign's declared noise -> processing (balance, curve, sharpening,
denoising, JPEG) -> crop. Noise comes before processing because a camera's chip sharpens and compresses noisy images.
"""

import functools
import importlib
import pkgutil

import cv2
import effects
import numpy as np
from numba import njit

from effects.base import STAGES, Parameter
from rig.errors import InputError

GRID_STEP_PX = 8
SHARED_MODULES = ("base", "pipeline", "filters")


# -- finding effects ----------------------------------------------------------------------------------------------


@functools.cache
def available_effects():
    """Return {name: module} of all effects: the modules beside this one.

    Raises InputError naming the file that does not import or breaks the contract.
    """
    names = sorted(m.name for m in pkgutil.iter_modules(effects.__path__))
    return {n: _load(n) for n in names if n not in SHARED_MODULES and not n.startswith("_")}


def _load(name):
    path = f"{list(effects.__path__)[0]}/{name}.py"
    try:
        module = importlib.import_module(f"effects.{name}")
    except Exception as error:
        raise InputError(f"{path}: does not import: {type(error).__name__}: {error}") from None
    for attribute in ("STAGE", "ORDER", "PARAMETERS"):
        if not hasattr(module, attribute):
            raise InputError(f"{path}: breaks the contract: {attribute} is missing (see docs/effects.md)")
    if module.STAGE not in STAGES:
        raise InputError(f"{path}: STAGE is {module.STAGE!r}; allowed: {', '.join(STAGES)}")
    if not (module.__doc__ or "").strip():
        raise InputError(f"{path}: breaks the contract: a docstring that says what the effect is is missing")
    wanted = ("change_scene",) if module.STAGE == "scene" else ("map_points", "apply")
    if not any(callable(getattr(module, f, None)) for f in wanted):
        raise InputError(f"{path}: a {module.STAGE} effect needs {' or '.join(wanted)}")
    if not module.PARAMETERS:
        raise InputError(f"{path}: PARAMETERS is empty")
    for key, p in module.PARAMETERS.items():
        if not isinstance(p, Parameter):
            raise InputError(f"{path}: PARAMETERS[{key!r}] is no effects.base.Parameter")
        if not p.lower <= p.null <= p.upper or not p.starts or any(not p.lower <= s <= p.upper for s in p.starts):
            raise InputError(f"{path}: PARAMETERS[{key!r}]: null and starts must lie in [{p.lower}, {p.upper}]")
    return module


def in_order(chosen):
    """Return effects [(name, params)] in physical order: by stage, then ORDER, then name."""
    found = available_effects()
    return sorted(chosen, key=lambda e: (STAGES.index(found[e[0]].STAGE), found[e[0]].ORDER, e[0]))


def is_null(name, params):
    """Return whether parameters leave everything as it is."""
    return all(params[k] == p.null for k, p in available_effects()[name].PARAMETERS.items())


def active(chosen, function):
    """Return [(module, params)] of effects that have the function and are not at their null, in physical order."""
    found = available_effects()
    return [(found[n], p) for n, p in in_order(chosen) if hasattr(found[n], function) and not is_null(n, p)]


# -- geometry -----------------------------------------------------------------------------------------------------


def scene_with_effects(scene, chosen):
    """Return the effects.base.Scene with all scene effects applied."""
    for module, p in active(chosen, "change_scene"):
        scene = module.change_scene(scene, p)
    return scene


def is_chromatic(chosen):
    """Return whether some effect moves points of the colours apart."""
    return any(getattr(m, "CHROMATIC", False) for m, _ in active(chosen, "map_points"))


def map_points(xy, view, chosen, channel=1):
    """Return where ideal pinhole pixels (n, 2) land in the image; channel 0, 1, 2 is red, green, blue."""
    for module, p in active(chosen, "map_points"):
        xy = module.map_points(xy, view, p, channel)
    return xy


def inverse_points(xy, view, chosen, channel=1, iterations=12):
    """Return the ideal pinhole pixels (n, 2) that land on image pixels xy, by damped fixed-point steps to 1e-4 px."""
    ideal = xy.copy()
    for _ in range(iterations):
        error = xy - map_points(ideal, view, chosen, channel)
        ideal += np.clip(error, -50, 50)
        if np.nanmax(np.abs(error)) < 1e-4:
            break
    return ideal


def resample(image, view, chosen):
    """Return the image (H + 2m, W + 2m, C) with its points moved, one interpolation for all geometric effects.

    Raises InputError where the frame needs rays that the margin does not hold.
    """
    if not active(chosen, "map_points"):
        return image
    channels = (0, 1, 2) if is_chromatic(chosen) else (1,)
    planes = []
    for channel in channels:
        x, y = _source_map(view, chosen, channel)
        _check_margin(x, y, view)
        source = image if len(channels) == 1 else image[..., min(channel, image.shape[2] - 1)]
        moved = cv2.remap(source, x, y, cv2.INTER_LANCZOS4, borderMode=cv2.BORDER_REPLICATE)
        planes.append(np.maximum(moved, 0))
    if len(planes) == 1:
        return planes[0].reshape(image.shape)
    return np.stack(planes, axis=-1)


def _source_map(view, chosen, channel):
    """Return array coordinates (float32, x and y) of the ideal image for each array element of the moved one."""
    m, step = view.margin, GRID_STEP_PX
    columns = np.arange(-m, view.width + m + 2 * step, step, dtype=float)
    rows = np.arange(-m, view.height + m + 2 * step, step, dtype=float)
    grid = np.stack(np.meshgrid(columns, rows), axis=-1)
    ideal = inverse_points(grid.reshape(-1, 2), view, chosen, channel).reshape(grid.shape)
    fine_x, fine_y = np.meshgrid(
        np.arange(view.width + 2 * m, dtype=np.float32) / step, np.arange(view.height + 2 * m, dtype=np.float32) / step
    )
    planes = (np.ascontiguousarray(ideal[..., k] + m, np.float32) for k in (0, 1))
    return tuple(cv2.remap(p, fine_x, fine_y, cv2.INTER_CUBIC, borderMode=cv2.BORDER_REPLICATE) for p in planes)


def _check_margin(x, y, view):
    m = view.margin
    frame = (slice(m, m + view.height), slice(m, m + view.width))
    beyond = max(
        -float(x[frame].min()),
        -float(y[frame].min()),
        float(x[frame].max()) - (view.width + 2 * m - 1),
        float(y[frame].max()) - (view.height + 2 * m - 1),
    )
    if not np.isfinite(beyond) or beyond > 0.5:
        needed = (m + max(beyond, 0)) / max(view.width, view.height) if np.isfinite(beyond) else 1.0
        raise InputError(
            f"camera {view.camera}: its lens effects look {beyond:.0f} px beyond the rendered margin of {m} px; "
            f"set render.overscan to at least {needed + 0.01:.2f}"
        )


# -- photometry ---------------------------------------------------------------------------------------------------


def srgb_encode(linear):
    """Return IEC 61966-2-1 encoded values 0..1 of linear values 0..1."""
    return np.where(linear <= 0.0031308, 12.92 * linear, 1.055 * np.maximum(linear, 1e-12) ** (1 / 2.4) - 0.055)


def srgb_decode(encoded):
    """Return linear values 0..1 of IEC 61966-2-1 encoded ones."""
    return np.where(encoded <= 0.04045, encoded / 12.92, ((encoded + 0.055) / 1.055) ** 2.4)


# Finer near black, where the curve bends: knots at t^2
_KNOTS = np.linspace(0, 1, 4097)
_SRGB = srgb_encode(_KNOTS**2)


@njit(cache=True)
def _encode_srgb(values, table):
    out = np.empty_like(values)
    n = table.shape[0] - 1
    for i in range(values.size):
        v = min(max(values.flat[i], 0.0), 1.0)
        t = np.sqrt(v) * n
        k = min(int(t), n - 1)
        out.flat[i] = 255.0 * (table[k] + (t - k) * (table[k + 1] - table[k]))
    return out


def encode(linear, encoding):
    """Return grey levels 0..255 (float32) of linear image values; clips to 0..1."""
    if encoding == "srgb":
        return _encode_srgb(np.ascontiguousarray(linear, np.float32), _SRGB)
    return (255 * np.clip(linear, 0, 1)).astype(np.float32)


def decode(grey, encoding):
    """Return linear image values 0..1 of grey levels 0..255."""
    value = np.clip(grey / 255, 0, 1)
    return (srgb_decode(value) if encoding == "srgb" else value).astype(np.float32)


def photometric(image, view, chosen, noise_dn, rng):
    """Return grey levels (H + 2m, W + 2m, C) float32, unrounded, of linear radiance whose points are where they land.

    rng None gives the expected image: no random noise, neither declared nor of an effect.
    """
    found = active(chosen, "apply")
    image = np.asarray(image, np.float32)
    if any(getattr(m, "MAKES_COLOUR", False) for m, _ in found) and image.shape[2] == 1:
        image = np.repeat(image, 3, axis=2)
    if view.exposure != 1.0:
        image = image * np.float32(view.exposure)
    for module, p in found:
        if module.STAGE != "processing":
            image = module.apply(image, view, p, rng)
    image = encode(image, view.encoding)
    if rng is not None and noise_dn > 0:
        image = image + np.float32(noise_dn) * rng.standard_normal(image.shape, dtype=np.float32)
    for module, p in found:
        if module.STAGE == "processing":
            image = module.apply(image, view, p, rng)
    return image


def form_image(radiance, view, chosen, noise_dn, rng):
    """Return grey levels (H, W, C) float32, unrounded, of a render (H + 2m, W + 2m), the frame cut out."""
    image = resample(np.ascontiguousarray(radiance, np.float32)[..., None], view, chosen)
    image = photometric(image, view, chosen, noise_dn, rng)
    m = view.margin
    return image[m : m + view.height, m : m + view.width]


def to_uint8(image):
    """Return rounded and clipped grey levels."""
    return np.clip(np.rint(image), 0, 255).astype(np.uint8)
