"""Render: CPU seconds per megapixel against the plain way, side by side, and the peak memory of a job at 3840x2160.

``python tests/bench/bench_render.py`` prints a table and records it (record.py). The plain way is one Blender process per station, a lamp,
Principled shaders, and as many samples in every pixel as bring its edges to the same error, found by doubling.
"""

import json
import os
import resource
import subprocess
import sys
import tempfile
from pathlib import Path

import numpy as np

ROOT = Path(__file__).resolve().parents[2]
sys.path[:0] = [str(ROOT / "scripts"), str(ROOT / "tests" / "blender"), str(ROOT / "tests" / "bench")]

import pandas as pd  # noqa: E402
from exact_coverage import exact_radiance  # noqa: E402

from bench_geometry import encoded  # noqa: E402
from effects.base import Scene  # noqa: E402
from markers.contract import marker_plate  # noqa: E402
from record import record  # noqa: E402
from rig.geometry import camera_matrix, invert_pose, station_pose  # noqa: E402

WIDTH, HEIGHT, FOCAL_PX = 480, 270, 370.0  # the HP 325's field of view on a quarter of its pixels
HEIGHT_M, TILT_DEG, STATIONS = 0.6, 45, 3
EDGE_SAMPLES = 256
MAX_PLAIN_SAMPLES = 2048


