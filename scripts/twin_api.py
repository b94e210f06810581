"""{camera} of the campaign {campaign}, as a function of images: what its lens, shutter, sensor and processing do.

    import twin_camera
    photograph = twin_camera.apply(radiance)         # a render in linear light -> 8 bits
    photograph = twin_camera.apply_to_image(image)   # any clean picture of 8 bits -> the same as this camera shows it
    pixels = twin_camera.project(points)             # points in the camera's frame -> where they land

    python twin_camera.py CLEAN.png PHOTOGRAPH.png --seed 1

Images are arrays (H, W) or (H, W, 3), red first. They are as large as the frame, {width} x {height}, or larger by the same
margin on each side, into which distortion and blur look. The centre of the frame's top-left pixel is (0, 0).
Needs numpy and OpenCV. Where numba is installed loops are compiled, and a frame takes a second, not minutes.
"""

import argparse

import cv2
import numpy as np

from effects.base import View
from effects.encoding import decode
from effects.pipeline import SPARE_PX, active, form_image, inverse_points, map_points, reach_px, to_uint8
from rig.errors import InputError

# name, camera, campaign, K, width, height, exposure, encoding, noise_dn, effects, left_out
TWIN: dict = {}


class _NoPose:
    """Stands for a pose that was not given, until an effect asks for it."""

    def __getitem__(self, key):
        raise InputError(
            "an effect of this twin depends on depth: give T_cam_world, 4 x 4, the ground being the plane z = 0"
        )


def _view(margin=0, T_cam_world=None, name="image"):
    pose = _NoPose() if T_cam_world is None else np.asarray(T_cam_world, float)
    K = np.array(TWIN["K"], float)
    return View(
        K, TWIN["width"], TWIN["height"], margin, pose, TWIN["camera"], name, name,
        TWIN["exposure"], TWIN["encoding"], TWIN["noise_dn"],
    )  # fmt: skip


def _effects():
    return [(name, dict(parameters)) for name, parameters in TWIN["effects"]]


def project(points, channel=1, T_cam_world=None):
    """Return the pixels (n, 2) of points (n, 3) in the camera's frame (x right, y down, z forward), in front of it.

    channel  0, 1, 2: red, green, blue
    """
    x, y, z = np.asarray(points, float).T
    view = _view(T_cam_world=T_cam_world)
    pinhole = np.stack([view.K[0, 0] * x / z + view.K[0, 2], view.K[1, 1] * y / z + view.K[1, 2]], axis=1)
    return map_points(pinhole, view, _effects(), channel)


def margin_px(T_cam_world=None):
    """Return the margin, pixels on each side, that a render needs for the effects to find all they look at."""
    view, chosen = _view(T_cam_world=T_cam_world), _effects()
    if not active(chosen, "map_points"):
        return int(np.ceil(reach_px(chosen)))
    x, y = np.arange(view.width, dtype=float), np.arange(view.height, dtype=float)
    rim = [(x, 0 * x), (x, 0 * x + view.height - 1), (0 * y, y), (0 * y + view.width - 1, y)]
    rim = np.concatenate([np.stack(side, axis=1) for side in rim])
    last = np.array([view.width - 1, view.height - 1])
    beyond = 0.0
    for channel in (0, 1, 2):
        ideal = inverse_points(rim, view, chosen, channel)
        if not np.isfinite(ideal).all():
            raise InputError("the lens has no ray for some pixels of the frame")
        beyond = max(beyond, float((-ideal).max()), float((ideal - last).max()))
    return int(np.ceil(beyond + reach_px(chosen))) + SPARE_PX


def apply(radiance, seed=0, T_cam_world=None, fill=False):
    """Return the 8-bit image (H, W) or (H, W, 3), the frame cut out, that the camera makes of linear radiance.

    radiance     1 is what the campaign's exposure takes to full scale
    seed         of the noise: another one is another photograph
    T_cam_world  4 x 4, metres: where effects that depend on depth have the ground, z = 0
    fill         repeat the edge's pixels where the margin is too narrow, instead of raising InputError
    """
    radiance = np.asarray(radiance, np.float32)
    if radiance.ndim not in (2, 3) or (radiance.ndim == 3 and radiance.shape[2] not in (1, 3)):
        raise InputError(f"an image (H, W) or (H, W, 3) is needed, not {radiance.shape}")
    across, down = radiance.shape[1] - TWIN["width"], radiance.shape[0] - TWIN["height"]
    if across != down or across < 0 or across % 2:
        raise InputError(
            f"{radiance.shape[1]} x {radiance.shape[0]} pixels; {TWIN['width']} x {TWIN['height']} are needed, or more "
            "by the same even number"
        )
    margin = across // 2
    if fill and (more := margin_px(T_cam_world) - margin) > 0:
        radiance = np.pad(radiance, [(more, more)] * 2 + [(0, 0)] * (radiance.ndim - 2), mode="edge")
        margin += more
    rng = np.random.default_rng(seed)
    image = to_uint8(form_image(radiance, _view(margin, T_cam_world), _effects(), rng))
    return image[..., 0] if image.shape[2] == 1 else image


def apply_to_image(image, seed=0, T_cam_world=None, fill=True):
    """Return what the camera shows of a clean 8-bit image: what ``apply`` gives of the light that the image stands for."""
    light = decode(np.asarray(image, np.float32), TWIN["encoding"]) / np.float32(TWIN["exposure"])
    return apply(light, seed, T_cam_world, fill)


def main(arguments=None):
    """Turn one clean image file into a photograph."""
    parser = argparse.ArgumentParser(description="What this camera makes of a clean image.")
    parser.add_argument("clean", help="image file, sRGB or as the campaign's encoding says")
    parser.add_argument("photograph", help="image file to write")
    parser.add_argument("--seed", type=int, default=0, help="of the noise")
    given = parser.parse_args(arguments)
    clean = cv2.imread(given.clean, cv2.IMREAD_UNCHANGED)
    if clean is None or clean.dtype != np.uint8:
        raise SystemExit(f"error: {given.clean}: no image of 8 bits")
    if clean.ndim == 3:
        clean = clean[..., 2::-1]
    try:
        made = apply_to_image(clean, given.seed)
    except InputError as error:
        raise SystemExit(f"error: {error}") from None
    if not cv2.imwrite(given.photograph, made if made.ndim == 2 else made[..., ::-1]):
        raise SystemExit(f"error: {given.photograph}: can't be written")


if __name__ == "__main__":
    main()
