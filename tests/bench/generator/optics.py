"""What the lens does to radiance: spread (on a grid three times finer than the pixels), shading, stray light.

Every spread is a sum over fine samples with the pixel's own box folded into the kernel; kernels have the
second moment that the physical spread has, so the fine grid adds no blur of its own.
"""

import numpy as np
from numba import njit
from scipy.ndimage import gaussian_filter

FINE = 3
SPREADS = ("lens_blur", "defocus", "field_curvature", "motion_blur")
DISC_STEP = 1 / 16


@njit(cache=True)
def _unevenness(image):
    """Return (rows + 1, columns + 1): how many samples above and left differ from their right or lower
    neighbour.
    """
    rows, columns = image.shape
    total = np.zeros((rows + 1, columns + 1), np.int32)
    for i in range(rows):
        line = 0
        for j in range(columns):
            here = image[i, j]
            if image[i, min(j + 1, columns - 1)] != here or image[min(i + 1, rows - 1), j] != here:
                line += 1
            total[i + 1, j + 1] = total[i, j + 1] + line
    return total


@njit(cache=True)
def _gather(image, runs, weights, first, reach, which, stride):
    """Return (rows / stride, columns / stride): sums over ``image`` weighted by kernel ``which`` of each
    output pixel.

    Kernel k is ``runs[first[k] : first[k + 1]]``, none beyond ``reach[k]``: row and column offset, and which
    ``weights`` (first, last + 1) lie side by side from there.
    """
    rows, columns = image.shape[0] // stride, image.shape[1] // stride
    last_row, last_column = image.shape[0] - 1, image.shape[1] - 1
    uneven = _unevenness(image)
    out = np.empty((rows, columns), np.float32)
    for i in range(rows):
        ci = i * stride + stride // 2
        for j in range(columns):
            cj = j * stride + stride // 2
            k = which[i, j]
            r = reach[k]
            top, bottom = max(ci - r, 0), min(ci + r, last_row) + 1
            left, right = max(cj - r, 0), min(cj + r, last_column) + 1
            if uneven[bottom, right] - uneven[top, right] - uneven[bottom, left] + uneven[top, left] == 0:
                out[i, j] = image[ci, cj]
                continue
            total = 0.0
            if ci - r >= 0 and cj - r >= 0 and ci + r <= last_row and cj + r <= last_column:
                for t in range(first[k], first[k + 1]):
                    row, x = image[ci + runs[t, 0]], cj + runs[t, 1]
                    part = np.float32(0.0)
                    for n in range(runs[t, 2], runs[t, 3]):
                        part += weights[n] * row[x]
                        x += 1
                    total += part
            else:
                for t in range(first[k], first[k + 1]):
                    row, x = image[min(max(ci + runs[t, 0], 0), last_row)], cj + runs[t, 1]
                    for n in range(runs[t, 2], runs[t, 3]):
                        total += weights[n] * row[min(max(x, 0), last_column)]
                        x += 1
            out[i, j] = total
    return out


def _runs(kernels):
    """Return runs (N, 4), weights, first (K + 1,) and reach (K,) of square kernels, zeros at rows' ends
    left out.
    """
    runs, weights, first, reach, n = [], [], [0], [], 0
    for kernel in kernels:
        middle = kernel.shape[0] // 2
        for row, line in enumerate(kernel):
            used = np.flatnonzero(line)
            if len(used):
                part = line[used[0] : used[-1] + 1]
                runs.append((row - middle, used[0] - middle, n, n + len(part)))
                weights.append(part)
                n += len(part)
        first.append(len(runs))
        reach.append(np.abs(np.argwhere(kernel) - middle).max())
    return np.array(runs), np.concatenate(weights).astype(np.float32), np.array(first), np.array(reach)


@njit(cache=True)
def _gaussian_down(image, kernel, stride):
    """Separable sum with ``kernel`` along both axes, kept at every ``stride``-th sample."""
    rows, columns = image.shape[0] // stride, image.shape[1] // stride
    r = kernel.size // 2
    tall = np.empty((image.shape[0], columns), np.float32)
    for i in range(image.shape[0]):
        row = image[i]
        for j in range(columns):
            c = j * stride + stride // 2
            total = np.float32(0.0)
            if c - r >= 0 and c + r < image.shape[1]:
                for k in range(-r, r + 1):
                    total += kernel[k + r] * row[c + k]
            else:
                for k in range(-r, r + 1):
                    total += kernel[k + r] * row[min(max(c + k, 0), image.shape[1] - 1)]
            tall[i, j] = total
    out = np.zeros((rows, columns), np.float32)
    for i in range(rows):
        c = i * stride + stride // 2
        for k in range(-r, r + 1):
            row = tall[min(max(c + k, 0), image.shape[0] - 1)]
            for j in range(columns):
                out[i, j] += kernel[k + r] * row[j]
    return out


