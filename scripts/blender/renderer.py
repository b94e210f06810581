"""Build a rig in Blender and render its linear radiance; one process renders many stations.

Light is emission: radiance = reflectance. Flat ground then has no noise at all, and samples are spent where edges are:
adaptive sampling stops a pixel after a few samples unless it or a neighbour varies. The pixel is a box one pixel wide;
the centre of the frame's top-left pixel is (0, 0), OpenCV's convention.
"""

import tempfile
from pathlib import Path

import bpy
import numpy as np
from mathutils import Matrix

from rig.geometry import invert_pose
from rig.plates import spread_ink

GROUND_BELOW_M = 0.001  # below the lowest plate: the ground is even, so its depth shows at the horizon alone
GROUND_REACH_M = 1e5
SENSOR_MM = 36.0
FLAT_SAMPLES = 4
ADAPTIVE_THRESHOLD = 1e-3
BLACK, WHITE = 0, 1


def blender_version():
    """Return Blender's version, such as ``5.2.3 LTS``."""
    return bpy.app.version_string


def choose_device(wanted):
    """Return the device that Cycles will use: ``CPU``, or the GPU's kind and name where one is wanted and found."""
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
                bpy.context.scene.cycles.device = "GPU"
                return f"{kind} {found[0].name}"
    bpy.context.scene.cycles.device = "CPU"
    return "CPU"