def rig():
    """Return two ladders of ten plates."""
    columns = ["dictionary", "id", "code_m", "plate_m", "x", "y", "z", "rx", "ry", "rz"]
    side = [-0.1, 0.1]
    rows = [["DICT_5X5_1000", i, 0.08, 0.1, side[i // 10], 0.15 * (i % 10), 0, 0, 0, 0] for i in range(20)]
    table = pd.DataFrame(rows, columns=columns)
    return Scene(tuple(marker_plate(m) for m in table.itertuples()), 0.8, 0.05, 0.35, 0.3)


def pose(k):
    """Return T_cam_world of the k-th station."""
    return station_pose(HEIGHT_M + 0.05 * k, TILT_DEG)


def edge_error(radiance, scene, K, T, width, height):
    """Return the RMS error, grey levels, of the pixels that an edge crosses."""
    exact, edge = exact_radiance(scene, K, T, width, height, 0)
    return float(np.sqrt(((encoded(radiance) - encoded(exact))[edge] ** 2).mean()))


def ours(scale, stations, samples):
    """Render stations in this process; return what it cost and how good it is."""
    from blender.renderer import Renderer

    scene, width, height = rig(), WIDTH * scale, HEIGHT * scale
    K = camera_matrix(FOCAL_PX * scale, FOCAL_PX * scale, (width - 1) / 2, (height - 1) / 2)
    margin = 0 if scale == 1 else int(np.ceil(0.12 * width))
    with tempfile.TemporaryDirectory() as folder:
        renderer = Renderer(scene, K, width, height, margin, samples, 1, Path(folder) / "blender")
        images = [renderer.render(pose(k)) for k in range(stations)]
        renderer.close()
    cost = used()
    return cost | {"rms_dn": edge_error(images[0], scene, K, pose(0), width, height) if scale == 1 else None}


def plain(samples):
    """Render one station in the plain way in this process; return what it cost and how good it is."""
    import bpy
    from mathutils import Matrix

    from blender.renderer import Renderer

    scene = rig()
    K = camera_matrix(FOCAL_PX, FOCAL_PX, (WIDTH - 1) / 2, (HEIGHT - 1) / 2)
    with tempfile.TemporaryDirectory() as folder:
        renderer = Renderer(scene, K, WIDTH, HEIGHT, 0, samples, 1, Path(folder) / "blender")
        bpy.context.scene.world.cycles_visibility.diffuse = False  # or the sky would light the rig once more
        lamp = bpy.data.lights.new("lamp", "SUN")
        lamp.energy = np.pi  # a white surface facing it then has radiance 1
        lamp.use_shadow = False  # plates hover a millimetre over the ground
        bpy.context.collection.objects.link(bpy.data.objects.new("lamp", lamp))
        levels = {"black": scene.black, "white": scene.white, "ground": scene.ground}
        for name, level in levels.items():
            tree = bpy.data.materials[name].node_tree
            tree.nodes.clear()
            shader = tree.nodes.new("ShaderNodeBsdfPrincipled")
            shader.inputs["Base Color"].default_value = (level, level, level, 1)
            shader.inputs["Roughness"].default_value = 1.0
            shader.inputs["Specular IOR Level"].default_value = 0.0
            tree.links.new(shader.outputs[0], tree.nodes.new("ShaderNodeOutputMaterial").inputs["Surface"])
        cycles = bpy.context.scene.cycles
        cycles.use_adaptive_sampling, cycles.samples = False, samples  # no bounces: in the plain way's favour
        cycles.filter_width = 1.0
        renderer._use_pinhole()
        renderer.camera.matrix_world = Matrix((invert_pose(pose(0)) @ np.diag([1.0, -1, -1, 1])).tolist())
        image = renderer._run(renderer.shape)
        renderer.close()
    cost = used()
    return cost | {"rms_dn": edge_error(image, scene, K, pose(0), WIDTH, HEIGHT)}


def used():
    """Return the CPU seconds and the peak memory of this process."""
    t = os.times()
    return {"cpu_s": t.user + t.system, "peak_gib": resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 2**20}


def in_a_process(call):
    """Return the result of a call, such as ``plain(64)``, of this file in a process of its own."""
    code = f"import json, bench_render; print('RESULT' + json.dumps(bench_render.{call}))"
    done = subprocess.run(
        [sys.executable, "-c", code], cwd=Path(__file__).parent, capture_output=True, text=True, check=True
    )
    return json.loads(done.stdout.split("RESULT")[1])


def main():
    """Print the table."""
    megapixels = WIDTH * HEIGHT / 1e6
    one, more = in_a_process(f"ours(1, 1, {EDGE_SAMPLES})"), in_a_process(f"ours(1, {1 + STATIONS}, {EDGE_SAMPLES})")
    further = (more["cpu_s"] - one["cpu_s"]) / STATIONS
    rows = [["ours, a further station", EDGE_SAMPLES, one["rms_dn"], further, further / megapixels]]
    rows.append(["ours, start-up and first", EDGE_SAMPLES, one["rms_dn"], one["cpu_s"], one["cpu_s"] / megapixels])
    samples = EDGE_SAMPLES
    while samples <= MAX_PLAIN_SAMPLES:
        got = in_a_process(f"plain({samples})")
        rows.append(["plain, a process", samples, got["rms_dn"], got["cpu_s"], got["cpu_s"] / megapixels])
        if got["rms_dn"] <= one["rms_dn"] * 1.05:
            break
        samples *= 2
    table = pd.DataFrame(rows, columns=["way", "samples", "edge_rms_dn", "cpu_s", "cpu_s_per_mpx"])
    print(table.round(3).to_markdown(index=False))
    print(f"\nplain over ours, CPU seconds at that edge error: {got['cpu_s'] / further:.0f}\n", flush=True)
    full = in_a_process(f"ours(8, 2, {EDGE_SAMPLES})")
    print(f"3840x2160 with 12 % overscan, two stations: {full['cpu_s']:.1f} CPU s, peak {full['peak_gib']:.2f} GiB")
    record(
        [
            ("render of a further station, CPU", further, "s"),
            ("render of a station in the plain way at the same edge error, CPU", got["cpu_s"], "s"),
            ("the plain way over a further station", got["cpu_s"] / further, "times"),
            ("peak memory of a render job at 3840x2160", full["peak_gib"], "GiB"),
        ]
    )


if __name__ == "__main__":
    main()