def _box(kernel, stride):
    """Return ``kernel`` convolved with a box of ``stride`` samples (the pixel)."""
    side = kernel.shape[-1] + stride - 1
    out = np.zeros((side, side))
    for a in range(stride):
        for b in range(stride):
            out[a : a + kernel.shape[0], b : b + kernel.shape[1]] += kernel / stride**2
    return out


def _disc(radius, side):
    """Return a (side, side) kernel: the area of each fine cell inside a disc, by 16 x 16 points a cell."""
    offsets = (np.arange(side * 16) + 0.5) / 16 - side / 2
    inside = (offsets[:, None] ** 2 + offsets**2 <= radius**2).astype(float)
    kernel = inside.reshape(side, 16, side, 16).sum((1, 3))
    return kernel / kernel.sum() if kernel.sum() else kernel


def _disc_kernels(largest, stride):
    """Return kernels for discs of radius 0, 1/16, 2/16, ... fine samples, each with a disc's second
    moment.
    """
    side = 2 * int(np.ceil(largest + 1.5)) + 1
    axis = np.arange(side) - side // 2
    radii = np.arange(0, largest + 1.0, DISC_STEP / 2)
    drawn = [_disc(max(r, 0.05), side) for r in radii]
    moments = np.array([(k.sum(0) * axis**2).sum() for k in drawn])
    kernels = []
    for index in range(int(np.ceil(largest / DISC_STEP)) + 2):
        wanted = (index * DISC_STEP) ** 2 / 4  # variance per axis of a uniform disc
        kernels.append(_box(drawn[int(np.argmin(np.abs(moments - wanted)))], stride))
    return kernels


def _motion_blur_kernel(length, angle_deg):
    """Return the kernel of a straight motion in fine samples: time steps, interpolated with Keys' cubic, which
    adds no blur.
    """
    times = (np.arange(int(np.ceil(length * 16)) + 16) + 0.5) / (int(np.ceil(length * 16)) + 16) - 0.5
    side = 2 * int(np.ceil(length / 2 + 2)) + 1
    axis = np.arange(side) - side // 2

    def keys(d):
        d = np.abs(d)
        near = 1.5 * d**3 - 2.5 * d**2 + 1
        far = -0.5 * d**3 + 2.5 * d**2 - 4 * d + 2
        return np.where(d < 1, near, np.where(d < 2, far, 0.0))

    kernel = np.zeros((side, side))
    for t in times * length:
        u, v = t * np.cos(np.radians(angle_deg)), t * np.sin(np.radians(angle_deg))
        kernel += np.outer(keys(axis - v), keys(axis - u))
    return kernel / kernel.sum()


def _radius_px(camera, margin, fine):
    u = (np.arange((camera.width + 2 * margin) * fine) + 0.5) / fine - margin - 0.5 - camera.cx
    v = (np.arange((camera.height + 2 * margin) * fine) + 0.5) / fine - margin - 0.5 - camera.cy
    return np.hypot(u, v[:, None]) / camera.corner_px


