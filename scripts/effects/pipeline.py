"""Image formation: from Blender's linear radiance through the effects, in physical order, to grey levels.

linear radiance -> lens (points move once, one resampling; blur, shading, glare) -> shutter -> sensor (exposure,
pattern, noise, mosaic, clipping) -> encoding to 0..255 -> the campaign's declared noise -> processing (balance, curve,
denoising, sharpening, JPEG) -> crop. Why this order: docs/effects.md.
"""

import functools
import itertools
import math
from dataclasses import dataclass, replace

import numpy as np

from effects.base import PARTS
from effects.encoding import encode, encode_with_noise, mean_of_clipped
from effects.library import acting, effect_named, moves_points, nulls_of, place_of, spreads_light
from effects.noise_kernels import followed, processed, with_white
from effects.resampling import fine_map, sample
from rig.errors import InputError

GRID_STEP_PX = 8
DIFFERENCE_PX = 0.01
LONGEST_STEP_PX = 100.0
NEWTON_STEPS = 20
STRIDES = (1, 5, 11, 49, 53, 79)  # orders in which effects visit their parts, so that none follows another's closely
TINY = 1e-9  # variance that an effect which spreads nothing along some line is taken to have there
SPARE_PX = 4  # what the interpolation needs beyond the last ray


# -- lists of effects ------------------------------------------------------------------------------------------------


def key_of(chosen):
    """Return a hashable key of what a list of effects does: those at their null left out, in the order in which they act."""
    found = ((n, acting(n, p)) for n, p in in_order(chosen))
    return tuple((n, tuple(sorted(p.items()))) for n, p in found if p is not None)


def in_order(chosen):
    """Return effects [(name, params)] in physical order: by stage, then ORDER, then name."""
    return sorted(chosen, key=lambda effect: place_of(*effect))


def active(chosen, function):
    """Return [(module, params)] of effects that have the function and are not at their null, in physical order.

    Parameters that are not given are at their null.
    """
    found = []
    for name, params in in_order(chosen):
        if hasattr(effect_named(name), function) and acting(name, params) is not None:
            found.append((effect_named(name), nulls_of(name) | dict(params)))
    return found


# -- geometry -----------------------------------------------------------------------------------------------------


def scene_with_effects(scene, chosen):
    """Return the effects.base.Scene with all scene effects applied."""
    for module, p in active(chosen, "change_scene"):
        scene = module.change_scene(scene, p)
    return scene


def point_map(view, chosen, channel):
    """Return the function of ideal pixels (n, 2) that gives a channel's image pixels; None where effects move none."""
    return functools.partial(map_points, view=view, chosen=chosen, channel=channel) if has_geometry(chosen) else None


def has_geometry(chosen):
    """Return whether any of the effects moves image points."""
    return any(moves_points(name) for name, _ in chosen)


def is_chromatic(chosen):
    """Return whether some effect moves points of the colours apart."""
    return any(getattr(m, "CHROMATIC", False) for m, _ in active(chosen, "map_points"))


def map_points(xy, view, chosen, channel=1):
    """Return where ideal pinhole pixels (n, 2) land in the image; channel 0, 1, 2 is red, green, blue."""
    for module, p in active(chosen, "map_points"):
        xy = module.map_points(xy, view, p, channel)
    return xy


def points_by_parameters(xy, view, chosen, wanted, steps, channel=1):
    """Return the derivatives (n, 2, k) of ``map_points`` by parameters ``wanted`` [(effect, parameter)] of its effects.

    Closed where an effect has ``points_by_parameters`` of its own, else by differences with ``steps`` (k,); what comes after
    an effect turns and stretches its moves.
    """
    listed = [(name, p) for name, p in in_order(chosen) if hasattr(effect_named(name), "map_points")]
    out = np.zeros((*xy.shape, len(wanted)))
    for name, params in listed:
        module, p = effect_named(name), nulls_of(name) | dict(params)
        moved = module.map_points(xy, view, p, channel)
        if out.any():
            out = _stretch(functools.partial(module.map_points, view=view, p=p, channel=channel), xy) @ out
        mine = [k for k, (effect, _) in enumerate(wanted) if effect == name]
        if mine:
            out[..., mine] = _own_derivatives(module, xy, view, p, [(wanted[k][1], steps[k]) for k in mine], channel)
        xy = moved
    return out


