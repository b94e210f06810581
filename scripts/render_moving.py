"""Render: the frames of one trajectory with motion blur and rolling shutter, as 8-bit images.

A frame's linear render is kept under a key of everything that decides its pixels: a run that was killed goes on where
it was, and a camera at rest is rendered once.
"""

import contextlib
import hashlib
import json
import logging
import time
from pathlib import Path

import cv2
import numpy as np
from tqdm import tqdm

import job
from effects import pipeline
from effects.base import Scene, View
from inputs import render_store
from markers.contract import marker_plate
from moving.config import load_moving
from moving.truth import occluder_x_m, trajectory_of
from rig.errors import InputError
from whole_folder import whole_folder

log = logging.getLogger("twingap")


def frame_name(frame):
    """Return the name of a frame's image."""
    return f"{frame:06d}.png"


def moving_scene(moving):
    """Return the effects.base.Scene of a moving experiment."""
    r = moving.file.reflectance
    plates = tuple(marker_plate(marker) for marker in moving.markers.itertuples())
    return Scene(plates, r.white, r.black, r.ground, r.background)


def frame_key(facts, poses, places):
    """Return the hash of what decides a frame's pixels: ``facts`` of the sequence, poses and places in the exposure."""
    digest = hashlib.sha256(facts)
    digest.update(np.ascontiguousarray(poses).tobytes() + np.ascontiguousarray(places).tobytes())
    return digest.hexdigest()


def sequence_facts(moving, name, version):
    """Return bytes that hold everything but the frame's poses: code, plates, camera, shutter, Blender's version."""
    digest = hashlib.sha256(render_store.code_sha256("blender/moving.py").encode())
    file = moving.file
    occluder = file.trajectories[name].occluder
    facts = [moving.K.tolist(), moving.shape, file.samples, file.exposure_s, file.readout_s, version]
    facts += [file.reflectance.model_dump(), occluder.model_dump() if occluder else None]
    digest.update(moving.markers.to_csv(index=False).encode() + json.dumps(facts, sort_keys=True).encode())
    return digest.digest()


def render_moving(experiment, trajectory, store, out, timing):
    """Render a trajectory's frames into the folder ``store`` and write them as images to the folder ``out``.

    timing  table of the seconds that each frame took that was rendered now
    """
    from blender.moving import MovingRenderer
    from blender.renderer import blender_version

    moving, store, out = load_moving(experiment), Path(store), Path(out)
    file, motion, pose = moving.file, moving.file.trajectories[trajectory], trajectory_of(moving, trajectory)
    facts = sequence_facts(moving, trajectory, blender_version())
    height, width = moving.shape
    shutter = (file.exposure_s, file.readout_s)
    renderer = MovingRenderer(
        moving_scene(moving), moving.K, width, height, file.samples, *shutter, motion.occluder, file.threads,
        store.parent / f".{trajectory}_blender",
    )  # fmt: skip
    keys, seconds = [], []
    with contextlib.closing(renderer):
        for frame, t_s in enumerate(tqdm(moving.times_s, desc=f"rendering {trajectory}", unit="frame")):
            instants = t_s + renderer.instants_s()
            poses = [pose(t) for t in instants]
            places = occluder_x_m(motion.occluder, instants) if motion.occluder else np.zeros(0)
            key = frame_key(facts, poses, places)
            keys.append(key)
            if render_store.stored_key(store, key) == key:
                continue
            start = time.perf_counter()
            radiance = renderer.render_frame(poses, places)
            if not np.isfinite(radiance).all():
                raise InputError(f"{trajectory}, frame {frame}: Blender gave values that are no numbers")
            render_store.write_station(store, key, radiance, 0, key)
            seconds.append((frame, time.perf_counter() - start))
    for path in store.glob("*.npz"):  # of an earlier configuration
        if path.stem not in keys:
            path.unlink()
    write_frames(moving, trajectory, store, keys, out)
    with job.write_atomically(timing) as csv:
        csv.write("frame,seconds\n" + "".join(f"{frame},{s:.3f}\n" for frame, s in seconds))
    log.info("%s: %d frames, %d rendered now", trajectory, len(keys), len(seconds))


def write_frames(moving, trajectory, store, keys, out):
    """Write the stored renders as PNG with the camera's noise, each frame with noise of its own."""
    height, width = moving.shape
    view = View(moving.K, width, height, 0, np.eye(4), "moving", trajectory, trajectory, noise_dn=moving.file.noise_dn)
    with whole_folder(out) as folder:
        for frame, key in enumerate(keys):
            radiance, _ = render_store.read_station(store, {"file": f"{key}.npz", "key": key})
            rng = np.random.default_rng(
                job.seed_of(moving.file.seed, "moving", moving.file.name, trajectory, frame, "noise")
            )
            image = pipeline.to_uint8(pipeline.form_image(radiance, view, [], rng))
            ok, data = cv2.imencode(".png", image[..., 0], [cv2.IMWRITE_PNG_COMPRESSION, 3])
            if not ok:
                raise RuntimeError(f"{trajectory}, frame {frame}: PNG encoding failed")
            (folder / frame_name(frame)).write_bytes(data.tobytes())


if __name__ == "__main__":
    job.run(
        render_moving,
        snakemake,
        experiment=snakemake.input.experiment,
        trajectory=snakemake.wildcards.trajectory,
        store=snakemake.params.store,
        out=snakemake.output.frames,
        timing=snakemake.output.timing,
    )
