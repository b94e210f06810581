"""Materials that emit what a surface reflects, as Blender's shader nodes; a *socket* is a node's output."""

import bpy

from effects.base import FRESNEL_RISE, levelling


def emitting_material(scene, name, radiance, glossy):
    """Return a material that emits radiance under the light of an effects.base.Scene.

    glossy  with the reflection of the scene's lamp, where it has one, as on plates
    """
    material = bpy.data.materials.new(name)
    material.cycles.emission_sampling = "NONE"  # no surface lights another
    material.use_nodes = True
    tree = material.node_tree
    tree.nodes.clear()
    emission = tree.nodes.new("ShaderNodeEmission")
    emission.inputs["Color"].default_value = (1, 1, 1, 1)
    tree.links.new(emission.outputs[0], tree.nodes.new("ShaderNodeOutputMaterial").inputs["Surface"])
    strength = constant(tree, radiance)
    if scene.light is not None:
        strength = combine(tree, "MULTIPLY", strength, _light(scene.light, tree))
    if glossy and scene.highlight is not None:
        strength = combine(tree, "ADD", strength, _highlight(scene.highlight, tree))
    tree.links.new(strength, emission.inputs["Strength"])
    return material


def _light(light, tree):
    """Return the socket of effects.base.light_factor."""
    geometry = tree.nodes.new("ShaderNodeNewGeometry")
    position = tree.nodes.new("ShaderNodeSeparateXYZ")
    tree.links.new(geometry.outputs["Position"], position.inputs[0])
    along_x = combine(tree, "MULTIPLY", position.outputs["X"], constant(tree, light["gradient_x"]))
    forward = combine(tree, "SUBTRACT", position.outputs["Y"], constant(tree, 1.0))
    along_y = combine(tree, "MULTIPLY", forward, constant(tree, light["gradient_y"]))
    tilt = combine(tree, "ADD", along_x, along_y)
    if levelling(light):
        squared = combine(tree, "MULTIPLY", combine(tree, "MULTIPLY", tilt, tilt), constant(tree, levelling(light)))
        length = combine(tree, "SQRT", combine(tree, "ADD", squared, constant(tree, 1.0)), constant(tree, 0.0))
        tilt = combine(tree, "DIVIDE", tilt, length)
    total = combine(tree, "ADD", tilt, constant(tree, 1 - light["lamp_share"]))
    if light["lamp_share"]:
        total = combine(tree, "ADD", total, _near_lamp(light, tree, geometry, position))
    return combine(tree, "MINIMUM", combine(tree, "MAXIMUM", total, constant(tree, 0.0)), constant(tree, 4.0))


def _near_lamp(light, tree, geometry, position):
    """Return the socket of lamp_share E(x, y) / E(0, 1), E = h / d^3 on the ground z = 0."""
    x, y, h = light["lamp_x_m"], light["lamp_y_m"], light["lamp_height_m"]
    ground = tree.nodes.new("ShaderNodeCombineXYZ")
    for axis in "XY":
        tree.links.new(position.outputs[axis], ground.inputs[axis])
    lamp = tree.nodes.new("ShaderNodeCombineXYZ")
    for axis, value in zip("XYZ", (x, y, h), strict=True):
        lamp.inputs[axis].default_value = value
    away = combine_vectors(tree, "SUBTRACT", lamp.outputs[0], ground.outputs[0])
    length = tree.nodes.new("ShaderNodeVectorMath")
    length.operation = "LENGTH"
    tree.links.new(away, length.inputs[0])
    falloff = combine(tree, "POWER", length.outputs["Value"], constant(tree, -3.0))
    there = (h * h + x * x + (1.0 - y) ** 2) ** 1.5
    return combine(tree, "MULTIPLY", falloff, constant(tree, light["lamp_share"] * there))


def _highlight(lamp, tree):
    """Return the socket of effects.base.highlight_radiance."""
    geometry = tree.nodes.new("ShaderNodeNewGeometry")
    place = tree.nodes.new("ShaderNodeCombineXYZ")
    for axis, key in zip("XYZ", ("x_m", "y_m", "height_m"), strict=True):
        place.inputs[axis].default_value = lamp[key]
    to_lamp = combine_vectors(
        tree, "NORMALIZE", combine_vectors(tree, "SUBTRACT", place.outputs[0], geometry.outputs["Position"])
    )
    half = combine_vectors(tree, "NORMALIZE", combine_vectors(tree, "ADD", to_lamp, geometry.outputs["Incoming"]))
    z = tree.nodes.new("ShaderNodeSeparateXYZ")
    tree.links.new(half, z.inputs[0])
    cosine = combine(tree, "MAXIMUM", z.outputs["Z"], constant(tree, 0.0))
    lobe = combine(tree, "POWER", cosine, constant(tree, 2 / lamp["roughness"] ** 2))
    to_eye = tree.nodes.new("ShaderNodeVectorMath")
    to_eye.operation = "DOT_PRODUCT"
    tree.links.new(half, to_eye.inputs[0])
    tree.links.new(geometry.outputs["Incoming"], to_eye.inputs[1])
    away = combine(tree, "SUBTRACT", constant(tree, 1.0), to_eye.outputs["Value"])
    rise = combine(tree, "POWER", combine(tree, "MAXIMUM", away, constant(tree, 0.0)), constant(tree, 5.0))
    rise = combine(tree, "MULTIPLY", rise, constant(tree, lamp["fresnel"] * FRESNEL_RISE))
    lobe = combine(tree, "MULTIPLY", lobe, combine(tree, "ADD", rise, constant(tree, 1.0)))
    return combine(tree, "MULTIPLY", lobe, constant(tree, lamp["strength"]))


def constant(tree, number):
    """Return the socket of a number."""
    node = tree.nodes.new("ShaderNodeValue")
    node.outputs[0].default_value = float(number)
    return node.outputs[0]


def combine(tree, operation, a, b):
    """Return the socket of what Blender's math node makes of two sockets."""
    node = tree.nodes.new("ShaderNodeMath")
    node.operation = operation
    tree.links.new(a, node.inputs[0])
    tree.links.new(b, node.inputs[1])
    return node.outputs[0]


def combine_vectors(tree, operation, a, b=None):
    """Return the socket of what Blender's vector math node makes of one or two sockets."""
    node = tree.nodes.new("ShaderNodeVectorMath")
    node.operation = operation
    tree.links.new(a, node.inputs[0])
    if b is not None:
        tree.links.new(b, node.inputs[1])
    return node.outputs[0]
