"""Build a rig in Blender and render its linear radiance; one process renders many stations.

Light is emission: radiance = reflectance. Flat ground has no noise then, and needs one sample; samples are spent where
edges are. A station is rendered twice: every pixel once, at its centre, with Blender's perspective camera; then the
pixels that an edge crosses, and no other, hundreds of times, packed into a small picture by a camera of our own (an OSL
shader that looks up which pixel each of its pixels stands for). docs/render.md holds what was measured.

The pixel is a box one pixel wide; the centre of the frame's top-left pixel is (0, 0), OpenCV's convention.
"""

import contextlib
import errno
import hashlib
import os
import re
import shutil
import tempfile
from pathlib import Path

import bpy
import numpy as np
from mathutils import Matrix

from blender.edges import edge_pixels, edge_segments, overlooked_jumps
from blender.faces import plate_faces
from blender.materials import combine, constant, emitting_material
from rig.geometry import invert_pose
from rig.plates import printed_plates

GROUND_BELOW_M = 0.001  # below the lowest plate: the ground is even, so its depth does not show
GROUND_REACH_M = 1e5
SENSOR_MM = 36.0
POINT_FILTER_PX = 0.01  # the narrowest filter that Cycles has: the pixel's centre
BOX_FILTER_PX = 1.0
PACKED_COLUMNS = 512
MIN_ROWS = 4  # Blender renders no smaller picture
ADAPTIVE_THRESHOLD = 1e-3
PLAIN = r"[A-Za-z0-9_./ -]*"  # paths that need no quoting anywhere
BLACK, WHITE = 0, 1

# Each pixel of the packed picture stands for one pixel of the camera; the table holds the ray through its centre.
PACKED_CAMERA = """
shader packed_camera(output point position = 0, output vector direction = 0, output color throughput = 1)
{{
    point raster = camera_shader_raster_position();
    float x = raster[0] * {columns}, y = raster[1] * {rows};
    float column = min(floor(x), {columns} - 1), row = min(floor(y), {rows} - 1);
    color ray = texture("{table}", (column + 0.5) / {columns}, 1 - (row + 0.5) / {rows}, "interp", "closest");
    direction = normalize(vector(ray[0] + (x - column - 0.5) * {step_x}, (y - row - 0.5) * {step_y} - ray[1], 1));
}}
"""


def blender_version():
    """Return Blender's version, such as ``5.2.3 LTS``."""
    return bpy.app.version_string


def find_device(wanted):
    """Return (kind, name) of what Cycles will use: CPU, or a GPU where one is ``wanted`` ("gpu") and found."""
    if wanted == "gpu":
        preferences = bpy.context.preferences.addons["cycles"].preferences
        for kind in ("OPTIX", "CUDA", "HIP", "METAL", "ONEAPI"):
            try:
                preferences.compute_device_type = kind
            except TypeError:
                continue
            preferences.refresh_devices()
            found = [d for d in preferences.devices if d.type == kind]
            if found:
                for d in preferences.devices:
                    d.use = d.type == kind
                return kind, found[0].name
    return "CPU", "CPU"


