"""Render a rig as a moving camera with a rolling shutter sees it; one process renders many frames.

Cycles draws a time for each sample and moves camera and occluder to it, so that motion blur and rolling shutter come
from the scene and not from a filter. What that costs and how exact it is: docs/moving.md.
"""

import bpy
import numpy as np
from mathutils import Matrix, Quaternion

from blender.materials import emitting_material
from blender.renderer import BOX_FILTER_PX, Renderer
from rig.geometry import invert_pose

MOTION_STEPS = 3  # in Blender's words: 2^3 + 1 poses in the shutter's time, straight lines between
POSES = 2**MOTION_STEPS + 1
FRAME = 10  # of Blender's time line; each of ours is rendered there
MIN_SAMPLES = 8  # of each pixel; what differs among them is sampled on
ADAPTIVE_THRESHOLD = 0.004
STRIPES = 8
DARK, BRIGHT = 0.08, 0.25  # radiance of the occluder's stripes


class MovingRenderer(Renderer):
    """A Blender scene of a rig, a camera without overscan, and perhaps an occluder (a moving_config.Occluder).

    exposure_s, readout_s  of each row, and from the first row to the last, seconds
    The other arguments are those of blender.renderer.Renderer.
    """

    def __init__(self, scene, K, width, height, samples, exposure_s, readout_s, occluder, threads, folder):
        super().__init__(scene, K, width, height, 0, samples, threads, folder)
        self.exposure_s, self.readout_s = exposure_s, readout_s
        self.occluder = self._add_occluder(occluder) if occluder else None
        self._use_pinhole()
        self._set_up_shutter(samples)

    def instants_s(self):
        """Return the times (POSES,) from a frame's own time at which ``render_frame`` is told poses.

        Cycles reads row r, counted from 0 at the top, at (r + 1) / rows of the way down; ours at (r + 0.5) / rows.
        """
        whole = self.exposure_s + self.readout_s
        return whole * (np.arange(POSES) / (POSES - 1) - 0.5) - 0.5 * self.readout_s / self.shape[0]

    def render_frame(self, poses, occluder_x_m):
        """Return the linear radiance (rows, columns) float32; poses (T_cam_world) and places at ``instants_s``."""
        self._animate(self.camera, [invert_pose(T) @ np.diag([1.0, -1.0, -1.0, 1.0]) for T in poses])
        if self.occluder is not None:
            places = [np.eye(4) for _ in poses]
            for place, x in zip(places, occluder_x_m, strict=True):
                place[0, 3] = x
            self._animate(self.occluder, places)
        bpy.context.scene.frame_set(FRAME)
        return self._run(self.shape)

    def _animate(self, thing, poses):
        """Move an object through poses (T_world_thing), straight and evenly between them, in one frame of Blender's."""
        thing.animation_data_clear()
        thing.rotation_mode = "QUATERNION"
        turned = None
        for k, pose in enumerate(poses):
            place, turn, _ = Matrix(pose.tolist()).decompose()
            if turned is not None:
                turn.make_compatible(turned)  # q and -q are the same turn, what lies between them is not
            turned = Quaternion(turn)
            thing.location, thing.rotation_quaternion = place, turn
            when = FRAME - 0.5 + k / (len(poses) - 1)
            thing.keyframe_insert("location", frame=when)
            thing.keyframe_insert("rotation_quaternion", frame=when)
        for strip in thing.animation_data.action.layers[0].strips:
            for curve in strip.channelbags[0].fcurves:
                for point in curve.keyframe_points:
                    point.interpolation = "LINEAR"

    def _set_up_shutter(self, samples):
        scene = bpy.context.scene
        scene.render.use_motion_blur = True
        scene.render.motion_blur_position = "CENTER"
        scene.render.motion_blur_shutter = 1.0  # Blender's frame lasts as long as ours is read and exposed
        cycles = scene.cycles
        cycles.rolling_shutter_type = "TOP" if self.readout_s > 0 else "NONE"
        cycles.rolling_shutter_duration = self.exposure_s / (self.exposure_s + self.readout_s)
        cycles.samples, cycles.filter_width, cycles.use_adaptive_sampling = samples, BOX_FILTER_PX, True
        cycles.adaptive_threshold, cycles.adaptive_min_samples = ADAPTIVE_THRESHOLD, min(MIN_SAMPLES, samples)
        for thing in (self.camera, self.occluder):
            if thing is not None:
                thing.cycles.use_motion_blur = True
                thing.cycles.motion_steps = MOTION_STEPS

    def _add_occluder(self, occluder):
        """Add the box, upright on the ground at x = 0, in stripes from its foot to its top."""
        w, d, y = occluder.width_m / 2, occluder.thickness_m / 2, occluder.y_m
        z = np.linspace(0, occluder.height_m, STRIPES + 1)
        ring = [(-w, y - d), (w, y - d), (w, y + d), (-w, y + d)]
        vertices = [(*corner, float(height)) for height in z for corner in ring]
        faces = [
            (4 * k + i, 4 * k + (i + 1) % 4, 4 * k + 4 + (i + 1) % 4, 4 * k + 4 + i)
            for k in range(STRIPES)
            for i in range(4)
        ]
        mesh = bpy.data.meshes.new("occluder")
        mesh.from_pydata(vertices, [], [*faces, (0, 1, 2, 3), tuple(4 * STRIPES + i for i in range(4))])
        for name, level in (("dark", DARK), ("bright", BRIGHT)):
            mesh.materials.append(emitting_material(self.scene, name, level, glossy=False))
        mesh.polygons.foreach_set("material_index", [k // 4 % 2 for k in range(len(faces))] + [0, 0])
        box = bpy.data.objects.new("occluder", mesh)
        bpy.context.collection.objects.link(box)
        return box