def disc_radius_px(name, depth, camera, effects, margin, fine):
    """Return the radius in pixels of the blur disc on a grid of ``fine`` samples a pixel.

    ``depth`` (m, NaN: infinitely far; only ``defocus`` needs it) is on the grid of ``FINE``.
    """
    p = effects[name]
    if name == "defocus":
        if fine < FINE:
            depth = depth[FINE // 2 :: FINE, FINE // 2 :: FINE]
        inverse = np.where(np.isfinite(depth), 1 / np.where(np.isfinite(depth), depth, 1.0), 0.0)
        return p["aperture_m"] * camera.fx / 2 * np.abs(inverse - 1 / p["focus_m"])
    return p["corner_radius_px"] * _radius_px(camera, margin, fine) ** 2


def spread(fine_image, depth, camera, effects, margin):
    """Apply every spread among ``effects`` to a grid ``FINE`` times finer than pixels; return it at pixels,
    box included.
    """
    names = [n for n in SPREADS if n in effects]
    if "lens_blur" in names:  # last: its separable form brings the image down to pixels at little cost
        names = [n for n in names if n != "lens_blur"] + ["lens_blur"]
    image = fine_image
    for name in names:
        stride = FINE if name == names[-1] else 1
        p = effects[name]
        if name == "lens_blur":
            sigma = p["sigma_px"] * FINE
            axis = np.arange(-int(np.ceil(4.5 * sigma)), int(np.ceil(4.5 * sigma)) + 1)
            line = np.exp(-0.5 * (axis / sigma) ** 2)
            line = np.convolve(line / line.sum(), np.ones(stride) / stride)
            image = _gaussian_down(image, line.astype(np.float32), stride)
            continue
        shape = (image.shape[0] // stride, image.shape[1] // stride)
        if name == "motion_blur":
            kernels = [_box(_motion_blur_kernel(p["length_px"] * FINE, p["angle_deg"]), stride)]
            which = np.zeros(shape, np.int64)
        else:
            grid = 1 if stride > 1 else FINE
            radius = disc_radius_px(name, depth, camera, effects, margin, grid) * FINE
            kernels = _disc_kernels(float(radius.max()), stride)
            which = np.rint(radius / DISC_STEP).astype(np.int64)
        image = _gather(image, *_runs(kernels), which, stride)
    return image


def stray_light(image, camera, effects, margin):
    """Apply vignetting, ghosts, dust, flare and veiling glare to linear ``image`` (H, W, C) with ``margin``
    pixels around.
    """
    radius = _radius_px(camera, margin, 1)
    if p := effects.get("ghost_double"):
        moved = np.roll(image, (p["dy_px"], p["dx_px"]), (0, 1))
        image = (1 - p["share"]) * image + p["share"] * moved
    if p := effects.get("vignetting"):
        tangent = radius * camera.corner_px / camera.fx
        image = image * ((1 + tangent**2) ** (-p["power"] / 2))[..., None]
    u = np.arange(image.shape[1]) - margin
    v = (np.arange(image.shape[0]) - margin)[:, None]
    if p := effects.get("lens_dust"):
        for cu, cv, size, depth in p["spots"]:
            image = image * (1 - depth / (1 + ((u - cu) ** 2 + (v - cv) ** 2) / size**2) ** 2)[..., None]
    if p := effects.get("lens_flare"):
        glow = np.zeros(image.shape[:2])
        for cu, cv, size, level in p["ghosts"]:
            glow += level / (1 + np.exp((np.hypot(u - cu, v - cv) - size) / 2.0))
        cu, cv, size, level = p["star"]
        r, theta = np.hypot(u - cu, v - cv), np.arctan2(v - cv, u - cu)
        glow += level * np.exp(-r / size) * (0.3 + 0.7 * np.cos(3 * theta) ** 8)
        image = image + glow[..., None]
    if p := effects.get("veiling_glare"):
        frame = image[margin : margin + camera.height, margin : margin + camera.width]
        image = (1 - p["share"]) * image + p["share"] * frame.mean((0, 1))
    return image


def margin_of(camera, effects):
    """Return how many pixels beyond the frame the spreads of ``effects`` may look."""
    reach = 0.0
    if p := effects.get("lens_blur"):
        reach += 4.5 * p["sigma_px"]
    if p := effects.get("motion_blur"):
        reach += p["length_px"] / 2 + 1
    if p := effects.get("defocus"):
        reach += p["aperture_m"] * camera.fx / 2 * max(abs(1 / 0.2 - 1 / p["focus_m"]), 1 / p["focus_m"])
    if p := effects.get("field_curvature"):
        reach += 1.1 * p["corner_radius_px"]
    if p := effects.get("ghost_double"):
        reach += max(abs(p["dx_px"]), abs(p["dy_px"]))
    return int(np.ceil(reach)) + 2 if reach else 0


def soften(image, sigma):
    """Return ``image`` (H, W, C) smoothed by a Gaussian of ``sigma`` pixels within each channel."""
    return gaussian_filter(image, (sigma, sigma, 0), mode="nearest")
