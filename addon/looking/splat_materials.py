# SPDX-License-Identifier: GPL-3.0-or-later
"""Materials of splats: light of their own, with the colours that the point attribute `color` says."""

from __future__ import annotations

import bpy

__all__ = ["RADIUS", "soft", "solid"]

RADIUS = 3.0  # standard deviations: beyond, a Gaussian of opacity 1 hides one hundredth
SOLID, SOFT = "SACHA Ellipsoids", "SACHA Splats"


def solid() -> bpy.types.Material:
    """Give the material of ellipsoids that were made real: they glow in their colours."""
    material = bpy.data.materials.get(SOLID)
    if material is not None:
        return material
    material, tree = _new(SOLID)
    colour = tree.nodes.new("ShaderNodeAttribute")
    colour.attribute_name = "color"
    glow = tree.nodes.new("ShaderNodeEmission")
    tree.links.new(colour.outputs["Color"], glow.inputs["Color"])
    _finish(tree, glow.outputs[0])
    return material


def soft() -> bpy.types.Material:
    """Give the material of unit spheres, scaled to `RADIUS` standard deviations, that hide what a Gaussian hides.

    A ray that passes the centre at distance d of the sphere's radius meets an opacity of alpha exp(-(RADIUS d)^2 / 2), as a rasteriser of
    splats has it; only where it enters, since it would be counted twice.
    """
    material = bpy.data.materials.get(SOFT)
    if material is not None:
        return material
    material, tree = _new(SOFT)
    nodes, link = tree.nodes, tree.links.new
    colour = nodes.new("ShaderNodeAttribute")
    colour.attribute_type, colour.attribute_name = "INSTANCER", "color"
    place = nodes.new("ShaderNodeTexCoord").outputs["Object"]
    entering = nodes.new("ShaderNodeNewGeometry")
    turned = nodes.new("ShaderNodeVectorTransform")
    turned.vector_type, turned.convert_from, turned.convert_to = "VECTOR", "WORLD", "OBJECT"
    link(entering.outputs["Incoming"], turned.inputs[0])
    ray = _vector(tree, "NORMALIZE", turned.outputs[0])
    along = _vector(tree, "DOT_PRODUCT", place, ray, output="Value")
    square = _math(tree, "MULTIPLY", along, along)
    distance = _math(tree, "SUBTRACT", _vector(tree, "DOT_PRODUCT", place, place, output="Value"), square)
    fade = _math(tree, "EXPONENT", _math(tree, "MULTIPLY", distance, -RADIUS * RADIUS / 2))
    front = _math(tree, "SUBTRACT", 1.0, entering.outputs["Backfacing"])
    alpha = _math(tree, "MULTIPLY", _math(tree, "MULTIPLY", fade, colour.outputs["Alpha"]), front)
    glow, clear, mix = (nodes.new(f"ShaderNode{kind}") for kind in ("Emission", "BsdfTransparent", "MixShader"))
    link(colour.outputs["Color"], glow.inputs["Color"])
    link(alpha, mix.inputs[0])
    link(clear.outputs[0], mix.inputs[1])
    link(glow.outputs[0], mix.inputs[2])
    _finish(tree, mix.outputs[0])
    if hasattr(material, "surface_render_method"):
        material.surface_render_method = "BLENDED"
    return material


def _new(name: str) -> tuple[bpy.types.Material, bpy.types.NodeTree]:
    material = bpy.data.materials.new(name)
    if material.node_tree is None:  # Blender 5 makes the tree itself
        material.use_nodes = True
    material.node_tree.nodes.clear()
    return material, material.node_tree


def _finish(tree: bpy.types.NodeTree, surface: bpy.types.NodeSocket) -> None:
    tree.links.new(surface, tree.nodes.new("ShaderNodeOutputMaterial").inputs["Surface"])
    for place, node in enumerate(tree.nodes):
        node.location = (220 * (place % 8), -260 * (place // 8))


def _math(tree: bpy.types.NodeTree, operation: str, *values: bpy.types.NodeSocket | float) -> bpy.types.NodeSocket:
    node = tree.nodes.new("ShaderNodeMath")
    node.operation = operation
    for socket, value in zip(node.inputs, values, strict=False):
        if isinstance(value, bpy.types.NodeSocket):
            tree.links.new(value, socket)
        else:
            socket.default_value = value
    return node.outputs[0]


def _vector(
    tree: bpy.types.NodeTree, operation: str, *vectors: bpy.types.NodeSocket, output: str = "Vector"
) -> bpy.types.NodeSocket:
    node = tree.nodes.new("ShaderNodeVectorMath")
    node.operation = operation
    for socket, vector in zip(node.inputs, vectors, strict=False):
        tree.links.new(vector, socket)
    return node.outputs[output]
