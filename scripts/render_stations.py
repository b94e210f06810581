"""Render: linear radiance of every station of a camera with Blender, each station once.

A station is rendered again only when the scene, the camera, its pose, the settings or Blender's version change: its key
says so, and what has the right key is kept. A run that was killed goes on where it was.
"""

import contextlib
import hashlib
import json
import logging
import math
import time
from dataclasses import asdict
from pathlib import Path

import numpy as np
from tqdm import tqdm

import job
from effects import pipeline
from inputs import render_store, tables
from inputs.scene import load_scene
from rig.errors import InputError
from rig.geometry import camera_matrix, make_pose, split_pose

log = logging.getLogger("twingap")


def station_poses(expand, register_csv, camera):
    """Return {station: T_cam_world}: nominal poses, or the registered ones where a station's pose is unknown."""
    stations = tables.read_table(expand / "stations.csv", tables.STATIONS)
    stations = stations[stations.camera == camera].set_index("station")
    registered = None
    poses = {}
    for name, s in stations.iterrows():
        pose = s[tables.POSE].to_numpy(float)
        if np.isnan(pose).any():
            if registered is None:
                registered = tables.read_table(register_csv, tables.REGISTERED).drop_duplicates("station")
                registered = registered.set_index("station")
            pose = registered.loc[name, tables.POSE].to_numpy(float)
        if np.isfinite(pose).all():
            poses[name] = make_pose(pose[:3], pose[3:])
        else:
            log.info("station %s has no pose (its photograph shows no target): not rendered", name)
    return dict(sorted(poses.items()))


def key_of(scene, K, size, margin, samples, device, version, T_cam_world):
    """Return the hash of everything that decides a station's pixels, the code that renders among it."""
    code = render_store.code_sha256("blender/renderer.py")
    facts = [code, asdict(scene), K, size, margin, samples, device, version, T_cam_world]
    return hashlib.sha256(json.dumps(facts, sort_keys=True, default=_as_lists).encode()).hexdigest()


def _as_lists(array):
    """Return what json.dumps takes for an array; raises TypeError for what is none."""
    if not isinstance(array, np.ndarray | np.generic):
        raise TypeError(
            f"{type(array).__name__} in a render's key: only numbers, text, arrays, lists and dicts can be hashed"
        )
    return array.tolist()


def render_stations(expand, register_csv, register_json, camera, effects, settings, out, timing):
    """Render a camera's stations; write the manifest ``out`` (JSON) and, apart, the seconds each took.

    effects [[name, parameters], ...] of the twin, scene effects; settings: device, edge_samples, overscan, threads.
    """
    from blender.renderer import Renderer, blender_version, find_device

    expand, out = Path(expand), Path(out)
    scene = pipeline.scene_with_effects(load_scene(expand, register_json), [(n, p) for n, p in effects])
    size = tables.read_table(expand / "cameras.csv", tables.CAMERAS).set_index("camera").loc[camera]
    intrinsics = json.loads(Path(register_json).read_text())
    K = camera_matrix(*(intrinsics[k] for k in ("fx", "fy", "cx", "cy")))
    width, height = int(size.width), int(size.height)
    margin = math.ceil(settings["overscan"] * max(width, height))
    poses = station_poses(expand, register_csv, camera)
    folder = out.parent / camera
    kind, device = find_device(settings["device"])
    samples, version = settings["edge_samples"], blender_version()
    keys = {s: key_of(scene, K, (width, height), margin, samples, device, version, T) for s, T in poses.items()}
    wanted = [s for s in poses if render_store.stored_key(folder, s) != keys[s]]
    log.info("%s: %d stations, %d to render on %s", camera, len(poses), len(wanted), device)
    seconds = {}
    if wanted:
        temporary = out.parent / f".{camera}_blender"
        renderer = Renderer(scene, K, width, height, margin, samples, settings["threads"], temporary, kind)
        with contextlib.closing(renderer):
            for station in tqdm(wanted, desc=f"rendering {camera}", unit="station"):
                start = time.perf_counter()
                radiance = renderer.render(poses[station])
                if not np.isfinite(radiance).all():
                    raise InputError(f"{camera}, station {station}: Blender gave values that are no numbers")
                render_store.write_station(folder, station, radiance, margin, keys[station])
                seconds[station] = time.perf_counter() - start
    rendered = {s: scene.T_cam_mount @ T for s, T in poses.items()}
    _write_manifest(out, folder, rendered, keys, margin, settings, device, version)
    with job.write_atomically(timing) as file:
        file.write("station,seconds\n" + "".join(f"{s},{t:.3f}\n" for s, t in seconds.items()))


def _write_manifest(out, folder, poses, keys, margin, settings, device, version):
    stations = {}
    for station, T in poses.items():
        entry = {"file": f"{folder.name}/{station}.npz", "key": keys[station]}
        radiance, _ = render_store.read_station(folder.parent, entry)
        rvec, tvec = split_pose(T)
        stations[station] = entry | {
            "pixels_sha256": render_store.pixels_sha256(radiance),
            "pose": [*map(float, rvec), *map(float, tvec)],
        }
    manifest = {
        "blender": version,
        "device": device,
        "margin_px": margin,
        "edge_samples": settings["edge_samples"],
        "stations": stations,
    }
    with job.write_atomically(out) as file:
        json.dump(manifest, file, indent=1, sort_keys=True)


if __name__ == "__main__":
    job.run(
        render_stations,
        snakemake,
        expand=Path(snakemake.input.scene).parent,
        register_csv=snakemake.input.register_csv,
        register_json=snakemake.input.register_json,
        camera=snakemake.wildcards.camera,
        effects=snakemake.params.effects,
        settings=snakemake.params.settings,
        out=snakemake.output.manifest,
        timing=snakemake.output.timing,
    )