def points_by_points(xy, view, chosen, channel=1):
    """Return the derivatives (n, 2, 2) of ``map_points`` by the ideal pixels (n, 2)."""
    return _stretch(functools.partial(map_points, view=view, chosen=chosen, channel=channel), xy)


def _stretch(mapping, xy):
    """Return the derivatives (n, 2, 2) of a map of pixels (n, 2), by differences."""
    steps = np.array([[1, 0], [-1, 0], [0, 1], [0, -1]]) * DIFFERENCE_PX
    right, left, down, up = mapping((xy + steps[:, None]).reshape(-1, 2)).reshape(4, *xy.shape)
    return np.stack([right - left, down - up], axis=-1) / (2 * DIFFERENCE_PX)


def _own_derivatives(module, xy, view, p, wanted, channel):
    """Return the derivatives (n, 2, k) of one effect's map by its parameters ``wanted`` [(parameter, step)]."""
    if hasattr(module, "points_by_parameters"):
        return module.points_by_parameters(xy, view, p, [key for key, _ in wanted])
    pairs = [[module.map_points(xy, view, p | {key: p[key] + s * h}, channel) for s in (1, -1)] for key, h in wanted]
    return np.stack([(high - low) / (2 * h) for (high, low), (_, h) in zip(pairs, wanted, strict=True)], axis=-1)


def light_spread(view, chosen):
    """Return what tells where the parts of a point's light land, None where nothing spreads it.

    It takes image pixels (m, 2) to (directions (m, j, 2) px, shares (PARTS, j)): part k, one of equal parts, of the light
    of point i lands shares[k] @ directions[i] beside it.
    """
    found = active(chosen, "spread")

    def spread(xy):
        directions, shares = [], []
        for (module, p), stride in zip(found, itertools.cycle(STRIDES), strict=False):
            along, share = module.spread(xy, view, p, PARTS)
            directions.append(np.broadcast_to(along, (len(xy), *along.shape[1:])))
            shares.append(share[np.arange(PARTS) * stride % PARTS])
        return np.concatenate(directions, axis=1), independent(shares)

    return spread if found else None


def independent(shares):
    """Return the shares [(n, j), ...] of several effects side by side (n, sum of j), each spread as it was, none with another.

    So few parts follow one another somewhat in any order.
    """
    if len(shares) == 1:
        return shares[0]
    together = np.concatenate(shares, axis=1)
    effect = np.repeat(np.arange(len(shares)), [share.shape[1] for share in shares])
    covariance = together.T @ together / len(together) + TINY * np.eye(len(effect))
    wanted = np.where(effect[:, None] == effect, covariance, 0.0)
    return together @ np.linalg.inv(np.linalg.cholesky(covariance)).T @ np.linalg.cholesky(wanted).T


def left_to_apply(chosen):
    """Return effects [(name, params)] without what ``light_spread`` has done of them."""
    left = []
    for name, p in chosen:
        rest = getattr(effect_named(name), "left_to_blur", None)
        if rest is not None:
            left.append((name, rest(nulls_of(name) | dict(p))))
        elif not spreads_light(name):
            left.append((name, p))
    return left


def reach_px(chosen):
    """Return how far from a pixel the effects look that act on an image, all after one another: as of blurs, squares add up."""
    return math.hypot(*(module.reach_px(p) for module, p in active(chosen, "apply") if hasattr(module, "reach_px")))