class Renderer:
    """A Blender scene of one rig and one camera; ``render`` gives a station's radiance.

    scene is an effects.base.Scene, K the 3 x 3 intrinsics in pixels, margin the overscan in pixels on each side.
    """

    def __init__(self, scene, K, width, height, margin, edge_samples, threads, device="cpu"):
        bpy.ops.wm.read_factory_settings(use_empty=True)
        self.scene, self.margin = scene, margin
        self.shape = (height + 2 * margin, width + 2 * margin)
        self._set_up_cycles(edge_samples, threads)
        self.device = choose_device(device)
        self._add_world()
        self._add_ground()
        self._add_plates()
        self.camera = self._add_camera(K)

    def render(self, T_cam_world):
        """Return the linear radiance (H + 2m, W + 2m) float32 of the rig seen from a pose."""
        T_world_cam = invert_pose(self.scene.T_cam_mount @ T_cam_world)
        # Blender's cameras look along -z with y up
        self.camera.matrix_world = Matrix((T_world_cam @ np.diag([1.0, -1.0, -1.0, 1.0])).tolist())
        with tempfile.TemporaryDirectory() as folder:
            path = str(Path(folder) / "render.exr")
            bpy.context.scene.render.filepath = path
            bpy.ops.render.render(write_still=True)
            return self._read(path)

    def _read(self, path):
        image = bpy.data.images.load(path)
        try:
            pixels = np.empty(self.shape[0] * self.shape[1] * image.channels, np.float32)
            image.pixels.foreach_get(pixels)
        finally:
            bpy.data.images.remove(image)
        pixels = pixels.reshape(*self.shape, -1)[::-1, :, 0]
        return np.ascontiguousarray(pixels)

    def _set_up_cycles(self, edge_samples, threads):
        s = bpy.context.scene
        s.render.engine = "CYCLES"
        s.cycles.samples = edge_samples
        s.cycles.use_adaptive_sampling = True
        s.cycles.adaptive_threshold = ADAPTIVE_THRESHOLD
        s.cycles.adaptive_min_samples = FLAT_SAMPLES
        s.cycles.use_denoising = False
        s.cycles.seed = 0
        s.cycles.max_bounces = 0
        s.cycles.pixel_filter_type = "BOX"
        s.cycles.filter_width = 1.0
        s.render.use_persistent_data = True
        s.render.threads_mode, s.render.threads = "FIXED", threads
        s.render.resolution_y, s.render.resolution_x = self.shape
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
        world = bpy.data.worlds.new("background")
        bpy.context.scene.world = world
        world.use_nodes = True
        tree = world.node_tree
        tree.nodes.clear()
        background = tree.nodes.new("ShaderNodeBackground")
        background.inputs["Color"].default_value = (1, 1, 1, 1)
        background.inputs["Strength"].default_value = self.scene.background
        tree.links.new(background.outputs[0], tree.nodes.new("ShaderNodeOutputWorld").inputs[0])

    def _add_ground(self):
        lowest = min((float(p.grid_world()[..., 2].min()) for p in self.scene.plates), default=0.0)
        z, r = min(lowest, 0.0) - GROUND_BELOW_M, GROUND_REACH_M
        mesh = bpy.data.meshes.new("ground")
        mesh.from_pydata([(-r, -r, z), (r, -r, z), (r, r, z), (-r, r, z)], [], [(0, 1, 2, 3)])
        mesh.materials.append(self._material("ground", self.scene.ground, glossy=False))
        bpy.context.collection.objects.link(bpy.data.objects.new("ground", mesh))

    def _add_plates(self):
        vertices, faces, kinds = [], [], []
        for plate in self.scene.plates:
            printed = spread_ink(plate, self.scene.ink_spread_m) if self.scene.ink_spread_m else plate
            grid = printed.grid_world()
            rows, columns = grid.shape[:2]
            first = len(vertices)
            vertices.extend(map(tuple, grid.reshape(-1, 3).tolist()))
            for j in range(rows - 1):
                for i in range(columns - 1):
                    a = first + j * columns + i
                    faces.append((a, a + 1, a + columns + 1, a + columns))
                    kinds.append(WHITE if printed.white[j, i] else BLACK)
        mesh = bpy.data.meshes.new("plates")
        mesh.from_pydata(vertices, [], faces)
        for name, level in (("black", self.scene.black), ("white", self.scene.white)):
            mesh.materials.append(self._material(name, level, glossy=True))
        mesh.polygons.foreach_set("material_index", kinds)
        bpy.context.collection.objects.link(bpy.data.objects.new("plates", mesh))

    def _add_camera(self, K):
        height, width = self.shape
        data = bpy.data.cameras.new("camera")
        data.sensor_fit, data.sensor_width = "HORIZONTAL", SENSOR_MM
        fx, fy = K[0, 0], K[1, 1]
        data.lens = float(fx * SENSOR_MM / width)
        aspect = fx / fy
        render = bpy.context.scene.render
        render.pixel_aspect_x, render.pixel_aspect_y = (1.0, aspect) if aspect >= 1 else (1 / aspect, 1.0)
        # array coordinates of the principal point, counted from the array's edge
        cx, cy = K[0, 2] + self.margin + 0.5, K[1, 2] + self.margin + 0.5
        data.shift_x = float((width / 2 - cx) / width)
        data.shift_y = float((cy - height / 2) / width * aspect)
        data.clip_start, data.clip_end = 1e-3, 10 * GROUND_REACH_M
        camera = bpy.data.objects.new("camera", data)
        bpy.context.collection.objects.link(camera)
        bpy.context.scene.camera = camera
        return camera

    # -- materials ----------------------------------------------------------------------------------------------------

    def _material(self, name, radiance, glossy):
        """Return a material that emits radiance, under the scene's light, a glossy lamp's reflection added on plates."""
        material = bpy.data.materials.new(name)
        material.use_nodes = True
        tree = material.node_tree
        tree.nodes.clear()
        emission = tree.nodes.new("ShaderNodeEmission")
        emission.inputs["Color"].default_value = (1, 1, 1, 1)
        tree.links.new(emission.outputs[0], tree.nodes.new("ShaderNodeOutputMaterial").inputs["Surface"])
        strength = _value(tree, radiance)
        if self.scene.light is not None:
            strength = _math(tree, "MULTIPLY", strength, self._light(tree))
        if glossy and self.scene.highlight is not None:
            strength = _math(tree, "ADD", strength, self._highlight(tree))
        tree.links.new(strength, emission.inputs["Strength"])
        return material

    def _light(self, tree):
        """Return the socket of 1 + gx x + gy (y - 1), at least 0 and at most 4."""
        light = self.scene.light
        position = tree.nodes.new("ShaderNodeSeparateXYZ")
        tree.links.new(tree.nodes.new("ShaderNodeNewGeometry").outputs["Position"], position.inputs[0])
        along_x = _math(tree, "MULTIPLY", position.outputs["X"], _value(tree, light["gradient_x"]))
        forward = _math(tree, "SUBTRACT", position.outputs["Y"], _value(tree, 1.0))
        along_y = _math(tree, "MULTIPLY", forward, _value(tree, light["gradient_y"]))
        total = _math(tree, "ADD", _math(tree, "ADD", along_x, along_y), _value(tree, 1.0))
        return _math(tree, "MINIMUM", _math(tree, "MAXIMUM", total, _value(tree, 0.0)), _value(tree, 4.0))

    def _highlight(self, tree):
        """Return the socket of effects.base.highlight_radiance: strength (n . h)^(2 / roughness^2), n the world's z."""
        lamp = self.scene.highlight
        geometry = tree.nodes.new("ShaderNodeNewGeometry")
        place = tree.nodes.new("ShaderNodeCombineXYZ")
        for axis, key in zip("XYZ", ("x_m", "y_m", "height_m"), strict=True):
            place.inputs[axis].default_value = lamp[key]
        to_lamp = _vector(tree, "NORMALIZE", _vector(tree, "SUBTRACT", place.outputs[0], geometry.outputs["Position"]))
        half = _vector(tree, "NORMALIZE", _vector(tree, "ADD", to_lamp, geometry.outputs["Incoming"]))
        z = tree.nodes.new("ShaderNodeSeparateXYZ")
        tree.links.new(half, z.inputs[0])
        cosine = _math(tree, "MAXIMUM", z.outputs["Z"], _value(tree, 0.0))
        lobe = _math(tree, "POWER", cosine, _value(tree, 2 / lamp["roughness"] ** 2))
        return _math(tree, "MULTIPLY", lobe, _value(tree, lamp["strength"]))


def _value(tree, number):
    node = tree.nodes.new("ShaderNodeValue")
    node.outputs[0].default_value = float(number)
    return node.outputs[0]


def _math(tree, operation, a, b):
    node = tree.nodes.new("ShaderNodeMath")
    node.operation = operation
    tree.links.new(a, node.inputs[0])
    tree.links.new(b, node.inputs[1])
    return node.outputs[0]


def _vector(tree, operation, a, b=None):
    node = tree.nodes.new("ShaderNodeVectorMath")
    node.operation = operation
    tree.links.new(a, node.inputs[0])
    if b is not None:
        tree.links.new(b, node.inputs[1])
    return node.outputs[0]