class Renderer:
    """A Blender scene of one rig and one camera; ``render`` gives a station's radiance.

    scene is an effects.base.Scene, K the 3 x 3 intrinsics in pixels, margin the overscan in pixels on each side,
    edge_samples the samples of a pixel that an edge crosses, device a kind of ``find_device``; temporary files lie in
    ``folder``, which ``close`` removes.
    """

    def __init__(self, scene, K, width, height, margin, edge_samples, threads, folder, device="CPU"):
        bpy.ops.wm.read_factory_settings(use_empty=True)
        self.scene, self.K, self.margin, self.edge_samples, self.device = scene, K, margin, edge_samples, device
        self.shape = (height + 2 * margin, width + 2 * margin)
        self.made = [Path(folder).absolute()]
        shutil.rmtree(self.made[0], ignore_errors=True)  # what a killed run left
        self.made[0].mkdir(parents=True)
        self.folder = self._plain_path(self.made[0])
        bpy.context.preferences.filepaths.temporary_directory = str(self.folder)
        self.plates = printed_plates(scene)
        self.segments = edge_segments(self.plates)
        self._set_up_cycles(threads)
        self._add_world()
        self._add_ground()
        self._add_plates()
        self.camera = self._add_camera()

    def close(self):
        """Remove the temporary files."""
        for folder in self.made:
            shutil.rmtree(folder, ignore_errors=True)

    def _plain_path(self, folder):
        """Return a path to a folder that Blender and OSL take as it is: quotes, ``#``, ``%`` or ``<`` mean something to them."""
        if re.fullmatch(PLAIN, str(folder)):
            return folder
        self.made.append(Path(tempfile.mkdtemp(prefix="twingap_")))
        (self.made[-1] / "link").symlink_to(folder, target_is_directory=True)
        return self.made[-1] / "link"

    def render(self, T_cam_world):
        """Return the linear radiance (H + 2m, W + 2m) float32 of the rig seen from a pose.

        Raises OSError where the disk is full.
        """
        pose = self.scene.T_cam_mount @ T_cam_world
        # Blender's cameras look along -z with y up
        self.camera.matrix_world = Matrix((invert_pose(pose) @ np.diag([1.0, -1.0, -1.0, 1.0])).tolist())
        if self.device != "CPU":
            return self._render_adaptively()
        radiance = self._render_centres()
        edges = edge_pixels(self.segments, self.K, pose, self.shape, self.margin)
        edges |= overlooked_jumps(radiance, edges)
        if edges.any():
            radiance[edges] = self._render_packed(np.argwhere(edges))
        return radiance

    def _render_centres(self):
        """Return what each pixel's centre sees."""
        self._use_pinhole()
        cycles = bpy.context.scene.cycles
        cycles.samples, cycles.filter_width, cycles.use_adaptive_sampling = 1, POINT_FILTER_PX, False
        return self._run(self.shape)

    def _render_packed(self, pixels):
        """Return the mean radiance (n,) over the squares of pixels (n, 2), rows and columns of the array."""
        rows = max(MIN_ROWS, -(-len(pixels) // PACKED_COLUMNS))
        table = self._write_rays(pixels, rows)
        self._use_packed_camera(table, rows)
        cycles = bpy.context.scene.cycles
        cycles.samples, cycles.filter_width, cycles.use_adaptive_sampling = self.edge_samples, BOX_FILTER_PX, False
        try:
            return self._run((rows, PACKED_COLUMNS)).ravel()[: len(pixels)]
        finally:
            table.unlink()

    def _render_adaptively(self):
        """Return the radiance by adaptive sampling: custom cameras do not run on every GPU."""
        self._use_pinhole()
        cycles = bpy.context.scene.cycles
        cycles.samples, cycles.filter_width, cycles.use_adaptive_sampling = self.edge_samples, BOX_FILTER_PX, True
        cycles.adaptive_threshold, cycles.adaptive_min_samples = ADAPTIVE_THRESHOLD, 1
        return self._run(self.shape)

    def _use_pinhole(self):
        """Give Blender's perspective camera the intrinsics, in its own words."""
        height, width = self.shape
        camera, render = self.camera.data, bpy.context.scene.render
        fx, fy = self.K[0, 0], self.K[1, 1]
        aspect = float(fx / fy)
        camera.type = "PERSP"
        camera.lens = float(fx * SENSOR_MM / width)
        render.pixel_aspect_x, render.pixel_aspect_y = (1.0, aspect) if aspect >= 1 else (1 / aspect, 1.0)
        # array coordinates of the principal point, counted from the array's edge
        cx, cy = self.K[0, 2] + self.margin + 0.5, self.K[1, 2] + self.margin + 0.5
        camera.shift_x = float((width / 2 - cx) / width)
        camera.shift_y = float((cy - height / 2) / width * aspect)

    def _write_rays(self, pixels, rows):
        """Write the rays (x/z, y/z) through the centres of pixels as a picture; return its path, new for each call."""
        rays = np.zeros((rows * PACKED_COLUMNS, 4), np.float32)
        xy = pixels[:, ::-1] - self.margin
        rays[: len(pixels), :2] = (xy - self.K[:2, 2]) / (self.K[0, 0], self.K[1, 1])
        image = bpy.data.images.new("rays", PACKED_COLUMNS, rows, float_buffer=True, is_data=True)
        path = self.folder / f"rays_{hashlib.sha256(rays.tobytes()).hexdigest()[:16]}.exr"
        try:
            image.pixels.foreach_set(rays.ravel())
            image.filepath_raw, image.file_format = str(path), "OPEN_EXR"
            with _disk_full(path):
                image.save()
        finally:
            bpy.data.images.remove(image)
        return path

    def _use_packed_camera(self, table, rows):
        """Compile the packed camera for Cycles; not by Blender's operator, whose oslquery the wheel lacks."""
        import _cycles  # built into Blender: there once bpy is loaded

        source, compiled = self.folder / "packed.osl", self.folder / "packed.oso"
        source.write_text(
            PACKED_CAMERA.format(
                columns=float(PACKED_COLUMNS),
                rows=float(rows),
                table=table.as_posix(),
                step_x=float(1 / self.K[0, 0]),
                step_y=float(1 / self.K[1, 1]),
            )
        )
        if not _cycles.osl_compile(str(source), str(compiled)):
            raise RuntimeError(f"Blender's OSL compiler refused {source}")
        camera, code = self.camera.data, compiled.read_text()
        camera.type, camera.custom_mode = "CUSTOM", "INTERNAL"
        camera.shift_x = camera.shift_y = 0.0
        render = bpy.context.scene.render
        render.pixel_aspect_x = render.pixel_aspect_y = 1.0
        camera.custom_bytecode, camera.custom_bytecode_hash = code, hashlib.sha256(code.encode()).hexdigest()[:32]

    def _run(self, shape):
        """Render and return the pixels (rows, columns) float32."""
        render, path = bpy.context.scene.render, self.folder / "render.exr"
        render.resolution_y, render.resolution_x = shape
        render.filepath = str(path)
        with _disk_full(path):
            bpy.ops.render.render(write_still=True)
        pixels = _read_exr(path, shape)
        path.unlink()
        return pixels

    def _set_up_cycles(self, threads):
        s = bpy.context.scene
        s.render.engine = "CYCLES"
        s.cycles.device = "CPU" if self.device == "CPU" else "GPU"
        s.cycles.use_denoising = False
        s.cycles.seed = 0
        s.cycles.max_bounces = 0
        s.cycles.pixel_filter_type = "BOX"
        s.cycles.sampling_pattern = "TABULATED_SOBOL"
        s.cycles.film_exposure = 1.0
        s.render.use_persistent_data = True
        s.render.threads_mode, s.render.threads = "FIXED", threads
        s.render.resolution_percentage = 100
        s.render.film_transparent = False
        s.render.use_compositing = s.render.use_sequencer = False
        s.render.image_settings.file_format = "OPEN_EXR"
        s.render.image_settings.color_mode = "BW"
        s.render.image_settings.color_depth = "32"
        s.render.image_settings.exr_codec = "NONE"
        s.view_settings.view_transform = "Raw"
        s.render.dither_intensity = 0

    def _add_world(self):
        """Add the background above the horizon; below it the ground goes on where its mesh ends."""
        world = bpy.data.worlds.new("background")
        bpy.context.scene.world = world
        world.cycles.sampling_method = "NONE"
        world.use_nodes = True
        tree = world.node_tree
        tree.nodes.clear()
        emission = tree.nodes.new("ShaderNodeBackground")
        emission.inputs["Color"].default_value = (1, 1, 1, 1)
        direction = tree.nodes.new("ShaderNodeSeparateXYZ")
        tree.links.new(tree.nodes.new("ShaderNodeTexCoord").outputs["Generated"], direction.inputs[0])
        above = combine(tree, "GREATER_THAN", direction.outputs["Z"], constant(tree, 0.0))
        step = combine(tree, "MULTIPLY", above, constant(tree, self.scene.background - self.scene.ground))
        tree.links.new(combine(tree, "ADD", step, constant(tree, self.scene.ground)), emission.inputs["Strength"])
        tree.links.new(emission.outputs[0], tree.nodes.new("ShaderNodeOutputWorld").inputs[0])

    def _add_ground(self):
        lowest = min((float(p.grid_world()[..., 2].min()) for p in self.plates), default=0.0)
        z, r = min(lowest, 0.0) - GROUND_BELOW_M, GROUND_REACH_M
        mesh = bpy.data.meshes.new("ground")
        mesh.from_pydata([(-r, -r, z), (r, -r, z), (r, r, z), (-r, r, z)], [], [(0, 1, 2, 3)])
        mesh.materials.append(emitting_material(self.scene, "ground", self.scene.ground, glossy=False))
        bpy.context.collection.objects.link(bpy.data.objects.new("ground", mesh))

    def _add_plates(self):
        vertices, faces, kinds = [], [], []
        for plate in self.plates:
            points, corners, white = plate_faces(plate)
            first = len(vertices)
            vertices.extend(map(tuple, points.tolist()))
            faces.extend(tuple(first + k for k in face) for face in corners)
            kinds.extend(WHITE if w else BLACK for w in white)
        mesh = bpy.data.meshes.new("plates")
        mesh.from_pydata(vertices, [], faces)
        for name, level in (("black", self.scene.black), ("white", self.scene.white)):
            mesh.materials.append(emitting_material(self.scene, name, level, glossy=True))
        mesh.polygons.foreach_set("material_index", kinds)
        bpy.context.collection.objects.link(bpy.data.objects.new("plates", mesh))

    def _add_camera(self):
        data = bpy.data.cameras.new("camera")
        data.sensor_fit, data.sensor_width = "HORIZONTAL", SENSOR_MM
        data.clip_start, data.clip_end = 1e-3, 10 * GROUND_REACH_M
        camera = bpy.data.objects.new("camera", data)
        bpy.context.collection.objects.link(camera)
        bpy.context.scene.camera = camera
        return camera


@contextlib.contextmanager
def _disk_full(path):
    """Turn Blender's error in writing a file into an OSError that names it, a full disk above all."""
    try:
        yield
    except RuntimeError as error:
        free = os.statvfs(Path(path).parent).f_bavail
        raise OSError(errno.EIO if free else errno.ENOSPC, _reason(free, error), str(path)) from None


def _reason(free, error):
    return str(error).strip() if free else os.strerror(errno.ENOSPC)


def _read_exr(path, shape):
    """Return the pixels (rows, columns) float32 of an uncompressed EXR file of one 32-bit channel.

    Its end is a chunk a row: the row's number, its size in bytes, its values (OpenEXR file layout). Read so, a large
    render is in memory once; through Blender's images it would be there four times more.
    """
    rows, columns = shape
    chunk = np.dtype([("row", "<i4"), ("bytes", "<i4"), ("values", "<f4", columns)])
    size = path.stat().st_size
    if size < rows * chunk.itemsize:
        raise OSError(errno.ENOSPC, "render cut short, the disk is full", str(path))
    chunks = np.fromfile(path, chunk, rows, offset=size - rows * chunk.itemsize)
    if not (np.array_equal(chunks["row"], np.arange(rows)) and (chunks["bytes"] == 4 * columns).all()):
        raise OSError(errno.EIO, "Blender wrote an EXR file of another layout", str(path))
    return np.ascontiguousarray(chunks["values"])