def inverse_points(xy, view, chosen, channel=1):
    """Return the ideal pinhole pixels (n, 2) that land on image pixels xy, to 1e-6 px; Newton steps with differences.

    NaN where no step leads there: the pixel looks where the lens model has no rays.
    """
    ideal = np.array(xy, float)
    for _ in range(NEWTON_STEPS):
        landed = map_points(ideal, view, chosen, channel)
        error = xy - landed
        if np.nanmax(np.abs(error), initial=0.0) < 1e-6:
            return ideal
        along_x = (map_points(ideal + [DIFFERENCE_PX, 0], view, chosen, channel) - landed) / DIFFERENCE_PX
        along_y = (map_points(ideal + [0, DIFFERENCE_PX], view, chosen, channel) - landed) / DIFFERENCE_PX
        determinant = along_x[:, 0] * along_y[:, 1] - along_x[:, 1] * along_y[:, 0]
        determinant = np.where(np.abs(determinant) < 1e-6, 1e-6, determinant)
        step_x = (error[:, 0] * along_y[:, 1] - error[:, 1] * along_y[:, 0]) / determinant
        step_y = (error[:, 1] * along_x[:, 0] - error[:, 0] * along_x[:, 1]) / determinant
        ideal += np.clip(np.stack([step_x, step_y], axis=1), -LONGEST_STEP_PX, LONGEST_STEP_PX)
    ideal[np.abs(xy - map_points(ideal, view, chosen, channel)).max(axis=1) > 1e-3] = np.nan
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
        x, y = source_map(view, chosen, channel)
        _check_margin(x, y, view)
        source = min(channel, image.shape[2] - 1)
        planes.append(sample(image[..., source : source + 1] if len(channels) > 1 else image, x, y))
    return planes[0] if len(planes) == 1 else np.concatenate(planes, axis=-1)


def source_map(view, chosen, channel):
    """Return array coordinates (x, y: float32, (H + 2m, W + 2m)) in the ideal image of each element of the moved one.

    Inverted exactly every 8 px, cubic between: lens maps are smooth.
    """
    m, step = view.margin, GRID_STEP_PX
    # two more on each side, as the cubic needs neighbours
    columns = np.arange(-m - step, view.width + m + 3 * step, step, dtype=float)
    rows = np.arange(-m - step, view.height + m + 3 * step, step, dtype=float)
    grid = np.stack(np.meshgrid(columns, rows), axis=-1)
    ideal = inverse_points(grid.reshape(-1, 2), view, chosen, channel).reshape(grid.shape) + m
    shape = (view.height + 2 * m, view.width + 2 * m)
    return tuple(fine_map(np.ascontiguousarray(ideal[..., k]), step, shape) for k in (0, 1))


def _check_margin(x, y, view):
    m = view.margin
    frame = (slice(m, m + view.height), slice(m, m + view.width))
    x, y = x[frame], y[frame]
    if not (np.isfinite(x).all() and np.isfinite(y).all()):
        raise InputError(
            f"camera {view.camera}: its lens effects have no ray for some pixels of the frame; "
            "a smaller focal length or less distortion is needed"
        )
    last_x, last_y = view.width + 2 * m - 1, view.height + 2 * m - 1
    beyond = float(max(-x.min(), -y.min(), x.max() - last_x, y.max() - last_y))
    if beyond > 0.5:
        needed = (m + beyond + SPARE_PX) / max(view.width, view.height)
        raise InputError(
            f"camera {view.camera}: its lens effects look {beyond:.0f} px beyond the rendered margin of {m} px; "
            f"set render.overscan to at least {needed:.2f}"
        )


# -- photometry -----------------------------------------------------------------------------------------------------


def photometric(image, view, chosen, rng):
    """Return grey levels (H + 2m, W + 2m, C) float32, unrounded, of linear radiance whose points are where they land.

    rng None gives the expected image: no random noise, neither declared nor of an effect.
    """
    return form(image, view, chosen, rng).outcome[0]


def expected_levels(image, view, chosen):
    """Return the mean grey levels (H + 2m, W + 2m, C) of captures of linear radiance: noise moves what is clipped."""
    return mean_of_clipped(*form(image, view, chosen, None).outcome)


@dataclass(frozen=True)
class Formed:
    """An image that was formed: what came out of each step, so that a change is followed from where it acts."""

    keys: tuple
    states: tuple

    @property
    def outcome(self):
        """(image as of ``photometric``, standard deviation of the noise in each channel that it has or would have).

        The latter, grey levels, is a number or as the image; it is followed in expected images only.
        """
        image, _, noise_dn, _ = self.states[-1]
        return image, noise_dn


def form(image, view, chosen, rng, like=None):
    """Return the Formed of linear radiance (rows, columns, C) whose points are where they land.

    ``like`` is one of the same radiance, view and random numbers: steps that agree with its first ones are not done again.
    """
    steps = _steps(np.asarray(image, np.float32), view, chosen, rng)
    keys = tuple(key for key, _ in steps)
    same = 0
    if like is not None:
        same = next(
            (k for k, (a, b) in enumerate(zip(keys, like.keys, strict=False)) if a != b), min(len(keys), len(like.keys))
        )
    states = list(like.states[:same]) if same else []
    for _, step in steps[same:]:
        states.append(step(*(states[-1] if states else (np.asarray(image, np.float32), 0.0, view.noise_dn, None))))
    return Formed(keys, tuple(states))


def _steps(image, view, chosen, rng):
    """Return [(key, function of (image, variance, noise_dn, kernel) that returns these)]: how radiance becomes grey levels.

    ``variance``, squared grey levels of full scale 255, is that of linear values, ``noise_dn`` that of encoded ones; the noise
    of either has a ``kernel`` (effects.noise_kernels).
    """
    found = active(chosen, "apply")
    colour = any(
        getattr(m, "MAKES_COLOUR", False) or (rng is not None and getattr(m, "MIXES_CHANNELS", False)) for m, _ in found
    )
    optics = of_stage(found, "lens") + of_stage(found, "shutter")
    steps = [("exposure", functools.partial(_scaled, np.float32(view.exposure)))]
    steps += [(_step_key(m, p), functools.partial(_applied, m, p, view, rng)) for m, p in optics]
    if colour and image.shape[2] == 1:  # late: what lies before costs a third
        steps.append(("colour", lambda image, *noise: (np.repeat(image, 3, axis=2), *noise)))
    steps += [(_step_key(m, p), functools.partial(_sensed, m, p, view, rng)) for m, p in of_stage(found, "sensor")]
    steps.append(("encoding", functools.partial(_encoded, view, rng)))
    steps += [(_step_key(m, p), functools.partial(_applied, m, p, view, rng)) for m, p in of_stage(found, "processing")]
    return steps


def _step_key(module, p):
    return module.__name__, tuple(sorted(p.items()))


def _scaled(exposure, image, *noise):
    return (image * exposure if exposure != 1 else image), *noise


def _applied(module, p, view, rng, image, variance, noise_dn, kernel):
    image = module.apply(image, replace(view, noise_dn=noise_dn, noise_kernel=kernel), p, numbers_of(rng, module))
    if rng is None and hasattr(module, "noise_kernel"):
        noise_dn, kernel = processed(noise_dn, kernel, functools.partial(module.noise_kernel, p))
    return image, variance, noise_dn, kernel


def _sensed(module, p, view, rng, image, variance, noise_dn, kernel):
    if rng is None and hasattr(module, "variance"):
        variance = variance + module.variance(image, p)
    if rng is None and hasattr(module, "noise_kernel") and np.ndim(variance):
        gain, kernel = followed(kernel, module.noise_kernel(p, 0.0))
        variance = variance * np.float32(gain**2)
    return module.apply(image, view, p, numbers_of(rng, module)), variance, noise_dn, kernel


def _encoded(view, rng, image, variance, noise_dn, kernel):
    if np.ndim(variance):
        image, noise_dn = encode_with_noise(image, variance, noise_dn, view.encoding)
        if kernel is not None and view.noise_dn > 0:
            kernel = with_white(kernel, 1 - view.noise_dn**2 / np.mean(np.square(noise_dn)))
    else:
        image = encode(image, view.encoding)
    if rng is not None and view.noise_dn > 0:
        declared = numbers_of(rng, None).standard_normal(image.shape, dtype=np.float32)
        image = image + np.float32(view.noise_dn) * declared
    return image, variance, noise_dn, kernel


def numbers_of(rng, module):
    """Return the random numbers of one step: a source that has some for each name keeps steps apart."""
    return rng.of(module.__name__ if module else "declared") if hasattr(rng, "of") else rng


def of_stage(found, stage):
    """Return those of (module, params) that belong to a stage."""
    return [(module, p) for module, p in found if module.STAGE == stage]


def form_image(radiance, view, chosen, rng):
    """Return grey levels (H, W, C) float32, unrounded, of a render (H + 2m, W + 2m) or (..., 3), the frame cut out."""
    image = np.ascontiguousarray(radiance, np.float32)
    image = resample(image[..., None] if image.ndim == 2 else image, view, chosen)
    image = photometric(image, view, chosen, rng)
    m = view.margin
    return image[m : m + view.height, m : m + view.width]


def to_uint8(image):
    """Return rounded and clipped grey levels."""
    return np.clip(np.rint(image), 0, 255).astype(np.uint8)
